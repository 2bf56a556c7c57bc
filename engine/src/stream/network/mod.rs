//! A network in simulated time: the same on every machine, by seed.
//!
//! A request takes half a round trip to the server, after a handshake on a connection that is new. There answers queue up for
//! the one line that all connections share, in the order in which their requests arrived, and each has the whole line while
//! its bytes go out. The last byte lands half a round trip later. Lost segments take the line again and a round trip more, in
//! which nothing else lands on that connection. Congestion control is left out: the line is taken to be as wide as it is said to
//! be from the first byte on.
//!
//! `line`: what a network is like. `transfer`: an answer on its way.

mod line;
mod transfer;

use std::{
    collections::{BTreeSet, VecDeque},
    time::Duration,
};

use serde::Serialize;

pub use line::Network;
use transfer::{Connection, Fate, Landing, Transfer};

use super::{Answer, Request, SourceStats, Ticket, TileSource, random::SplitMix64};

/// Most connections.
const MOST_CONNECTIONS: usize = 256;

/// What a line has carried since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct NetworkStats {
    /// Bytes of answers that were polled: headers, and what was lost and sent again, included.
    pub delivered_bytes: u64,
    /// Bytes that had left the server for requests that were given up.
    pub wasted_bytes: u64,
    /// Bytes of requests that were given up that never left it, as far as they are known.
    pub saved_bytes: u64,
    /// Bytes that were sent again because segments were lost.
    pub resent_bytes: u64,
}

/// Delivers answers of the inner source when and in what order a network would.
///
/// There is no clock: time goes on with [`NetworkSource::advance`]. Answers that cost nothing, from a cache behind the network,
/// come at once.
pub struct NetworkSource<S> {
    inner: S,
    network: Network,
    random: SplitMix64,
    /// Nanoseconds; the line has been simulated until `line`.
    now: u64,
    line: u64,
    open: BTreeSet<Ticket>,
    /// In the order of submission.
    transfers: VecDeque<Transfer>,
    connections: Vec<Connection>,
    landings: Vec<Landing>,
    landed: VecDeque<(Answer, u64)>,
    stats: NetworkStats,
}

impl<S: TileSource> NetworkSource<S> {
    /// A network before a source. The same seed, network and calls give the same times.
    pub fn new(inner: S, network: Network, seed: u64) -> Self {
        let connections = network.connections.clamp(1, MOST_CONNECTIONS);
        Self {
            inner,
            network,
            random: SplitMix64(seed),
            now: 0,
            line: 0,
            open: BTreeSet::new(),
            transfers: VecDeque::new(),
            connections: vec![Connection::default(); connections],
            landings: Vec::new(),
            landed: VecDeque::new(),
            stats: NetworkStats::default(),
        }
    }

    /// Time goes on by this much, at most an hour.
    pub fn advance(&mut self, time: Duration) {
        self.collect();
        self.run_until(self.now.saturating_add(line::nanoseconds(time)));
    }

    /// Simulated time since the start.
    pub fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.now)
    }

    /// What the line has carried.
    pub fn network_stats(&self) -> NetworkStats {
        self.stats
    }

    /// The source behind the network.
    pub fn inner_mut(&mut self) -> &mut S {
        &mut self.inner
    }

    /// Sends what waits for a connection, the connection with the fewest requests first.
    fn send(&mut self, now: u64) {
        let streams = self.network.streams.max(1);
        for transfer in &mut self.transfers {
            if transfer.connection.is_some() {
                continue;
            }
            let numbered = self.connections.iter_mut().enumerate();
            let free = numbered.filter(|(_, connection)| connection.busy < streams);
            let Some((at, connection)) = free.min_by_key(|(at, connection)| (connection.busy, *at)) else {
                break;
            };
            transfer.connection = Some(at);
            transfer.ready = connection.send(now, self.network.trip());
        }
    }

    /// Takes from the inner source what it has: no more than is in flight.
    fn collect(&mut self) {
        while let Some(answer) = self.inner.poll() {
            let waiting = self.transfers.iter().position(|transfer| {
                transfer.ticket == answer.ticket && transfer.answer.is_none() && transfer.stop == u64::MAX
            });
            let Some(at) = waiting else { continue };
            let cached = answer.wire_bytes == 0 && answer.bytes.as_ref().is_ok_and(|bytes| !bytes.is_empty());
            if cached {
                self.drop_transfer(at, self.now);
                self.landed.push_back((answer, 0));
                continue;
            }
            let whole = answer.wire_bytes + self.network.header_bytes;
            let fate = Fate::draw(&self.network, whole, &mut self.random);
            let transfer = &mut self.transfers[at];
            transfer.fate = fate;
            transfer.bytes = whole + fate.resent_bytes;
            transfer.length = self.network.nanoseconds(transfer.bytes);
            transfer.left = transfer.length;
            if transfer.connection.is_some() {
                // A source that takes real time answers later than the simulated server could.
                transfer.ready = transfer.ready.max(self.now);
            }
            transfer.answer = Some(answer);
        }
    }

    fn drop_transfer(&mut self, at: usize, now: u64) -> Option<Transfer> {
        let transfer = self.transfers.remove(at)?;
        if let Some(connection) = transfer.connection {
            self.connections[connection].busy -= 1;
            self.send(now);
        }
        Some(transfer)
    }

    /// The transfer that has the line, or is the next to have it.
    fn next_on_line(&self) -> Option<usize> {
        let numbered = self.transfers.iter().enumerate();
        let sendable =
            numbered.filter(|(_, transfer)| transfer.connection.is_some() && transfer.answer.is_some());
        let first = sendable.min_by_key(|(_, transfer)| (!transfer.started, transfer.ready, transfer.ticket));
        first.map(|(at, _)| at)
    }

    /// What happens until then, in its order.
    fn run_until(&mut self, end: u64) {
        loop {
            let landing =
                (0..self.landings.len()).min_by_key(|&at| (self.landings[at].due, self.landings[at].ticket));
            let landing = landing.map(|at| (self.landings[at].due, at));
            let sending = self.next_on_line().map(|at| {
                let transfer = &self.transfers[at];
                let start = self.line.max(transfer.ready);
                let sent = start.saturating_add(transfer.left);
                (sent.min(transfer.stop.max(start)), start, at)
            });
            match (landing, sending) {
                (Some((due, at)), _) if due <= end && sending.is_none_or(|(sent, ..)| due <= sent) => {
                    self.now = self.now.max(due);
                    self.land(at);
                }
                (_, Some((sent, start, at))) if sent <= end => self.finish(at, start, sent),
                (_, Some((_, start, at))) if start < end => {
                    let transfer = &mut self.transfers[at];
                    transfer.started = true;
                    transfer.left -= end - start;
                    self.line = end;
                    break;
                }
                _ => break,
            }
        }
        self.now = self.now.max(end);
    }

    /// A transfer leaves the line: all of it has been sent, or it was stopped.
    fn finish(&mut self, at: usize, start: u64, sent: u64) {
        let transfer = &mut self.transfers[at];
        let (left, whole) = (transfer.left, start.saturating_add(transfer.left) == sent);
        let stopped = !whole || transfer.stop <= start;
        transfer.left -= (sent - start).min(left);
        transfer.started |= sent > start || !stopped;
        self.line = sent;
        let Some(transfer) = (if stopped {
            self.drop_transfer(at, sent)
        } else {
            self.transfers.remove(at)
        }) else {
            return;
        };
        if stopped {
            self.give_up(&transfer);
            return;
        }
        self.stats.resent_bytes += transfer.fate.resent_bytes;
        let connection = transfer.connection.unwrap_or(0);
        let in_order = &mut self.connections[connection].in_order;
        *in_order = (*in_order).max(sent + self.network.trip() / 2 + transfer.fate.held_up);
        self.landings.push(Landing {
            due: *in_order + transfer.fate.overtaken,
            ticket: transfer.ticket,
            connection,
            answer: transfer.answer.filter(|_| transfer.stop == u64::MAX),
            bytes: transfer.bytes,
        });
    }

    /// Counts what a transfer that nobody wants has cost.
    fn give_up(&mut self, transfer: &Transfer) {
        let sent = transfer.sent();
        self.stats.wasted_bytes += sent;
        self.stats.saved_bytes += transfer.bytes - sent;
    }

    fn land(&mut self, at: usize) {
        let landing = self.landings.swap_remove(at);
        self.connections[landing.connection].busy -= 1;
        match landing.answer {
            Some(answer) => self.landed.push_back((answer, landing.bytes)),
            None => self.stats.wasted_bytes += landing.bytes,
        }
        self.send(landing.due);
    }

    fn took(&mut self, ticket: Option<Ticket>) -> Option<Ticket> {
        let ticket = ticket?;
        self.open.insert(ticket);
        self.transfers.push_back(Transfer::new(ticket));
        self.send(self.now);
        Some(ticket)
    }
}

impl<S: TileSource> TileSource for NetworkSource<S> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit(request);
        self.took(ticket)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit_anew(request);
        self.took(ticket)
    }

    /// The server learns of it half a round trip later: what has left it until then is wasted, the rest is not sent.
    fn cancel(&mut self, ticket: Ticket) {
        self.collect();
        self.inner.cancel(ticket);
        if !self.open.remove(&ticket) {
            return;
        }
        if let Some(at) = self.landed.iter().position(|(answer, _)| answer.ticket == ticket) {
            let bytes = self.landed.remove(at).map_or(0, |(_, bytes)| bytes);
            self.stats.wasted_bytes += bytes;
        } else if let Some(landing) = self.landings.iter_mut().find(|landing| landing.ticket == ticket) {
            landing.answer = None;
        } else if let Some(at) = self
            .transfers
            .iter()
            .position(|transfer| transfer.ticket == ticket)
        {
            let stop = self.now + self.network.trip() / 2;
            let transfer = &mut self.transfers[at];
            let begins = transfer.ready.max(self.line);
            if transfer.answer.is_none() || (!transfer.started && begins >= stop) {
                if let Some(transfer) = self.drop_transfer(at, self.now) {
                    self.give_up(&transfer);
                }
            } else {
                transfer.stop = stop;
            }
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.collect();
        self.run_until(self.now);
        let (mut answer, bytes) = self.landed.pop_front()?;
        self.open.remove(&answer.ticket);
        answer.wire_bytes = bytes;
        self.stats.delivered_bytes += bytes;
        Some(answer)
    }

    /// Waits for the inner source while it owes an answer. What is on its way comes with simulated time, not with this.
    fn wait(&mut self, limit: Duration) {
        self.collect();
        if self.landed.is_empty() && self.transfers.iter().any(|transfer| transfer.answer.is_none()) {
            self.inner.wait(limit);
        }
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    /// Bytes are those that the network delivered.
    fn stats(&self) -> SourceStats {
        SourceStats {
            wire_bytes: self.stats.delivered_bytes,
            ..self.inner.stats()
        }
    }
}

#[cfg(test)]
mod tests;
