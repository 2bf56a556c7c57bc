//! A network in simulated time: the same on every machine, by seed.
//!
//! Records of one archive that are submitted between two looks, or while all connections are busy, are asked for in one exchange, as
//! [`super::HttpSource`] does (`together` chooses for both). A request takes half a round trip to the server, after a handshake on
//! a connection that is new. Answers are a head, and frames with the records in the order asked. All connections share one line, record by
//! record: next is the answer that has had least of it since it began (Goyal, Vin, Cheng: Start-Time Fair Queueing, 1996), which is what
//! TCP comes to. A record is there when its last byte lands, half a round trip later. Lost segments take the line again and a round trip more, in
//! which nothing else lands on that connection. Congestion control is left out: the line is taken to be as wide as it is said to
//! be from the first byte on. An exchange is broken off when nobody waits for any of its records, and its connection stays.
//!
//! `line`: what a network is like. `transfer`: a record on its way, and its exchange.

mod line;
mod transfer;

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    time::Duration,
};

use serde::Serialize;

pub use line::Network;
use transfer::{Connection, Exchange, Landing, Stream, Transfer};

use super::{Answer, Request, SourceStats, Ticket, TileSource, random::SplitMix64, together::take_next};

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
    /// Not sent yet, in the order of submission.
    waiting: Vec<Transfer>,
    /// Sent, in the order in which they were.
    transfers: Vec<Transfer>,
    /// By number.
    exchanges: BTreeMap<u64, Exchange>,
    /// Exchanges so far.
    sent: u64,
    /// What the answer that last had the line had had of it before, as [`Exchange::share`].
    share: u64,
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
            waiting: Vec::new(),
            transfers: Vec::new(),
            exchanges: BTreeMap::new(),
            sent: 0,
            share: 0,
            connections: vec![Connection::default(); connections],
            landings: Vec::new(),
            landed: VecDeque::new(),
            stats: NetworkStats::default(),
        }
    }

    /// Time goes on by this much, at most an hour.
    pub fn advance(&mut self, time: Duration) {
        self.look();
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

    /// Takes what the inner source has, and sends what has been submitted.
    fn look(&mut self) {
        self.collect();
        self.send(self.now);
    }

    /// Sends what waits, as far as connections are free, on the connection with the fewest requests first.
    fn send(&mut self, now: u64) {
        let streams = self.network.streams.max(1);
        while !self.waiting.is_empty() {
            let numbered = self.connections.iter_mut().enumerate();
            let free = numbered.filter(|(_, connection)| connection.busy < streams);
            let Some((at, connection)) = free.min_by_key(|(at, connection)| (connection.busy, *at)) else {
                break;
            };
            let mut together = take_next(&mut self.waiting, |_| self.network.batch);
            let exchange = Exchange {
                connection: at,
                ready: connection.send(now, self.network.trip()),
                known: false,
                started: false,
                share: 0,
                stop: u64::MAX,
                left: together.len(),
                wanted: together.len(),
            };
            let number = self.sent;
            self.sent += 1;
            for transfer in &mut together {
                transfer.exchange = Some(number);
            }
            self.exchanges.insert(number, exchange);
            self.transfers.append(&mut together);
            self.price(number);
        }
    }

    /// Takes from the inner source what it has: no more than is in flight.
    fn collect(&mut self) {
        while let Some(answer) = self.inner.poll() {
            let owed =
                |transfer: &&mut Transfer| transfer.ticket == answer.ticket && transfer.answer.is_none();
            let mut all = self.waiting.iter_mut().chain(&mut self.transfers);
            let Some(transfer) = all.find(owed).filter(|transfer| !transfer.given_up) else {
                continue;
            };
            let exchange = transfer.exchange;
            let cached = answer.wire_bytes == 0 && answer.bytes.as_ref().is_ok_and(|bytes| !bytes.is_empty());
            if cached {
                self.take(answer.ticket);
                self.landed.push_back((answer, 0));
            } else {
                transfer.bytes = answer.wire_bytes;
                transfer.answer = Some(answer);
            }
            if let Some(number) = exchange {
                // A source that takes real time answers later than the simulated server could.
                if let Some(exchange) = self.exchanges.get_mut(&number) {
                    exchange.ready = exchange.ready.max(self.now);
                }
                self.price(number);
            }
        }
    }

    /// Works out what an exchange costs, as soon as all that is in it is known.
    fn price(&mut self, number: u64) {
        let Some(exchange) = self.exchanges.get_mut(&number).filter(|exchange| !exchange.known) else {
            return;
        };
        let parts = || self.transfers.iter().filter(|part| part.exchange == Some(number));
        if parts().any(|part| part.answer.is_none() && !part.given_up) {
            return;
        }
        exchange.known = true;
        let Network {
            header_bytes,
            frame_bytes,
            ..
        } = self.network;
        let frame = if exchange.left > 1 { frame_bytes } else { 0 };
        let records: u64 = parts().map(|part| part.bytes + frame).sum();
        let mut stream = Stream::draw(&self.network, header_bytes + records, &mut self.random);
        let mut head = header_bytes;
        for part in self
            .transfers
            .iter_mut()
            .filter(|part| part.exchange == Some(number))
        {
            let bytes = part.bytes + frame + std::mem::take(&mut head);
            part.fate = stream.next(&self.network, bytes, &mut self.random);
            part.bytes = bytes + part.fate.resent_bytes;
            part.length = self.network.nanoseconds(part.bytes);
            part.left = part.length;
        }
    }

    /// Takes a transfer out, wherever it is; with the last one its exchange is over.
    fn take(&mut self, ticket: Ticket) -> Option<Transfer> {
        let is_it = |transfer: &Transfer| transfer.ticket == ticket;
        if let Some(at) = self.waiting.iter().position(is_it) {
            return Some(self.waiting.remove(at));
        }
        let at = self.transfers.iter().position(is_it)?;
        let transfer = self.transfers.remove(at);
        if let Some(number) = transfer.exchange {
            self.leave(number, !transfer.given_up);
        }
        Some(transfer)
    }

    /// One record of an exchange less is on its way.
    fn leave(&mut self, number: u64, wanted: bool) {
        let Some(exchange) = self.exchanges.get_mut(&number) else {
            return;
        };
        exchange.left -= 1;
        exchange.wanted -= usize::from(wanted);
        if exchange.left == 0 {
            let connection = exchange.connection;
            self.exchanges.remove(&number);
            self.connections[connection].busy -= 1;
        }
    }

    /// The transfer that has the line, or is the next to have it, with its exchange.
    fn next_on_line(&self) -> Option<(usize, &Exchange)> {
        let known = self.exchanges.iter().filter(|(_, exchange)| exchange.known);
        let mut known: Vec<(&u64, &Exchange)> = known.collect();
        known.sort_unstable_by_key(|(number, exchange)| {
            let share = if exchange.started {
                exchange.share
            } else {
                self.share
            };
            (exchange.ready.max(self.line), share, **number)
        });
        known.into_iter().find_map(|(number, exchange)| {
            let at = self
                .transfers
                .iter()
                .position(|part| part.exchange == Some(*number))?;
            Some((at, exchange))
        })
    }

    /// What happens until then, in its order.
    fn run_until(&mut self, end: u64) {
        loop {
            let landing =
                (0..self.landings.len()).min_by_key(|&at| (self.landings[at].due, self.landings[at].ticket));
            let landing = landing.map(|at| (self.landings[at].due, at));
            let sending = self.next_on_line().map(|(at, exchange)| {
                let start = self.line.max(exchange.ready);
                let sent = start.saturating_add(self.transfers[at].left);
                (sent.min(exchange.stop.max(start)), start, at)
            });
            match (landing, sending) {
                (Some((due, at)), _) if due <= end && sending.is_none_or(|(sent, ..)| due <= sent) => {
                    self.now = self.now.max(due);
                    self.land(at);
                    self.send(due);
                }
                (_, Some((sent, start, at))) if sent <= end => {
                    self.finish(at, start, sent);
                    self.send(sent);
                }
                (_, Some((_, start, at))) if start < end => {
                    let transfer = &mut self.transfers[at];
                    transfer.left -= end - start;
                    let exchange = transfer
                        .exchange
                        .and_then(|number| self.exchanges.get_mut(&number));
                    exchange
                        .into_iter()
                        .for_each(|exchange| exchange.start(self.share));
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
        transfer.left -= (sent - start).min(left);
        self.line = sent;
        let Some((number, exchange)) = transfer
            .exchange
            .and_then(|number| Some((number, self.exchanges.get_mut(&number)?)))
        else {
            return;
        };
        if sent > start {
            exchange.start(self.share);
        }
        if !whole || exchange.stop <= start {
            let ticket = transfer.ticket;
            if let Some(transfer) = self.take(ticket) {
                self.give_up(&transfer);
            }
            return;
        }
        exchange.start(self.share);
        let transfer = self.transfers.remove(at);
        self.share = exchange.share;
        exchange.share += transfer.bytes;
        self.stats.resent_bytes += transfer.fate.resent_bytes;
        let in_order = &mut self.connections[exchange.connection].in_order;
        *in_order = (*in_order).max(sent + self.network.trip() / 2 + transfer.fate.held_up);
        self.landings.push(Landing {
            due: *in_order + transfer.fate.overtaken,
            ticket: transfer.ticket,
            exchange: number,
            answer: transfer.answer.filter(|_| !transfer.given_up),
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
        self.leave(landing.exchange, landing.answer.is_some());
        match landing.answer {
            Some(answer) => self.landed.push_back((answer, landing.bytes)),
            None => self.stats.wasted_bytes += landing.bytes,
        }
    }

    /// One record of an exchange less is wanted. When none is, the server learns of it half a round trip later: what has left it
    /// until then is wasted, the rest is not sent.
    fn unwant(&mut self, number: u64) {
        let Some(exchange) = self.exchanges.get_mut(&number) else {
            return;
        };
        exchange.wanted -= 1;
        if exchange.wanted > 0 {
            return;
        }
        exchange.stop = self.now + self.network.trip() / 2;
        let begins = exchange.ready.max(self.line);
        if !exchange.known || (!exchange.started && begins >= exchange.stop) {
            let parts = self.transfers.iter().filter(|part| part.exchange == Some(number));
            let parts: Vec<Ticket> = parts.map(|part| part.ticket).collect();
            for ticket in parts {
                if let Some(transfer) = self.take(ticket) {
                    self.give_up(&transfer);
                }
            }
        }
    }

    fn took(&mut self, ticket: Option<Ticket>, request: Request, anew: bool) -> Option<Ticket> {
        let ticket = ticket?;
        self.open.insert(ticket);
        self.waiting.push(Transfer::new(ticket, request, anew));
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
        let ticket = self.inner.submit(request.clone());
        self.took(ticket, request, false)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let ticket = self.inner.submit_anew(request.clone());
        self.took(ticket, request, true)
    }

    /// A record in the middle of an exchange comes all the same, unless it was the last one that anybody waited for.
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
            let number = landing.exchange;
            self.unwant(number);
        } else if let Some(transfer) = self
            .transfers
            .iter_mut()
            .find(|transfer| transfer.ticket == ticket)
        {
            transfer.given_up = true;
            // Known ones are priced with it; one that the source behind still owes costs nothing.
            if let Some(number) = transfer.exchange {
                self.unwant(number);
                self.price(number);
            }
        } else if let Some(transfer) = self.take(ticket) {
            self.give_up(&transfer);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.look();
        self.run_until(self.now);
        let (mut answer, bytes) = self.landed.pop_front()?;
        self.open.remove(&answer.ticket);
        answer.wire_bytes = bytes;
        self.stats.delivered_bytes += bytes;
        Some(answer)
    }

    /// Waits for the inner source while it owes an answer. What is on its way comes with simulated time, not with this.
    fn wait(&mut self, limit: Duration) {
        self.look();
        let mut all = self.waiting.iter().chain(&self.transfers);
        if self.landed.is_empty() && all.any(|transfer| transfer.answer.is_none() && !transfer.given_up) {
            self.inner.wait(limit);
        }
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    /// Exchanges and bytes are those of the network.
    fn stats(&self) -> SourceStats {
        SourceStats {
            exchanges: self.sent,
            wire_bytes: self.stats.delivered_bytes,
            ..self.inner.stats()
        }
    }
}

#[cfg(test)]
mod tests;
