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
    time::Duration,
};

use tokio::runtime::{Builder, Runtime};

pub(super) use self::address::Address;
pub use self::transport::HttpTransport;
use self::{
    batch::Carrier,
    fetch::{Fetcher, Flight},
};
use super::{Answer, Request, SourceStats, Ticket, TileSource, inbox::Inbox};
use crate::{Error, Result};

/// How sources over HTTP ask. Defaults work.
#[derive(Clone, Debug)]
pub struct HttpOptions {
    /// Requests in flight, and so connections, at most; at least one.
    pub in_flight: usize,
    /// Longest silence: until there is a connection, until an answer begins, and between its parts.
    pub silence: Duration,
    /// PEM file with certificates of authorities that are trusted besides those that the system trusts, for `https://`.
    pub ca_file: Option<PathBuf>,
}

impl Default for HttpOptions {
    fn default() -> Self {
        Self {
            in_flight: 32,
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
/// Records that are submitted between two looks (`poll` or `wait`) travel together where the server does batches.
///
/// A request is tried once, and hashes are not checked: [`super::RetriedSource`] does both.
///
/// [`Answer::wire_bytes`] counts bodies and headers that were received, manifests included.
pub struct HttpSource {
    inbox: Inbox<Arc<Flight>>,
    /// Records that are sent with the next look at the source, so that those of one go are seen together.
    pending: Vec<(Ticket, Arc<Flight>)>,
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
        let inbox = Inbox::new(options.in_flight.max(1));
        Ok(Self {
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
        if anew || matches!(flight.request, Request::Index { .. }) {
            self.send(vec![(ticket, flight)]);
        } else {
            self.pending.push((ticket, flight));
        }
        Some(ticket)
    }

    /// Sends what was submitted since the last call: records of one archive together, if the server does that.
    fn send_pending(&mut self) {
        while let Some((_, first)) = self.pending.first() {
            let archive = Arc::clone(first.request.archive());
            let mut together = 0;
            let most = match self.fetcher.has_batches(&archive) {
                true => batch::MAX_RECORDS,
                false => 1,
            };
            let taken = self.pending.extract_if(.., |(_, flight)| {
                let taken = together < most && *flight.request.archive() == archive;
                together += usize::from(taken);
                taken
            });
            let taken = taken.collect();
            self.send(taken);
        }
    }

    /// Sends requests, several only to a server with batches.
    fn send(&mut self, sent: Vec<(Ticket, Arc<Flight>)>) {
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
        if flight.carrier.get().is_none_or(|carrier| carrier.give_up()) {
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
        self.send_pending();
        self.inbox.wait(limit);
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
        let carriers = self
            .inbox
            .drain()
            .filter_map(|flight| flight.carrier.get().cloned());
        carriers.for_each(|carrier| _ = carrier.give_up());
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
