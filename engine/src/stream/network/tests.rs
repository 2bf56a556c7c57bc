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
    // Indices go first, whenever they are asked for.
    let mut requests = Fixture::get().requests();
    requests.truncate(40);
    requests.sort_by_key(|request| !matches!(request, Request::Index { .. }));
    let requests = &requests[..];
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

/// A tile server: a head of 100 bytes, frames of 10, up to three records in an answer.
fn batches(connections: usize) -> Network {
    Network {
        connections,
        streams: 1,
        batch: 3,
        header_bytes: 100,
        frame_bytes: 10,
        ..line()
    }
}

/// Records of one archive that are stored, without its index.
fn records(archive: usize) -> Vec<Request> {
    let (name, _) = Fixture::get().archives.iter().nth(archive).unwrap();
    let all = Fixture::get().requests().into_iter();
    all.filter(|request| {
        let index = matches!(request, Request::Index { .. });
        !index && request.archive() == name && length(request) > 0
    })
    .collect()
}

#[test]
fn records_of_one_archive_come_in_one_answer_each_as_soon_as_it_is_there() {
    let (a, b) = (records(0), records(1));
    let index = Fixture::get().requests()[0].clone();
    // The index goes first, alone; then three of the first archive, the other archive's, and the one that is left. They share the line.
    let asked = [&a[0], &b[0], &a[1], &a[2], &a[3], &index];
    let asked: Vec<Request> = asked.into_iter().cloned().collect();
    let mut due = 40_000;
    let expected = [
        (&index, 100),
        (&a[0], 110),
        (&b[0], 100),
        (&a[3], 100),
        (&a[1], 10),
        (&a[2], 10),
    ]
    .map(|(request, more)| {
        due += length(request) + more;
        (request.to_string(), due, length(request) + more)
    });
    assert_eq!(times(batches(4), 1, &asked), expected);
}

#[test]
fn what_waits_for_a_connection_goes_out_together() {
    let a = records(0);
    let mut source = source(batches(1));
    let submit = |source: &mut NetworkSource<MemorySource>, at: usize| {
        source.submit(a[at].clone()).unwrap();
        source.advance(MS);
    };
    // Each a millisecond after the other: the first alone, and all others with it when it has come.
    for at in 0..4 {
        submit(&mut source, at);
    }
    let mut came = 0;
    while came < 4 {
        source.advance(MS);
        while source.poll().is_some() {
            came += 1;
        }
    }
    let bytes: u64 = a[..4].iter().map(length).sum();
    assert_eq!(source.stats().exchanges, 2);
    assert_eq!(source.network_stats().delivered_bytes, bytes + 2 * 100 + 3 * 10);
}

#[test]
fn a_record_in_the_middle_comes_all_the_same() {
    let a = records(0);
    let whole: u64 = a[..3].iter().map(|request| length(request) + 10).sum::<u64>() + 100;
    for given_up in [vec![1], vec![0, 2], vec![0, 1, 2]] {
        let mut source = source(batches(1));
        let tickets: Vec<Ticket> = a[..3]
            .iter()
            .map(|request| source.submit(request.clone()).unwrap())
            .collect();
        // All is on its way, and nothing has left the server.
        source.advance(25 * MS);
        given_up.iter().for_each(|at| source.cancel(tickets[*at]));
        source.advance(Duration::from_secs(1));
        let came: Vec<Ticket> = std::iter::from_fn(|| source.poll().map(|answer| answer.ticket)).collect();
        let kept: Vec<Ticket> = (0..3)
            .filter(|at| !given_up.contains(at))
            .map(|at| tickets[at])
            .collect();
        assert_eq!(came, kept);
        let stats = source.network_stats();
        let lost: u64 = given_up
            .iter()
            .map(|&at| length(&a[at]) + 10 + if at == 0 { 100 } else { 0 })
            .sum();
        let expected = match given_up.len() {
            // It would have begun at 30 ms, and the server knows at 35 ms.
            3 => (whole.min(5000), whole.saturating_sub(5000), 0),
            _ => (lost, 0, whole - lost),
        };
        let found = (stats.wasted_bytes, stats.saved_bytes, stats.delivered_bytes);
        assert_eq!(found, expected, "{given_up:?}");
        // Its connection is free again.
        let again = source.submit(a[3].clone()).unwrap();
        source.advance(Duration::from_secs(1));
        assert_eq!(source.poll().unwrap().ticket, again);
    }
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
