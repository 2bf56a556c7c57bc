//! Times and bytes by hand.

use super::{
    super::{
        CachedSource, MemorySource,
        conformance::{Fixture, fetch},
    },
    *,
};

const MS: Duration = Duration::from_millis(1);

/// A byte takes a microsecond; a round trip takes 20 ms.
fn line() -> Network {
    Network {
        bits_per_second: 8_000_000,
        round_trip: 20 * MS,
        ..Network::default()
    }
}

fn source(network: Network) -> NetworkSource<MemorySource> {
    NetworkSource::new(Fixture::get().memory(), network, 1)
}

fn length(request: &Request) -> u64 {
    Fixture::get().expected(request).len() as u64
}

/// Submits all and returns what was asked, when it landed in microseconds, and its bytes on the wire.
fn times(network: Network, seed: u64, requests: &[Request]) -> Vec<(String, u64, u64)> {
    let mut source = NetworkSource::new(Fixture::get().memory(), network, seed);
    let mut open = requests.iter();
    let mut came = Vec::new();
    while came.len() < requests.len() {
        while source.in_flight() < source.capacity() && open.len() > 0 {
            source.submit(open.next().unwrap().clone()).unwrap();
        }
        source.advance(Duration::from_micros(1));
        while let Some(answer) = source.poll() {
            came.push((
                answer.request.to_string(),
                source.elapsed().as_micros() as u64,
                answer.wire_bytes,
            ));
        }
        assert!(source.elapsed() < Duration::from_secs(100), "stuck");
    }
    came
}

#[test]
fn an_answer_takes_a_handshake_a_round_trip_and_its_bytes() {
    let requests = &Fixture::get().requests()[1..4];
    let came = times(line(), 1, requests);
    let mut due = 40_000;
    for (request, (name, at, bytes)) in requests.iter().zip(came) {
        due += length(request);
        assert_eq!((name, at, bytes), (request.to_string(), due, length(request)));
    }
    // Headers travel along.
    let headers = Network {
        header_bytes: 500,
        ..line()
    };
    let first = times(headers, 1, &requests[..1]).remove(0);
    assert_eq!(
        (first.1, first.2),
        (40_500 + length(&requests[0]), length(&requests[0]) + 500)
    );
}

#[test]
fn what_waits_for_a_connection_goes_out_when_an_answer_lands() {
    let requests = &Fixture::get().requests()[1..5];
    let http1 = |connections| Network {
        connections,
        streams: 1,
        ..line()
    };
    let one = times(http1(1), 1, requests);
    let bytes: u64 = requests.iter().map(length).sum();
    assert_eq!(one[3].1, 20_000 + 4 * 20_000 + bytes, "one after the other");
    let four = times(http1(4), 1, requests);
    assert_eq!(four[3].1, 40_000 + bytes, "all at once, but one line");
}

#[test]
fn losses_hold_up_their_connection_and_cost_their_bytes() {
    let requests = &Fixture::get().requests()[..40];
    let lossy = Network { loss: 0.2, ..line() };
    let came = times(lossy, 3, requests);
    assert_eq!(came, times(lossy, 3, requests), "the same every time");
    assert_ne!(came, times(lossy, 4, requests));
    let asked: Vec<String> = requests.iter().map(Request::to_string).collect();
    let order: Vec<String> = came.iter().map(|(name, ..)| name.clone()).collect();
    assert_eq!(order, asked, "in order on one connection");
    let whole: u64 = requests.iter().map(length).sum();
    let wire: u64 = came.iter().map(|(.., bytes)| bytes).sum();
    assert!(wire > whole, "{wire} of {whole}");
    assert!(
        came.last().unwrap().1 >= 40_000 + wire + 10_000,
        "later by round trips"
    );

    let overtaking = Network {
        reorder: 0.3,
        ..line()
    };
    let order: Vec<String> = times(overtaking, 3, requests)
        .into_iter()
        .map(|(name, ..)| name)
        .collect();
    assert_ne!(order, asked);
    let jitter = Network {
        jitter: 5 * MS,
        ..line()
    };
    let late = times(jitter, 3, requests);
    assert!(
        late.iter()
            .zip(times(line(), 3, requests))
            .all(|(late, plain)| { (plain.1..=plain.1 + 5000).contains(&late.1) })
    );
}

#[test]
fn what_is_given_up_stops_costing_half_a_round_trip_later() {
    let index = Fixture::get().requests()[0].clone();
    let bytes = length(&index);
    assert!(bytes > 200, "{bytes}");
    // Ten microseconds a byte.
    let network = Network {
        bits_per_second: 800_000,
        round_trip: MS,
        ..Network::default()
    };
    let mut source = source(network);
    let ask = |source: &mut NetworkSource<MemorySource>| source.submit(index.clone()).unwrap();
    let ticket = ask(&mut source);
    // The handshake and half a round trip: the first byte leaves after 1.5 ms. At 1.6 ms ten have, at 2.1 ms sixty.
    source.advance(Duration::from_micros(1600));
    source.cancel(ticket);
    assert_eq!(source.in_flight(), 0);
    source.advance(Duration::from_secs(1));
    assert!(source.poll().is_none());
    let expected = NetworkStats {
        wasted_bytes: 60,
        saved_bytes: bytes - 60,
        ..NetworkStats::default()
    };
    assert_eq!(source.network_stats(), expected);
    // Before anything has left, nothing is lost; after all has, all.
    let ticket = ask(&mut source);
    source.cancel(ticket);
    assert_eq!(source.network_stats().wasted_bytes, 60);
    let ticket = ask(&mut source);
    source.advance(Duration::from_secs(1));
    source.cancel(ticket);
    assert!(source.poll().is_none());
    assert_eq!(source.network_stats().wasted_bytes, 60 + bytes);
    assert_eq!(source.network_stats().delivered_bytes, 0);
    // The line is free for others.
    ask(&mut source);
    source.advance(MS + Duration::from_micros(10 * bytes));
    assert!(source.poll().is_some());
    assert_eq!(source.stats().wire_bytes, bytes);
}

#[test]
fn a_cache_behind_it_costs_nothing_and_an_idle_line_saves_nothing_up() {
    let requests = Fixture::get().requests();
    let mut source = NetworkSource::new(CachedSource::new(Fixture::get().memory(), 1 << 20), line(), 1);
    // Caches keep what they can check: the index comes first.
    for request in &requests[..2] {
        source.submit(request.clone()).unwrap();
        source.advance(Duration::from_secs(10));
        assert!(source.poll().is_some());
    }
    source.submit(requests[2].clone()).unwrap();
    assert!(source.poll().is_none());
    source.advance(20 * MS);
    assert!(
        source.poll().is_none(),
        "its bytes take time, however long the line was idle"
    );
    source.advance(Duration::from_micros(length(&requests[2])));
    assert!(source.poll().is_some());
    assert_eq!(fetch(&mut source, &requests[1..3]).len(), 2, "at once");
}

#[test]
fn names_stand_for_networks() {
    for name in Network::NAMES {
        let network = Network::named(name).unwrap();
        assert!(
            network.bits_per_second > 0 && !network.round_trip.is_zero(),
            "{name}"
        );
    }
    assert_eq!(Network::named("5g"), None);
}
