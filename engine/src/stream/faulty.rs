//! Failures on purpose, for tests: whatever the network can do wrong, the same way every time.

use std::{collections::HashSet, time::Duration};

use super::{Answer, Request, SourceStats, Ticket, TileSource, random::SplitMix64};
use crate::Error;

/// Chances, between 0 and 1, of what happens to an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// The answer is an error instead.
    pub fail: f64,
    /// The answer never comes; its request is in flight until it is cancelled.
    pub lose: f64,
    /// The answer comes twice, the second one unasked.
    pub repeat: f64,
    /// A byte of the answer is wrong.
    pub damage: f64,
    /// The answer is overtaken by later ones.
    pub reorder: f64,
    /// An answer is held back for up to this many calls of `poll`.
    pub delay_polls: u64,
}

/// Passes answers of the inner source on with the given faults; the same seed and calls give the same faults.
pub struct FaultySource<S> {
    inner: S,
    faults: Faults,
    random: SplitMix64,
    polls: u64,
    open: HashSet<Ticket>,
    /// Answers and the poll at which each may come.
    held: Vec<(u64, Answer)>,
}

impl<S: TileSource> FaultySource<S> {
    /// A faulty line to `inner`.
    pub fn new(inner: S, faults: Faults, seed: u64) -> Self {
        Self {
            inner,
            faults,
            random: SplitMix64(seed),
            polls: 0,
            open: HashSet::new(),
            held: Vec::new(),
        }
    }

    /// Changes the faults for answers that are still to come.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// The source behind the faults.
    pub fn inner_mut(&mut self) -> &mut S {
        &mut self.inner
    }

    fn take(&mut self, mut answer: Answer) {
        // Every answer draws the same number of times, so that one chance does not shift all others.
        let [fail, lose, repeat, damage, reorder] = std::array::from_fn(|_| self.random.unit());
        let (place, delay) = (self.random.next(), self.random.next());
        if lose < self.faults.lose {
            return;
        }
        if fail < self.faults.fail {
            let what = answer.request.to_string();
            answer.bytes = Err(Error::Unavailable {
                what,
                detail: "failed on purpose".into(),
                retry_after: None,
            });
        } else if damage < self.faults.damage {
            answer.checked = false;
            answer.bytes = answer.bytes.map(|bytes| {
                let mut bytes = Vec::from(bytes);
                if let Some(at) = place.checked_rem(bytes.len() as u64) {
                    bytes[at as usize] ^= 1 << (place >> 61);
                }
                bytes.into()
            });
        }
        let due = self.polls + delay % (self.faults.delay_polls + 1);
        if repeat < self.faults.repeat && self.held.len() < 2 * self.capacity() {
            self.held.push((due, again(&answer)));
        }
        let at = if reorder < self.faults.reorder {
            place as usize % (self.held.len() + 1)
        } else {
            self.held.len()
        };
        self.held.insert(at, (due, answer));
    }
}

/// The same answer once more.
fn again(answer: &Answer) -> Answer {
    Answer {
        ticket: answer.ticket,
        request: answer.request.clone(),
        bytes: match &answer.bytes {
            Ok(bytes) => Ok(bytes.clone()),
            Err(error) => Err(worded_again(error, &answer.request)),
        },
        checked: answer.checked,
        wire_bytes: answer.wire_bytes,
    }
}

/// Errors cannot be cloned: the same kind for those that callers decide on.
fn worded_again(error: &Error, request: &Request) -> Error {
    match error {
        Error::NotFound(what) => Error::NotFound(what.clone()),
        Error::Archive(tileset::Error::NotFound { .. }) => Error::NotFound(request.to_string()),
        Error::Unavailable {
            what,
            detail,
            retry_after,
        } => Error::Unavailable {
            what: what.clone(),
            detail: detail.clone(),
            retry_after: *retry_after,
        },
        other => Error::Source {
            what: request.to_string(),
            detail: other.to_string(),
        },
    }
}

impl<S: TileSource> TileSource for FaultySource<S> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.open.len() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit(request)?;
        self.open.insert(ticket);
        Some(ticket)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        if self.open.len() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit_anew(request)?;
        self.open.insert(ticket);
        Some(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.inner.cancel(ticket);
        self.open.remove(&ticket);
        self.held.retain(|(_, answer)| answer.ticket != ticket);
    }

    fn poll(&mut self) -> Option<Answer> {
        self.polls += 1;
        while let Some(answer) = self.inner.poll() {
            self.take(answer);
        }
        let at = self.held.iter().position(|(due, _)| *due <= self.polls)?;
        let (_, answer) = self.held.remove(at);
        self.open.remove(&answer.ticket);
        Some(answer)
    }

    /// Waits for the inner source while nothing is held: what is held comes with polls, not with time.
    fn wait(&mut self, limit: Duration) {
        if self.held.is_empty() {
            self.inner.wait(limit);
        }
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    fn stats(&self) -> SourceStats {
        self.inner.stats()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::{super::conformance::Fixture, *};

    const ALL: Faults = Faults {
        fail: 0.2,
        lose: 0.2,
        repeat: 0.3,
        damage: 0.2,
        reorder: 0.5,
        delay_polls: 4,
    };

    /// Asks for everything once and polls for long enough; returns tickets and what became of them.
    fn observe(faults: Faults, seed: u64) -> Vec<(Ticket, String)> {
        let (fixture, requests) = (Fixture::get(), Fixture::get().requests());
        let mut source = FaultySource::new(fixture.memory(), faults, seed);
        let mut seen = Vec::new();
        for request in &requests {
            let ticket = source.submit(request.clone()).unwrap();
            for _ in 0..20 {
                seen.extend(source.poll().map(|answer| {
                    assert_eq!(&answer.request, request);
                    let outcome = match answer.bytes {
                        Ok(bytes) if bytes == fixture.expected(request) => "right",
                        Ok(bytes) => {
                            assert_eq!(bytes.len(), fixture.expected(request).len());
                            "damaged"
                        }
                        Err(_) => "failed",
                    };
                    (answer.ticket, outcome.to_owned())
                }));
            }
            source.cancel(ticket);
            assert_eq!(source.in_flight(), 0);
        }
        seen
    }

    #[test]
    fn all_faults_happen_and_the_same_ones_every_time() {
        let seen = observe(ALL, 1);
        assert_eq!(seen, observe(ALL, 1));
        assert_ne!(seen, observe(ALL, 2));
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        seen.iter()
            .for_each(|(_, outcome)| *counts.entry(outcome).or_default() += 1);
        assert_eq!(
            counts.keys().copied().collect::<Vec<_>>(),
            ["damaged", "failed", "right"]
        );
        let mut tickets: Vec<Ticket> = seen.iter().map(|(ticket, _)| *ticket).collect();
        tickets.sort_unstable();
        tickets.dedup();
        assert!(tickets.len() < Fixture::get().requests().len(), "some are lost");
        assert!(tickets.len() < seen.len(), "some come twice");
        assert!(
            observe(Faults::default(), 1)
                .iter()
                .all(|(_, outcome)| outcome == "right")
        );
    }

    #[test]
    fn answers_overtake_each_other() {
        let requests = Fixture::get().requests();
        let faults = Faults {
            reorder: 1.0,
            ..Faults::default()
        };
        let mut source = FaultySource::new(Fixture::get().memory(), faults, 3);
        let asked: Vec<_> = requests[..16]
            .iter()
            .map(|request| source.submit(request.clone()).unwrap())
            .collect();
        let mut came: Vec<_> = std::iter::from_fn(|| source.poll())
            .map(|answer| answer.ticket)
            .collect();
        assert_ne!(came, asked);
        came.sort_unstable();
        assert_eq!(came, asked);
    }
}
