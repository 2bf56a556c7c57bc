//! Pauses in simulated time, and what is asked for again.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use super::{
    super::{
        Faults, FaultySource,
        conformance::{Fixture, fetch},
    },
    *,
};

/// Milliseconds that a test lets pass.
#[derive(Clone, Default)]
struct Time(Arc<AtomicU64>);

impl Time {
    fn pass(&self, milliseconds: u64) {
        self.0.fetch_add(milliseconds, Ordering::SeqCst);
    }
    fn clock(&self) -> Clock {
        let now = Arc::clone(&self.0);
        Box::new(move || Duration::from_millis(now.load(Ordering::SeqCst)))
    }
}

/// Fails with these errors, and then answers with no bytes.
struct Failing {
    errors: Vec<Error>,
    sent: Vec<(Ticket, Request)>,
    submitted: Vec<bool>,
}

impl Failing {
    fn open(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        let ticket = Ticket(self.submitted.len() as u64);
        self.submitted.push(anew);
        self.sent.push((ticket, request));
        Some(ticket)
    }
}

impl TileSource for Failing {
    fn capacity(&self) -> usize {
        4
    }
    fn in_flight(&self) -> usize {
        self.sent.len()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.open(request, false)
    }
    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.open(request, true)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.sent.retain(|(sent, _)| *sent != ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        let (ticket, request) = self.sent.pop()?;
        Some(Answer {
            ticket,
            request,
            bytes: self.errors.pop().map_or(Ok(Bytes::new()), Err),
            checked: false,
            wire_bytes: 10,
        })
    }
    fn wait(&mut self, _limit: Duration) {}
    fn origin(&self) -> String {
        "the host".into()
    }
}

fn unavailable(retry_after: Option<u64>) -> Error {
    Error::Unavailable {
        what: "a page".into(),
        detail: "busy".into(),
        retry_after: retry_after.map(Duration::from_secs),
    }
}

fn failing(errors: Vec<Error>, options: RetryOptions) -> (RetriedSource<Failing>, Time) {
    let time = Time::default();
    let inner = Failing {
        errors,
        sent: Vec::new(),
        submitted: Vec::new(),
    };
    (RetriedSource::with_clock(inner, options, time.clock()), time)
}

fn column() -> Request {
    Request::Column {
        archive: "a".into(),
        group: 0,
    }
}

/// Polls until there is an answer; returns it and at which milliseconds attempts were made.
fn attempts(source: &mut RetriedSource<Failing>, time: &Time) -> (Answer, Vec<u64>) {
    source.submit(column()).unwrap();
    let mut at = vec![0];
    for now in 0..200_000 {
        let answer = source.poll();
        if source.inner.submitted.len() > at.len() {
            at.push(now);
        }
        if let Some(answer) = answer {
            return (answer, at);
        }
        time.pass(1);
    }
    panic!("no answer");
}

#[test]
fn pauses_double_with_jitter_by_seed_up_to_a_longest() {
    let run = |seed| {
        let options = RetryOptions {
            first_attempts: 9,
            seed,
            ..RetryOptions::default()
        };
        let errors = (0..20).map(|_| unavailable(None)).collect();
        let (mut source, time) = failing(errors, options);
        attempts(&mut source, &time)
    };
    let (answer, at) = run(1);
    let said = answer.bytes.unwrap_err().to_string();
    assert!(said.contains("busy") && said.contains("9 attempts"), "{said}");
    assert_eq!((at.len(), answer.wire_bytes), (9, 90));
    let longest = [100, 200, 400, 800, 1600, 3200, 4000, 4000];
    for (pause, longest) in at.windows(2).map(|at| at[1] - at[0]).zip(longest) {
        assert!(
            (longest / 2..=longest + 2).contains(&pause),
            "{pause} of {longest}, {at:?}"
        );
    }
    assert_eq!(at, run(1).1, "the same every time");
    assert_ne!(at, run(2).1);
}

#[test]
fn the_host_may_ask_for_a_longer_pause() {
    let (mut source, time) = failing(vec![unavailable(Some(3))], RetryOptions::default());
    let (answer, at) = attempts(&mut source, &time);
    assert!(answer.bytes.is_ok() && at[1] >= 3000, "{at:?}");
    let (mut source, time) = failing(vec![unavailable(Some(3600))], RetryOptions::default());
    let (answer, at) = attempts(&mut source, &time);
    assert!(answer.bytes.is_err() && at.len() == 1, "nobody waits for an hour");
}

#[test]
fn what_stays_stands_at_once() {
    let errors = [
        Error::NotFound("a page".into()),
        Error::Source {
            what: "a page".into(),
            detail: "401".into(),
        },
    ];
    for error in errors {
        let said = error.to_string();
        let (mut source, time) = failing(vec![error], RetryOptions::default());
        let (answer, at) = attempts(&mut source, &time);
        assert_eq!(answer.bytes.unwrap_err().to_string(), said);
        assert_eq!(at.len(), 1);
    }
}

#[test]
fn a_source_that_was_there_is_waited_for_longer() {
    let options = RetryOptions::default();
    let errors = || (0..20).map(|_| unavailable(None)).collect();
    let (mut source, time) = failing(errors(), options);
    assert_eq!(
        attempts(&mut source, &time).1.len(),
        options.first_attempts as usize
    );
    let (mut source, time) = failing(Vec::new(), options);
    assert!(attempts(&mut source, &time).0.bytes.is_ok());
    source.inner.errors = errors();
    source.inner.submitted.clear();
    assert_eq!(attempts(&mut source, &time).1.len(), options.attempts as usize);
}

#[test]
fn what_waits_can_be_given_up() {
    let (mut source, time) = failing(vec![unavailable(None)], RetryOptions::default());
    let ticket = source.submit(column()).unwrap();
    assert!(source.poll().is_none());
    assert_eq!(source.in_flight(), 1);
    source.cancel(ticket);
    assert_eq!(source.in_flight(), 0);
    time.pass(1000);
    assert!(source.poll().is_none() && source.inner.submitted.len() == 1);
}

#[test]
fn damage_is_asked_for_anew_and_then_reported() {
    let requests = Fixture::get().requests();
    let faulty = FaultySource::new(Fixture::get().memory(), Faults::default(), 1);
    let mut source = RetriedSource::new(faulty, RetryOptions::default());
    fetch(&mut source, &requests[..1]);
    source.inner_mut().set_faults(Faults {
        damage: 1.0,
        ..Faults::default()
    });
    let column = &requests[1..2];
    let said = fetch(&mut source, column)
        .remove(0)
        .bytes
        .unwrap_err()
        .to_string();
    for part in [
        "cloth",
        &column[0].to_string(),
        "this program",
        "3 times",
        "checksum",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert_eq!((source.stats().damaged, source.stats().retried), (3, 2));
    source.inner_mut().set_faults(Faults::default());
    assert!(fetch(&mut source, column)[0].bytes.is_ok());
}
