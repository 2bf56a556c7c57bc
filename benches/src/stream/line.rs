//! The source of a replay: answers at once, then a simulated network, and a log of what came.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::{Duration, Instant};

use engine::stream::{Answer, Network, NetworkSource, NetworkStats, Request, Ticket, TileSource};

/// Longest time that a source may owe answers.
const PATIENCE: Duration = Duration::from_secs(60);
/// Of losses, jitter and order.
const SEED: u64 = 1;

/// Waits for all answers of the source inside and hands them out in the order of the requests, so that its own threads
/// and caches do not show. Each answer costs its bytes.
struct AtOnce {
    inner: Box<dyn TileSource>,
    answers: VecDeque<Answer>,
    /// Indices cost no bytes.
    free_indices: bool,
}

impl AtOnce {
    fn collect(&mut self) {
        let start = Instant::now();
        let mut answers = Vec::new();
        while self.inner.in_flight() > 0 && start.elapsed() < PATIENCE {
            match self.inner.poll() {
                Some(answer) => answers.push(answer),
                None => self.inner.wait(Duration::from_millis(100)),
            }
        }
        answers.sort_by_key(|answer| answer.ticket);
        for mut answer in answers {
            let is_free = self.free_indices && matches!(answer.request, Request::Index { .. });
            answer.wire_bytes = match &answer.bytes {
                Ok(bytes) if !is_free => bytes.len() as u64,
                _ => 0,
            };
            self.answers.push_back(answer);
        }
    }
}

impl TileSource for AtOnce {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.inner.in_flight() + self.answers.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.inner.submit(request)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.inner.cancel(ticket);
        self.answers.retain(|answer| answer.ticket != ticket);
    }

    fn poll(&mut self) -> Option<Answer> {
        if self.answers.is_empty() {
            self.collect();
        }
        self.answers.pop_front()
    }

    fn wait(&mut self, _limit: Duration) {}
}

struct Ends {
    source: NetworkSource<AtOnce>,
    came: Vec<(Request, u64)>,
}

/// Both ends of a line: the engine has one, the replay the other.
#[derive(Clone)]
pub(crate) struct Line(Rc<RefCell<Ends>>);

impl Line {
    pub(crate) fn new(inner: Box<dyn TileSource>, network: Network) -> Self {
        Self::with_indices(inner, network, false)
    }

    /// The same, where indices may cost no bytes.
    pub(crate) fn with_indices(inner: Box<dyn TileSource>, network: Network, free_indices: bool) -> Self {
        let at_once = AtOnce {
            inner,
            answers: VecDeque::new(),
            free_indices,
        };
        Self(Rc::new(RefCell::new(Ends {
            source: NetworkSource::new(at_once, network, SEED),
            came: Vec::new(),
        })))
    }

    /// Time goes on.
    pub(crate) fn advance(&self, time: Duration) {
        self.0.borrow_mut().source.advance(time);
    }

    pub(crate) fn stats(&self) -> NetworkStats {
        self.0.borrow().source.network_stats()
    }

    /// Bytes that the line has carried to where somebody polled them, or wanted to.
    pub(crate) fn bytes(&self) -> u64 {
        let stats = self.stats();
        stats.delivered_bytes + stats.wasted_bytes
    }

    /// What was asked for and came, with its bytes.
    pub(crate) fn came(&self) -> Vec<(Request, u64)> {
        self.came_since(0)
    }

    /// Forgets what came, for those who go on without an end.
    pub(crate) fn forget(&self) {
        self.0.borrow_mut().came.clear();
    }

    /// The same without the first `count`.
    pub(crate) fn came_since(&self, count: usize) -> Vec<(Request, u64)> {
        self.0.borrow().came[count..].to_vec()
    }
}

impl TileSource for Line {
    fn capacity(&self) -> usize {
        self.0.borrow().source.capacity()
    }

    fn in_flight(&self) -> usize {
        self.0.borrow().source.in_flight()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.0.borrow_mut().source.submit(request)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.0.borrow_mut().source.cancel(ticket);
    }

    fn poll(&mut self) -> Option<Answer> {
        let mut ends = self.0.borrow_mut();
        let answer = ends.source.poll()?;
        ends.came.push((answer.request.clone(), answer.wire_bytes));
        Some(answer)
    }

    fn wait(&mut self, limit: Duration) {
        self.0.borrow_mut().source.wait(limit);
    }
}
