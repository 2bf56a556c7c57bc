//! Requests in flight and the answers that workers send back: what the sources with a thread have in common.

use std::{
    collections::{HashMap, VecDeque},
    sync::mpsc::{Receiver, Sender, channel},
    time::Duration,
};

use super::{Answer, Ticket};

/// Requests in flight, each with what it takes to give it up (`T`), and their answers.
///
/// The channel is unbounded so that a worker never waits for the engine, but what it holds is bounded: a request
/// is answered once, at most `capacity` are open, and answers to requests that were given up are thrown
/// away whenever the next request comes.
pub(super) struct Inbox<T> {
    capacity: usize,
    next: u64,
    open: HashMap<Ticket, T>,
    ready: VecDeque<Answer>,
    sender: Sender<Answer>,
    receiver: Receiver<Answer>,
}

impl<T> Inbox<T> {
    pub(super) fn new(capacity: usize) -> Self {
        let (sender, receiver) = channel();
        Self {
            capacity,
            next: 0,
            open: HashMap::new(),
            ready: VecDeque::new(),
            sender,
            receiver,
        }
    }

    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    pub(super) fn in_flight(&self) -> usize {
        self.open.len()
    }

    /// Where a worker sends its answers.
    pub(super) fn sender(&self) -> Sender<Answer> {
        self.sender.clone()
    }

    /// Opens a request, unless the capacity is used up; `start` begins the work and returns what ends it.
    pub(super) fn open(&mut self, start: impl FnOnce(Ticket) -> T) -> Option<Ticket> {
        if self.open.len() >= self.capacity {
            return None;
        }
        self.collect();
        let ticket = Ticket(self.next);
        self.next += 1;
        self.open.insert(ticket, start(ticket));
        Some(ticket)
    }

    /// Gives a request up and drops its answer, if that is here already.
    pub(super) fn give_up(&mut self, ticket: Ticket) -> Option<T> {
        let ended = self.open.remove(&ticket)?;
        self.ready.retain(|answer| answer.ticket != ticket);
        Some(ended)
    }

    /// Takes what is in the channel, and drops what nobody waits for any more.
    fn collect(&mut self) {
        while let Ok(answer) = self.receiver.try_recv() {
            self.accept(answer);
        }
    }

    fn accept(&mut self, answer: Answer) {
        if self.open.contains_key(&answer.ticket) {
            self.ready.push_back(answer);
        }
    }

    pub(super) fn poll(&mut self) -> Option<Answer> {
        self.collect();
        let answer = self.ready.pop_front()?;
        self.open.remove(&answer.ticket);
        Some(answer)
    }

    /// Whether an answer is here.
    pub(super) fn is_ready(&mut self) -> bool {
        self.collect();
        !self.ready.is_empty()
    }

    /// Waits for an answer to an open request, at most `limit`.
    pub(super) fn wait(&mut self, limit: Duration) {
        let begin = std::time::Instant::now();
        self.collect();
        while self.ready.is_empty() && !self.open.is_empty() {
            let left = limit.saturating_sub(begin.elapsed());
            match self.receiver.recv_timeout(left) {
                Ok(answer) => self.accept(answer),
                Err(_) => return,
            }
        }
    }

    /// What ends each open request.
    pub(super) fn drain(&mut self) -> impl Iterator<Item = T> + '_ {
        self.open.drain().map(|(_, ended)| ended)
    }
}
