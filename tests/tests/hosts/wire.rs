//! What the client and a tile server really put on the line is what the model of a line to one counts.

use std::time::Duration;

use engine::stream::{HttpOptions, HttpSource, MemorySource, Network, NetworkSource, Request, TileSource};
use tests::{Server, requests};

use crate::FIXTURE;

/// Submits all of a go at once, and waits until all of it has come; `pass` lets time pass. Returns bytes and exchanges of all
/// goes.
fn travel<S: TileSource>(source: &mut S, goes: &[Vec<Request>], pass: impl Fn(&mut S)) -> (u64, u64) {
    let mut wire_bytes = 0;
    for go in goes {
        for request in go {
            source.submit(request.clone()).expect("room");
        }
        let mut left = go.len();
        while left > 0 {
            match source.poll() {
                Some(answer) => {
                    answer.bytes.expect("a record");
                    (left, wire_bytes) = (left - 1, wire_bytes + answer.wire_bytes);
                }
                None => {
                    source.wait(Duration::from_millis(10));
                    pass(source);
                }
            }
        }
    }
    (wire_bytes, source.stats().exchanges)
}

#[test]
fn the_model_counts_what_the_client_receives() {
    let names = FIXTURE.names();
    let server = Server::start(&FIXTURE.tiles());
    let mut memory = MemorySource::new();
    let mut goes: Vec<Vec<Request>> = vec![Vec::new(); 4];
    for name in names {
        let file = FIXTURE.archive(name);
        memory.insert(name, std::fs::read(&file).unwrap()).unwrap();
        let all = requests(name, &file);
        let mut stored = all.into_iter().filter(|(_, bytes)| !bytes.is_empty());
        let mut next = |count| {
            stored
                .by_ref()
                .take(count)
                .map(|(request, _)| request)
                .collect::<Vec<_>>()
        };
        // Indices, single records, a few of each archive, and more than an answer holds.
        for (go, count) in goes.iter_mut().zip([1, 1, 5, 100]) {
            go.extend(next(count));
        }
    }
    let mut client = HttpSource::new(&server.address, &HttpOptions::default()).unwrap();
    let (received, exchanges) = travel(&mut client, &goes, |_| {});
    assert_eq!(received, client.stats().wire_bytes);
    let network = Network::line(1_000_000_000, Duration::from_millis(1), 0.0);
    let mut model = NetworkSource::new(memory, network, 1);
    let pass = |model: &mut NetworkSource<MemorySource>| model.advance(Duration::from_millis(1));
    let (counted, modelled) = travel(&mut model, &goes, pass);
    assert_eq!(modelled, exchanges, "exchanges of the model and of the client");
    assert_eq!(counted, model.network_stats().delivered_bytes);
    let records: u64 = goes.iter().map(|go| go.len() as u64).sum();
    assert!(
        exchanges < records / 2,
        "{exchanges} exchanges for {records} records"
    );
    let off = (counted as f64 - received as f64).abs() / received as f64;
    assert!(off < 0.02, "{counted} bytes in the model, {received} in truth");
}
