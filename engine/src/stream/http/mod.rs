//! A tile server as a source, over HTTP/1.1 with connections that are kept, with TLS or without. Redirections are followed. docs/http.md is the protocol.
//!
//! Requests run on one thread of their own; the frame only submits and polls. Native programs only: a browser
//! has its own client.

mod address;
mod batch;
mod client;
mod connect;
mod fetch;
mod redirection;
#[cfg(test)]
mod tests;
mod transport;

use std::{
    path::PathBuf,
    sync::{Arc, atomic::Ordering},
    time::{Duration, Instant},
};

use tokio::{
    runtime::{Builder, Runtime},
    sync::{OwnedSemaphorePermit, Semaphore},
};

pub(super) use self::address::Address;
pub use self::transport::HttpTransport;
use self::{
    batch::Carrier,
    fetch::{Fetcher, Flight},
};
use super::{
    Answer, Request, SourceStats, Ticket, TileSource,
    inbox::Inbox,
    together::{CONNECTIONS, MAX_RECORDS, take_next},
};
use crate::{Error, Result};

/// How soon a connection that has become free is used while something waits for one.
const TICK: Duration = Duration::from_millis(1);

/// How sources over HTTP ask. Defaults work.
#[derive(Clone, Debug)]
pub struct HttpOptions {
    /// Records in flight, at most; at least one. They share connections where the server does batches.
    pub records: usize,
    /// Connections, at most; at least one.
    pub connections: usize,
    /// Longest silence: until there is a connection, until an answer begins, and between its parts.
    pub silence: Duration,
    /// PEM file with certificates of authorities that are trusted besides those that the system trusts, for `https://`.
    pub ca_file: Option<PathBuf>,
}

impl Default for HttpOptions {
    fn default() -> Self {
        Self {
            records: 256,
            connections: CONNECTIONS,
            silence: Duration::from_secs(20),
            ca_file: None,
        }
    }
}

/// The thread on which requests run.
fn network_thread() -> Result<Runtime> {
    Builder::new_multi_thread()
        .worker_threads(1)
        .max_blocking_threads(2) // For looking up host names.
        .thread_name("eigentile-http")
        .enable_all()
        .build()
        .map_err(|error| Error::Source {
            what: "network thread".into(),
            detail: error.to_string(),
        })
}

/// The archives of a tile server.
///
/// An archive's index fixes its content id; pages and columns are asked for under that id, at addresses whose
/// content never changes. When the server has a newer archive of the name, records of the old one are refused
/// with an error that says so, until the index is asked for again.
///
/// Records of one archive that are submitted between two looks (`poll` or `wait`), or while all connections are busy, travel together where
/// the server does batches.
///
/// A request is tried once, and hashes are not checked: [`super::RetriedSource`] does both.
///
/// [`Answer::wire_bytes`] counts bodies and headers that were received, manifests included.
pub struct HttpSource {
    inbox: Inbox<Arc<Flight>>,
    /// What is sent with the next look at the source at which a connection is free, so that records of one go are seen together.
    pending: Vec<(Ticket, Arc<Flight>)>,
    /// Free connections.
    connections: Arc<Semaphore>,
    fetcher: Arc<Fetcher>,
    stats: SourceStats,
    /// `None` only while the source is dropped.
    runtime: Option<Runtime>,
}

impl HttpSource {
    /// A source of the server at `http[s]://HOST[:PORT][/PREFIX]`. Nothing is asked yet.
    ///
    /// # Errors
    /// [`Error::Source`] if the address is none, certificates cannot be read, or no thread can be started.
    pub fn new(address: &str, options: &HttpOptions) -> Result<Self> {
        let address = Address::parse(address)?.without_query()?;
        let inbox = Inbox::new(options.records.max(1));
        let connections = options.connections.clamp(1, Semaphore::MAX_PERMITS);
        Ok(Self {
            connections: Arc::new(Semaphore::new(connections)),
            inbox,
            fetcher: Arc::new(Fetcher::new(address, options)?),
            pending: Vec::new(),
            stats: SourceStats::default(),
            runtime: Some(network_thread()?),
        })
    }

    fn open(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        let flight = Arc::new(Flight::new(request, anew));
        let ticket = self.inbox.open(|_| Arc::clone(&flight))?;
        self.stats.requested += 1;
        self.pending.push((ticket, flight));
        Some(ticket)
    }

    /// Sends what waits, as far as connections are free: records of one archive together, if the server does that.
    fn send_pending(&mut self) {
        while !self.pending.is_empty() {
            let Ok(permit) = Arc::clone(&self.connections).try_acquire_owned() else {
                return;
            };
            let sent = take_next(&mut self.pending, |archive| {
                match self.fetcher.has_batches(archive) {
                    true => MAX_RECORDS,
                    false => 1,
                }
            });
            self.send(sent, permit);
        }
    }

    /// Sends requests, several only to a server with batches.
    fn send(&mut self, sent: Vec<(Ticket, Arc<Flight>)>, permit: OwnedSemaphorePermit) {
        let Some(runtime) = self.runtime.as_ref() else {
            return;
        };
        let carrier = Carrier::of(sent.len());
        let (tickets, flights): (Vec<Ticket>, Vec<Arc<Flight>>) = sent.into_iter().unzip();
        for flight in &flights {
            // Each is sent once.
            let _ = flight.carrier.set(Arc::clone(&carrier));
        }
        let (fetcher, answers) = (Arc::clone(&self.fetcher), self.inbox.sender());
        let fetched = async move {
            let answer = |at: usize, bytes| {
                let flight: &Flight = &flights[at];
                flight.end();
                // Nobody listens any more: the source is gone.
                let _ = answers.send(Answer {
                    ticket: tickets[at],
                    request: flight.request.clone(),
                    bytes,
                    checked: false,
                    wire_bytes: flight.wire_bytes.load(Ordering::Relaxed),
                });
            };
            match &*flights {
                [only] => answer(0, fetcher.fetch(only).await),
                several => fetcher.fetch_all(several, answer).await,
            }
            drop(permit);
        };
        carrier.set_task(runtime.spawn(fetched).abort_handle());
    }
}

impl TileSource for HttpSource {
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
        let Some(flight) = self.inbox.give_up(ticket) else {
            return;
        };
        self.pending.retain(|(pending, _)| *pending != ticket);
        self.stats.cancelled += 1;
        // A record in the middle of a batch comes all the same.
        if flight.give_up() {
            let received = flight.wire_bytes.load(Ordering::Relaxed);
            let length = flight.length.load(Ordering::Relaxed);
            self.stats.cancelled_bytes_saved += length.saturating_sub(received);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.send_pending();
        self.inbox.poll()
    }

    fn wait(&mut self, limit: Duration) {
        let begin = Instant::now();
        self.send_pending();
        // A connection becomes free a little later than its last answer comes.
        while !self.pending.is_empty() && !self.inbox.is_ready() && begin.elapsed() < limit {
            self.inbox.wait(TICK.min(limit));
            self.send_pending();
        }
        self.inbox.wait(limit.saturating_sub(begin.elapsed()));
    }

    fn origin(&self) -> String {
        self.fetcher.origin().to_owned()
    }

    fn stats(&self) -> SourceStats {
        SourceStats {
            exchanges: self.fetcher.exchanges(),
            wire_bytes: self.fetcher.received(),
            ..self.stats
        }
    }
}

impl Drop for HttpSource {
    fn drop(&mut self) {
        self.inbox.drain().for_each(|flight| _ = flight.give_up());
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
