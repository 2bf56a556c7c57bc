//! A source on a thread of its own, so that whatever it does in `submit` and `poll` holds up no frame: files, hashes, parsing.

use std::{
    collections::{HashMap, VecDeque},
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel},
    },
    time::{Duration, Instant},
};

use super::{Answer, Request, SourceStats, Ticket, TileSource, inbox::Inbox};
use crate::{Error, Result};

/// How long the thread waits for answers before it looks for further requests, while some are in flight.
const TICK: Duration = Duration::from_millis(1);

/// Runs a source on a thread of its own.
///
/// Requests that are submitted within a millisecond reach the source together.
pub struct BackgroundSource {
    inbox: Inbox<()>,
    orders: Sender<Order>,
    origin: String,
    stats: Arc<Mutex<SourceStats>>,
}

enum Order {
    Submit {
        ticket: Ticket,
        request: Request,
        anew: bool,
    },
    Cancel(Ticket),
}

impl BackgroundSource {
    /// Takes `inner` to a thread of its own.
    ///
    /// # Errors
    /// [`Error::Source`] if no thread can be started.
    pub fn new(inner: impl TileSource + Send + 'static) -> Result<Self> {
        let inbox = Inbox::new(inner.capacity());
        let (orders, received) = channel();
        let (origin, stats) = (inner.origin(), Arc::new(Mutex::new(inner.stats())));
        let worker = Worker {
            inner,
            orders: received,
            answers: inbox.sender(),
            waiting: VecDeque::new(),
            outer: HashMap::new(),
            stats: Arc::clone(&stats),
        };
        std::thread::Builder::new()
            .name("eigentile-source".into())
            .spawn(move || worker.run())
            .map_err(|error| Error::Source {
                what: "thread of a source".into(),
                detail: error.to_string(),
            })?;
        Ok(Self {
            inbox,
            orders,
            origin,
            stats,
        })
    }

    fn open(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        self.inbox.open(|ticket| {
            // Fails only if the thread has panicked; then no answer comes.
            let _ = self.orders.send(Order::Submit {
                ticket,
                request,
                anew,
            });
        })
    }
}

impl TileSource for BackgroundSource {
    fn capacity(&self) -> usize {
        self.inbox.capacity()
    }

    fn in_flight(&self) -> usize {
        self.inbox.in_flight()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.open(request, false)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.open(request, true)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if self.inbox.give_up(ticket).is_some() {
            let _ = self.orders.send(Order::Cancel(ticket));
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.inbox.poll()
    }

    fn wait(&mut self, limit: Duration) {
        self.inbox.wait(limit);
    }

    fn origin(&self) -> String {
        self.origin.clone()
    }

    fn stats(&self) -> SourceStats {
        *self.stats.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread's side.
struct Worker<S> {
    inner: S,
    orders: Receiver<Order>,
    answers: Sender<Answer>,
    /// Requests that the inner source has not taken: its capacity is used up until what was given up is known to it.
    waiting: VecDeque<(Ticket, Request, bool)>,
    /// Tickets of the caller by those of the inner source.
    outer: HashMap<Ticket, Ticket>,
    stats: Arc<Mutex<SourceStats>>,
}

impl<S: TileSource> Worker<S> {
    fn run(mut self) {
        loop {
            // Nothing to do: until there is an order.
            if self.outer.is_empty() && self.waiting.is_empty() {
                match self.orders.recv() {
                    Ok(order) => self.follow(order),
                    Err(_) => return,
                }
            }
            loop {
                match self.orders.try_recv() {
                    Ok(order) => self.follow(order),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return,
                }
            }
            self.submit();
            let mut came = false;
            while let Some(answer) = self.inner.poll() {
                came = true;
                if !self.pass_on(answer) {
                    return;
                }
            }
            self.count();
            if came || self.outer.is_empty() {
                continue;
            }
            let begin = Instant::now();
            self.inner.wait(TICK);
            // Some sources have nothing to wait for, and yet no answer.
            let left = TICK.saturating_sub(begin.elapsed());
            if let Some(answer) = self.inner.poll() {
                if !self.pass_on(answer) {
                    return;
                }
            } else if !left.is_zero() {
                match self.orders.recv_timeout(left) {
                    Ok(order) => self.follow(order),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            }
        }
    }

    fn follow(&mut self, order: Order) {
        match order {
            Order::Submit {
                ticket,
                request,
                anew,
            } => self.waiting.push_back((ticket, request, anew)),
            Order::Cancel(ticket) => {
                self.waiting.retain(|(waiting, ..)| *waiting != ticket);
                let inner = self.outer.iter().find(|(_, outer)| **outer == ticket);
                if let Some(inner) = inner.map(|(inner, _)| *inner) {
                    self.outer.remove(&inner);
                    self.inner.cancel(inner);
                }
            }
        }
    }

    fn submit(&mut self) {
        while let Some((ticket, request, anew)) = self.waiting.pop_front() {
            let inner = match anew {
                true => self.inner.submit_anew(request.clone()),
                false => self.inner.submit(request.clone()),
            };
            match inner {
                Some(inner) => _ = self.outer.insert(inner, ticket),
                None => return self.waiting.push_front((ticket, request, anew)),
            }
        }
    }

    fn count(&self) {
        *self.stats.lock().unwrap_or_else(PoisonError::into_inner) = self.inner.stats();
    }

    /// Returns whether anybody listens.
    fn pass_on(&mut self, answer: Answer) -> bool {
        // First, so that who has an answer sees it counted.
        self.count();
        // Repeated, or given up.
        let Some(ticket) = self.outer.remove(&answer.ticket) else {
            return true;
        };
        self.answers.send(Answer { ticket, ..answer }).is_ok()
    }
}
