//! What every source must do, run over all of them.

mod fixture;
mod host;
mod subjects;

use std::{
    collections::BTreeSet,
    sync::Arc,
    time::{Duration, Instant},
};

use proptest::prelude::*;
use tileset::{PageId, archive::Index};

use self::subjects::subjects;
pub(super) use self::{
    fixture::{Fixture, archive},
    host::{Host, Trick},
    subjects::Served,
};
use super::*;
use crate::Error;

/// Long enough for anything that is not stuck.
const PATIENCE: Duration = Duration::from_secs(30);

/// Polls and waits until nothing is in flight.
#[track_caller]
pub(super) fn drain(source: &mut dyn TileSource) -> Vec<Answer> {
    let deadline = Instant::now() + PATIENCE;
    let mut answers = Vec::new();
    while source.in_flight() > 0 {
        match source.poll() {
            Some(answer) => answers.push(answer),
            None => source.wait(Duration::from_millis(100)),
        }
        assert!(
            Instant::now() < deadline,
            "{} requests are stuck",
            source.in_flight()
        );
    }
    answers
}

/// Asks for all, a capacity at a time.
#[track_caller]
pub(super) fn fetch(source: &mut dyn TileSource, requests: &[Request]) -> Vec<Answer> {
    let mut answers = Vec::new();
    for request in requests {
        while source.in_flight() == source.capacity() {
            answers.extend(drain(source));
        }
        source.submit(request.clone()).unwrap();
    }
    answers.extend(drain(source));
    answers
}

fn run(test: impl Fn(&str, &mut dyn TileSource)) {
    for (name, subject) in subjects() {
        test(name, &mut *subject().source);
    }
}

#[test]
fn every_record_comes_once_and_whole() {
    let (fixture, requests) = (Fixture::get(), Fixture::get().requests());
    run(|name, source| {
        // Twice, so that caches have something to answer.
        for _ in 0..2 {
            let answers = fetch(source, &requests);
            assert_eq!(answers.len(), requests.len(), "{name}");
            let asked: BTreeSet<String> = requests.iter().map(Request::to_string).collect();
            let answered: BTreeSet<String> =
                answers.iter().map(|answer| answer.request.to_string()).collect();
            assert_eq!(answered, asked, "{name}");
            let tickets: BTreeSet<Ticket> = answers.iter().map(|answer| answer.ticket).collect();
            assert_eq!(tickets.len(), answers.len(), "{name}: each ticket once");
            for answer in answers {
                let bytes = answer
                    .bytes
                    .unwrap_or_else(|error| panic!("{name}, {}: {error}", answer.request));
                assert_eq!(
                    bytes,
                    fixture.expected(&answer.request),
                    "{name}, {}",
                    answer.request
                );
                // From a cache, or from what came with the index.
                let kept = ["cached", "all", "disk", "range", "either"];
                let kept = kept.iter().any(|kept| name.contains(kept));
                // What a tile server that is none said costs something, too.
                let from_cache = kept && (answer.wire_bytes == 0 || name.contains("either"));
                assert!(
                    answer.wire_bytes >= bytes.len() as u64 || from_cache,
                    "{name}, {}",
                    answer.request
                );
            }
            assert!(source.poll().is_none(), "{name}");
        }
    });
}

#[test]
fn what_is_missing_is_said_to_be_missing() {
    let index = Index::parse(&Fixture::get().expected(&Fixture::get().requests()[0])).unwrap();
    let archive = || Arc::from("cloth");
    let mut missing = vec![
        Request::Page {
            archive: archive(),
            page: PageId {
                group: 2,
                tile: index.pyramid.root(),
            },
        },
        Request::Page {
            archive: archive(),
            page: PageId {
                group: 0,
                tile: tileset::Tile { mip: 0, x: 4, y: 0 },
            },
        },
        Request::Column {
            archive: archive(),
            group: 2,
        },
    ];
    for name in [
        "wool",
        "",
        "..",
        "../cloth",
        "a/b",
        "cloth.bsvtf",
        "/cloth",
        "\0",
        "%63loth",
    ] {
        missing.push(Request::Index { archive: name.into() });
        missing.push(Request::Column {
            archive: name.into(),
            group: 0,
        });
    }
    run(|name, source| {
        let answers = fetch(source, &missing);
        assert_eq!(answers.len(), missing.len());
        for answer in answers {
            let error = answer.bytes.expect_err(name);
            let not_found = matches!(
                error,
                Error::NotFound(_) | Error::Archive(tileset::Error::NotFound { .. })
            );
            assert!(not_found, "{name}, {}: {error:?}", answer.request);
        }
        let present = &Fixture::get().requests()[1..2];
        assert!(
            fetch(source, present)[0].bytes.is_ok(),
            "{name}: others are still there"
        );
    });
}

#[test]
fn no_more_than_the_capacity_is_in_flight() {
    let requests = Fixture::get().requests();
    run(|name, source| {
        let capacity = source.capacity();
        assert!(capacity > 0 && source.in_flight() == 0, "{name}");
        for submitted in 0..capacity {
            assert_eq!(source.in_flight(), submitted, "{name}");
            assert!(
                source
                    .submit(requests[submitted % requests.len()].clone())
                    .is_some(),
                "{name}"
            );
        }
        for _ in 0..10 {
            assert_eq!(source.submit(requests[0].clone()), None, "{name}");
            assert_eq!(source.in_flight(), capacity, "{name}");
        }
        assert_eq!(drain(source).len(), capacity, "{name}");
        assert!(
            source.submit(requests[0].clone()).is_some(),
            "{name}: there is room again"
        );
        assert_eq!(drain(source).len(), 1, "{name}");
    });
}

#[test]
fn what_it_took_is_counted() {
    let requests = Fixture::get().requests();
    run(|name, source| {
        assert!(!source.origin().is_empty(), "{name}");
        let before = source.stats();
        let wire_bytes: u64 = fetch(source, &requests)
            .iter()
            .map(|answer| answer.wire_bytes)
            .sum();
        let stats = source.stats();
        // Sources without a host count nothing.
        let counted = stats.wire_bytes - before.wire_bytes;
        assert!(
            counted == 0 || counted == wire_bytes,
            "{name}: {stats:?}, {wire_bytes}"
        );
    });
}

#[test]
fn what_is_given_up_does_not_come() {
    let requests = Fixture::get().requests();
    run(|name, source| {
        let ask = |source: &mut dyn TileSource| -> Vec<Ticket> {
            requests[..8]
                .iter()
                .map(|request| source.submit(request.clone()).unwrap())
                .collect()
        };
        let tickets = ask(source);
        for ticket in tickets.iter().step_by(2) {
            source.cancel(*ticket);
            source.cancel(*ticket); // Once more changes nothing.
        }
        source.cancel(Ticket(u64::MAX)); // Unknown.
        assert_eq!(source.in_flight(), 4, "{name}");
        let kept: BTreeSet<Ticket> = tickets.iter().skip(1).step_by(2).copied().collect();
        let came: BTreeSet<Ticket> = drain(source).iter().map(|answer| answer.ticket).collect();
        assert_eq!(came, kept, "{name}");
        source.cancel(tickets[1]); // Answered already.

        // Given up after the answers have arrived, but before they were polled.
        let tickets = ask(source);
        source.wait(Duration::from_millis(50));
        tickets.iter().for_each(|ticket| source.cancel(*ticket));
        assert_eq!(source.in_flight(), 0, "{name}");
        assert!(source.poll().is_none(), "{name}");

        // Very often: what is given up leaves nothing behind that would use up the capacity.
        for i in 0..1000 {
            let ticket = source.submit(requests[i % requests.len()].clone());
            source.cancel(ticket.unwrap_or_else(|| panic!("{name}: no room at {i}")));
        }
        assert!(source.poll().is_none(), "{name}");
        assert_eq!(fetch(source, &requests).len(), requests.len(), "{name}");
    });
}

#[test]
fn nothing_blocks() {
    let requests = Fixture::get().requests();
    run(|name, source| {
        let begin = Instant::now();
        assert!(source.poll().is_none(), "{name}");
        source.wait(Duration::MAX);
        assert!(begin.elapsed() < PATIENCE, "{name}: there is nothing to wait for");
        for request in &requests[..8] {
            source.submit(request.clone()).unwrap();
        }
    });
    // Dropped here with requests in flight.
}

/// Something a caller does.
#[derive(Clone, Debug)]
enum Step {
    Submit(usize),
    Cancel(usize),
    Poll,
    Wait,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        4 => (0..1000usize).prop_map(Step::Submit),
        1 => (0..1000usize).prop_map(Step::Cancel),
        4 => Just(Step::Poll),
        1 => Just(Step::Wait),
    ];
    proptest::collection::vec(step, 0..200)
}

/// Any calls in any order, against a list of what is open.
fn compare_with_a_model(
    name: &str,
    source: &mut dyn TileSource,
    steps: &[Step],
) -> Result<(), TestCaseError> {
    let (fixture, requests) = (Fixture::get(), Fixture::get().requests());
    let mut open: Vec<(Ticket, Request)> = Vec::new();
    let check = |answer: Answer, open: &mut Vec<(Ticket, Request)>| {
        let at = open.iter().position(|(ticket, _)| *ticket == answer.ticket);
        let (_, request) = open.remove(at.expect("an answer to an open request"));
        prop_assert_eq!(&request, &answer.request);
        let bytes = answer
            .bytes
            .map_err(|error| TestCaseError::fail(format!("{name}: {error}")))?;
        prop_assert_eq!(bytes, fixture.expected(&request));
        Ok(())
    };
    for step in steps {
        match step {
            Step::Submit(which) => {
                let request = &requests[which % requests.len()];
                let ticket = source.submit(request.clone());
                prop_assert_eq!(ticket.is_some(), open.len() < source.capacity());
                open.extend(ticket.map(|ticket| (ticket, request.clone())));
            }
            Step::Cancel(_) if open.is_empty() => {}
            Step::Cancel(which) => {
                let (ticket, _) = open.remove(which % open.len());
                source.cancel(ticket);
            }
            Step::Poll => {
                if let Some(answer) = source.poll() {
                    check(answer, &mut open)?;
                }
            }
            Step::Wait => source.wait(Duration::from_millis(1)),
        }
        prop_assert_eq!(source.in_flight(), open.len());
    }
    for answer in drain(source) {
        check(answer, &mut open)?;
    }
    prop_assert!(open.is_empty());
    Ok(())
}

#[test]
fn any_calls_in_any_order() {
    for (name, subject) in subjects() {
        let mut subject = subject();
        let slow = ["http", "range", "either", "disk", "background"];
        let cases = match slow.iter().any(|slow| name.contains(slow)) {
            true => 20,
            false => 100,
        };
        let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(cases));
        let source = std::cell::RefCell::new(&mut subject.source);
        runner
            .run(&steps(), |steps| {
                compare_with_a_model(name, &mut ***source.borrow_mut(), &steps)
            })
            .unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}
