//! Asks again: after failures that may pass, with pauses that grow, and for what came damaged.

#[cfg(test)]
mod tests;

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
                    Err(error) => Verdict::Stands(Err(error), false),
                };
            }
        };
        self.reached = true;
        let checked = self.directories.check(&open.request, &bytes);
        let Some(Err(error)) = checked else {
            return Verdict::Stands(Ok(bytes), checked.is_some());
        };
        self.damaged += 1;
        open.damaged += 1;
        if open.damaged < self.options.damaged_attempts {
            return Verdict::Again(Duration::ZERO);
        }
        let damaged = Error::Source {
            what: format!("{}, from {}", open.request, self.inner.origin()),
            detail: format!("it came damaged {} times in a row: {error}", open.damaged),
        };
        Verdict::Stands(Err(damaged), false)
    }
}

/// What is done with an answer.
enum Verdict {
    /// It is passed on, checked or not.
    Stands(Result<Bytes>, bool),
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
                Verdict::Stands(bytes, checked) => {
                    return Some(Answer {
                        ticket,
                        request: open.request,
                        bytes,
                        checked,
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
