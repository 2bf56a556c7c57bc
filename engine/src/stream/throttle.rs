//! A slow line, in simulated time: the same bytes come through on every machine.

use std::{
    collections::{HashMap, VecDeque},
    time::Duration,
};

use super::{Answer, Request, SourceStats, Ticket, TileSource};

/// Delivers answers of the inner source, in its order, while there is allowance for their bytes on the wire.
///
/// There is no clock. Either the caller says how many more bytes may come in all
/// ([`ThrottledSource::set_allowance`]: "stop after 5 % of the bytes"), or it simulates a line with one
/// [`ThrottledSource::advance`] a step.
pub struct ThrottledSource<S> {
    inner: S,
    allowance_bytes: u64,
    latency_steps: u64,
    step: u64,
    delivered_bytes: u64,
    submitted_at: HashMap<Ticket, u64>,
    held: VecDeque<Answer>,
}

impl<S: TileSource> ThrottledSource<S> {
    /// Nothing comes through yet, except answers that cost nothing.
    pub fn new(inner: S) -> Self {
        Self::with_latency(inner, 0)
    }

    /// As [`ThrottledSource::new`], and an answer comes at the earliest this many steps after its request.
    pub fn with_latency(inner: S, latency_steps: u64) -> Self {
        Self {
            inner,
            allowance_bytes: 0,
            latency_steps,
            step: 0,
            delivered_bytes: 0,
            submitted_at: HashMap::new(),
            held: VecDeque::new(),
        }
    }

    /// At most this many bytes on the wire come through from now on; [`u64::MAX`] lifts the limit. An answer
    /// that does not fit is held, and those behind it.
    pub fn set_allowance(&mut self, bytes: u64) {
        self.allowance_bytes = bytes;
    }

    /// Bytes on the wire that may still come through.
    pub fn allowance(&self) -> u64 {
        self.allowance_bytes
    }

    /// One step of simulated time, in which the line carries `bytes` bytes. While nothing is in flight a line
    /// carries nothing: what it could have carried is not saved up.
    pub fn advance(&mut self, bytes: u64) {
        self.step += 1;
        let idle = self.in_flight() == 0;
        self.allowance_bytes = if idle {
            bytes
        } else {
            self.allowance_bytes.saturating_add(bytes)
        };
    }

    /// Bytes on the wire that came through since the start.
    pub fn delivered_bytes(&self) -> u64 {
        self.delivered_bytes
    }

    /// The source behind the line.
    pub fn inner_mut(&mut self) -> &mut S {
        &mut self.inner
    }

    /// Takes from the inner source what it has: no more than is in flight.
    fn collect(&mut self) {
        while let Some(answer) = self.inner.poll() {
            self.held.push_back(answer);
        }
    }

    fn deliverable(&self) -> bool {
        self.held.front().is_some_and(|answer| {
            let submitted = self.submitted_at.get(&answer.ticket).copied().unwrap_or(0);
            answer.wire_bytes <= self.allowance_bytes && self.step - submitted >= self.latency_steps
        })
    }
}

impl<S: TileSource> TileSource for ThrottledSource<S> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.submitted_at.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit(request)?;
        self.submitted_at.insert(ticket, self.step);
        Some(ticket)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit_anew(request)?;
        self.submitted_at.insert(ticket, self.step);
        Some(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.inner.cancel(ticket);
        self.submitted_at.remove(&ticket);
        self.held.retain(|answer| answer.ticket != ticket);
    }

    fn poll(&mut self) -> Option<Answer> {
        self.collect();
        if !self.deliverable() {
            return None;
        }
        let answer = self.held.pop_front()?;
        self.submitted_at.remove(&answer.ticket);
        self.allowance_bytes -= answer.wire_bytes;
        self.delivered_bytes += answer.wire_bytes;
        Some(answer)
    }

    /// Waits for the inner source while nothing is held. What is held comes with the next step, not with time.
    fn wait(&mut self, limit: Duration) {
        self.collect();
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
    use super::{
        super::{
            CachedSource,
            conformance::{Fixture, fetch},
        },
        *,
    };

    /// Submits as much as fits and returns the bytes of what comes through.
    fn pump<S: TileSource>(
        source: &mut ThrottledSource<S>,
        requests: &mut std::slice::Iter<Request>,
    ) -> Vec<u64> {
        let mut came = Vec::new();
        loop {
            while source.in_flight() < source.capacity() && requests.len() > 0 {
                source.submit(requests.next().unwrap().clone()).unwrap();
            }
            match source.poll() {
                Some(answer) => came.push(answer.wire_bytes),
                None => return came,
            }
        }
    }

    #[test]
    fn an_allowance_is_never_exceeded_and_used_as_far_as_possible() {
        let requests = Fixture::get().requests();
        let all: u64 = fetch(&mut Fixture::get().memory(), &requests)
            .iter()
            .map(|answer| answer.wire_bytes)
            .sum();
        let mut before = 0;
        for percent in [0, 1, 5, 25, 100] {
            let mut source = ThrottledSource::new(Fixture::get().memory());
            let allowance = all * percent / 100;
            source.set_allowance(allowance);
            let came: u64 = pump(&mut source, &mut requests.iter()).iter().sum();
            assert!(came <= allowance && came == source.delivered_bytes());
            assert_eq!(source.allowance(), allowance - came);
            assert!(came >= before, "more is allowed, so more comes");
            let waiting = source.held.front().map_or(u64::MAX, |answer| answer.wire_bytes);
            assert!(waiting > allowance - came, "what fits comes");
            before = came;
        }
        assert_eq!(before, all, "all of the bytes are enough for all");
        assert!(before > 0);
    }

    #[test]
    fn a_line_carries_what_it_can_in_every_step() {
        let requests = Fixture::get().requests();
        let steps = |bandwidth| {
            let mut source = ThrottledSource::new(Fixture::get().memory());
            let mut requests = requests.iter();
            let mut carried = Vec::new();
            pump(&mut source, &mut requests);
            while source.in_flight() > 0 {
                source.advance(bandwidth);
                carried.push(pump(&mut source, &mut requests));
            }
            carried
        };
        let (slow, again, fast) = (steps(50), steps(50), steps(100));
        assert_eq!(slow, again, "the same every time");
        let bytes = |steps: &[Vec<u64>]| steps.iter().flatten().sum::<u64>();
        assert_eq!(bytes(&slow), bytes(&fast));
        assert_eq!(slow.len() as u64, bytes(&slow).div_ceil(50));
        assert_eq!(fast.len() as u64, bytes(&fast).div_ceil(100));
        assert!(slow.iter().any(Vec::is_empty), "large records take several steps");
    }

    #[test]
    fn answers_are_late_by_the_latency_and_an_idle_line_saves_nothing_up() {
        let requests = Fixture::get().requests();
        let mut source = ThrottledSource::with_latency(Fixture::get().memory(), 3);
        for _ in 0..100 {
            source.advance(1000);
        }
        assert_eq!(source.allowance(), 1000);
        source.submit(requests[1].clone()).unwrap();
        for step in 0..3 {
            assert!(source.poll().is_none(), "too early, step {step}");
            source.advance(0);
        }
        assert!(source.poll().is_some());
    }

    #[test]
    fn what_costs_nothing_comes_without_allowance() {
        let requests = Fixture::get().requests();
        let mut source = ThrottledSource::new(CachedSource::new(Fixture::get().memory(), 1 << 20));
        source.set_allowance(u64::MAX);
        assert_eq!(fetch(&mut source, &requests[..4]).len(), 4);
        source.set_allowance(0);
        assert_eq!(fetch(&mut source, &requests[1..4]).len(), 3);
    }
}
