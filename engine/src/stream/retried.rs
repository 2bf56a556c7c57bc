//! Asks again: after failures that may pass, with pauses that grow, and for what came damaged.

use std::{collections::HashMap, time::Duration};

use bytes::Bytes;

use super::{Answer, Request, SourceStats, Ticket, TileSource, directories::Directories, random::SplitMix64};
use crate::{Error, Result};

/// How a [`RetriedSource`] asks again. Defaults work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RetryOptions {
    /// How often a request is tried in all, at least once, once the source has answered anything: a server that is started
    /// again has until then to come back.
    pub attempts: u32,
    /// The same while it has never answered: it may not be there at all, which should be said soon.
    pub first_attempts: u32,
    /// How often a record that comes damaged is tried in all.
    pub damaged_attempts: u32,
    /// Pause before the second attempt, at most; each further one is twice as long.
    pub backoff: Duration,
    /// Longest pause.
    pub longest_backoff: Duration,
    /// Longest pause that a host may ask for with `Retry-After`; if it asks for more, its failure stands.
    pub longest_retry_after: Duration,
    /// For the jitter of the pauses.
    pub seed: u64,
}

impl Default for RetryOptions {
    fn default() -> Self {
        Self {
            attempts: 8, // within 10 s, as the pauses add up
            first_attempts: 4,
            damaged_attempts: 3,
            backoff: Duration::from_millis(100),
            longest_backoff: Duration::from_secs(4),
            longest_retry_after: Duration::from_secs(30),
            seed: 0,
        }
    }
}

/// Time since some moment. Browsers have a clock of their own.
type Clock = Box<dyn FnMut() -> Duration + Send>;

/// Passes a source's answers on when they hold, and asks it again when they do not.
///
/// Every record is checked here against its hash in the index that came before it, and an index against its own. Whatever
/// keeps records stands outside of this, so that nothing unchecked is kept, and asking again goes past it. Records of archives whose
/// index was never asked for cannot be checked, and are passed on as they came.
///
/// [`Error::Unavailable`] is tried again after a pause: half to all of a length that doubles, by chance, so that programs that
/// failed together do not come back together (Brooker: Exponential Backoff And Jitter, 2015, "equal jitter"), and never
/// before the host's `Retry-After`. After the last attempt its error stands. All other errors stand at once.
pub struct RetriedSource<S> {
    inner: S,
    options: RetryOptions,
    clock: Clock,
    random: SplitMix64,
    /// Drawn anew whenever something is sent again: requests that fail together come back together, and can share
    /// an exchange as before. It is other programs that must not come at the same time.
    jitter: f64,
    next: u64,
    open: HashMap<Ticket, Open>,
    /// Requests that the inner source has, by its tickets.
    sent: HashMap<Ticket, Ticket>,
    directories: Directories,
    /// The source has answered something.
    reached: bool,
    retried: u64,
    damaged: u64,
}

/// A request, and what came of it so far.
struct Open {
    request: Request,
    failed: u32,
    damaged: u32,
    wire_bytes: u64,
    /// When it is to be sent again; `None` while the inner source has it.
    due: Option<Duration>,
}

#[cfg(not(target_arch = "wasm32"))]
impl<S: TileSource> RetriedSource<S> {
    /// Asks `inner` again as `options` say, by the clock of this machine.
    pub fn new(inner: S, options: RetryOptions) -> Self {
        let start = std::time::Instant::now();
        Self::with_clock(inner, options, Box::new(move || start.elapsed()))
    }
}

impl<S: TileSource> RetriedSource<S> {
    /// As [`RetriedSource::new`], by this clock: time since any moment, which never goes back.
    pub fn with_clock(inner: S, options: RetryOptions, clock: Box<dyn FnMut() -> Duration + Send>) -> Self {
        let mut random = SplitMix64(options.seed);
        Self {
            inner,
            options,
            clock,
            jitter: random.unit(),
            random,
            next: 0,
            open: HashMap::new(),
            sent: HashMap::new(),
            directories: Directories::default(),
            reached: false,
            retried: 0,
            damaged: 0,
        }
    }

    /// The source that is asked.
    pub fn inner_mut(&mut self) -> &mut S {
        &mut self.inner
    }

    fn begin(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        if self.open.len() >= self.capacity() {
            return None;
        }
        let sent = match anew {
            true => self.inner.submit_anew(request.clone()),
            false => self.inner.submit(request.clone()),
        }?;
        let ticket = Ticket(self.next);
        self.next += 1;
        self.sent.insert(sent, ticket);
        self.open.insert(
            ticket,
            Open {
                request,
                failed: 0,
                damaged: 0,
                wire_bytes: 0,
                due: None,
            },
        );
        Some(ticket)
    }

    /// Sends what is due, the oldest first.
    fn send_again(&mut self) {
        if self.sent.len() == self.open.len() {
            return;
        }
        let now = (self.clock)();
        let waiting = self
            .open
            .iter()
            .filter_map(|(ticket, open)| Some((*ticket, open.due?)));
        let mut due: Vec<Ticket> = waiting
            .filter_map(|(ticket, due)| (due <= now).then_some(ticket))
            .collect();
        due.sort_unstable();
        if !due.is_empty() {
            self.jitter = self.random.unit();
        }
        for ticket in due {
            let Some(open) = self.open.get_mut(&ticket) else {
                continue;
            };
            let sent = match open.damaged > 0 {
                true => self.inner.submit_anew(open.request.clone()),
                false => self.inner.submit(open.request.clone()),
            };
            let Some(sent) = sent else { return };
            open.due = None;
            self.retried += 1;
            self.sent.insert(sent, ticket);
        }
    }

    /// The pause before the next attempt, or the error if there is none.
    fn pause(&mut self, open: &mut Open, error: Error) -> Result<Duration> {
        let Error::Unavailable { retry_after, .. } = &error else {
            return Err(error);
        };
        open.failed += 1;
        let attempts = match self.reached {
            true => self.options.attempts,
            false => self.options.first_attempts,
        };
        let asked = retry_after.unwrap_or_default();
        if open.failed >= attempts || asked > self.options.longest_retry_after {
            return Err(after(error, open.failed));
        }
        let doubled = 1u32.checked_shl(open.failed - 1).unwrap_or(u32::MAX);
        let longest = self
            .options
            .backoff
            .saturating_mul(doubled)
            .min(self.options.longest_backoff);
        let jitter = longest.mul_f64(0.5 + 0.5 * self.jitter);
        Ok(jitter.max(asked))
    }

    /// Checks what came.
    fn judge(&mut self, open: &mut Open, bytes: Result<Bytes>) -> Verdict {
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(error) => {
                self.reached |= !matches!(error, Error::Unavailable { .. });
                return match self.pause(open, error) {
                    Ok(pause) => Verdict::Again(pause),
                    Err(error) => Verdict::Stands(Err(error)),
                };
            }
        };
        self.reached = true;
        let Some(Err(error)) = self.directories.check(&open.request, &bytes) else {
            return Verdict::Stands(Ok(bytes));
        };
        self.damaged += 1;
        open.damaged += 1;
        if open.damaged < self.options.damaged_attempts {
            return Verdict::Again(Duration::ZERO);
        }
        Verdict::Stands(Err(Error::Source {
            what: format!("{}, from {}", open.request, self.inner.origin()),
            detail: format!("it came damaged {} times in a row: {error}", open.damaged),
        }))
    }
}

/// What is done with an answer.
enum Verdict {
    /// It is passed on.
    Stands(Result<Bytes>),
    /// The request is sent again after a pause.
    Again(Duration),
}

/// The same failure, with how often it was tried.
fn after(error: Error, attempts: u32) -> Error {
    match error {
        Error::Unavailable {
            what,
            detail,
            retry_after,
        } => Error::Unavailable {
            what,
            detail: format!("{detail} (after {attempts} attempts)"),
            retry_after,
        },
        other => other,
    }
}

impl<S: TileSource> TileSource for RetriedSource<S> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.begin(request, false)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.begin(request, true)
    }

    fn cancel(&mut self, ticket: Ticket) {
        let Some(open) = self.open.remove(&ticket) else {
            return;
        };
        if open.due.is_none()
            && let Some(sent) = self.sent.iter().find(|(_, outer)| **outer == ticket)
        {
            let sent = *sent.0;
            self.sent.remove(&sent);
            self.inner.cancel(sent);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.send_again();
        while let Some(answer) = self.inner.poll() {
            // Given up, or come before: nobody waits for it.
            let Some(ticket) = self.sent.remove(&answer.ticket) else {
                continue;
            };
            let Some(mut open) = self.open.remove(&ticket) else {
                continue;
            };
            open.wire_bytes += answer.wire_bytes;
            match self.judge(&mut open, answer.bytes) {
                Verdict::Stands(bytes) => {
                    return Some(Answer {
                        ticket,
                        request: open.request,
                        bytes,
                        wire_bytes: open.wire_bytes,
                    });
                }
                Verdict::Again(pause) => {
                    open.due = Some((self.clock)() + pause);
                    self.open.insert(ticket, open);
                }
            }
        }
        self.send_again();
        None
    }

    fn wait(&mut self, limit: Duration) {
        if self.open.is_empty() {
            return;
        }
        let now = (self.clock)();
        let next = self.open.values().filter_map(|open| open.due).min();
        let limit = next.map_or(limit, |due| limit.min(due.saturating_sub(now)));
        if self.inner.in_flight() > 0 {
            self.inner.wait(limit);
        } else {
            #[cfg(not(target_arch = "wasm32"))]
            std::thread::sleep(limit);
        }
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    fn stats(&self) -> SourceStats {
        let stats = self.inner.stats();
        SourceStats {
            retried: stats.retried + self.retried,
            damaged: stats.damaged + self.damaged,
            ..stats
        }
    }
}

#[cfg(test)]
mod tests {
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
}
