//! A tile server as a source, over HTTP/1.1 with connections that are kept. docs/http.md is the protocol.
//!
//! Requests run on one thread of their own; the frame only submits and polls. Native programs only: a browser
//! has its own client.

mod address;
mod client;
mod connect;
mod fetch;
#[cfg(test)]
mod tests;
mod transport;

use std::{
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

use tokio::{
    runtime::{Builder, Runtime},
    task::AbortHandle,
};

pub(super) use self::address::Address;
use self::fetch::{Fetcher, Flight};
pub use self::transport::HttpTransport;
use super::{Answer, Request, SourceStats, Ticket, TileSource, inbox::Inbox};
use crate::{Error, Result};

/// How sources over HTTP ask. Defaults work.
#[derive(Clone, Copy, Debug)]
pub struct HttpOptions {
    /// Requests in flight, and so connections, at most; at least one.
    pub in_flight: usize,
    /// Longest silence: until there is a connection, until an answer begins, and between its parts.
    pub silence: Duration,
}

impl Default for HttpOptions {
    fn default() -> Self {
        Self {
            in_flight: 32,
            silence: Duration::from_secs(20),
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
/// A request is tried once, and hashes are not checked: [`super::RetriedSource`] does both.
///
/// [`Answer::wire_bytes`] counts bodies and headers that were received, manifests included.
pub struct HttpSource {
    inbox: Inbox<(Arc<Flight>, AbortHandle)>,
    fetcher: Arc<Fetcher>,
    stats: SourceStats,
    /// `None` only while the source is dropped.
    runtime: Option<Runtime>,
}

impl HttpSource {
    /// A source of the server at `http://HOST[:PORT][/PREFIX]`. Nothing is asked yet.
    ///
    /// # Errors
    /// [`Error::Source`] if the address is none, or no thread can be started.
    pub fn new(address: &str, options: HttpOptions) -> Result<Self> {
        let address = Address::parse(address)?;
        let inbox = Inbox::new(options.in_flight.max(1));
        Ok(Self {
            inbox,
            fetcher: Arc::new(Fetcher::new(address, options)),
            stats: SourceStats::default(),
            runtime: Some(network_thread()?),
        })
    }

    fn open(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        let runtime = self.runtime.as_ref()?;
        let (fetcher, answers) = (Arc::clone(&self.fetcher), self.inbox.sender());
        let ticket = self.inbox.open(|ticket| {
            let flight = Arc::new(Flight::new(request, anew));
            let flying = Arc::clone(&flight);
            let fetched = async move {
                let bytes = fetcher.fetch(&flying).await;
                // Nobody listens any more: the source is gone.
                let _ = answers.send(Answer {
                    ticket,
                    request: flying.request.clone(),
                    bytes,
                    wire_bytes: flying.wire_bytes.load(Ordering::Relaxed),
                });
            };
            (flight, runtime.spawn(fetched).abort_handle())
        })?;
        self.stats.requested += 1;
        Some(ticket)
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
        if let Some((flight, task)) = self.inbox.give_up(ticket) {
            task.abort();
            let received = flight.wire_bytes.load(Ordering::Relaxed);
            let length = flight.length.load(Ordering::Relaxed);
            self.stats.cancelled += 1;
            self.stats.wire_bytes += received;
            self.stats.cancelled_bytes_saved += length.saturating_sub(received);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        let answer = self.inbox.poll()?;
        self.stats.wire_bytes += answer.wire_bytes;
        Some(answer)
    }

    fn wait(&mut self, limit: Duration) {
        self.inbox.wait(limit);
    }

    fn origin(&self) -> String {
        self.fetcher.origin().to_owned()
    }

    fn stats(&self) -> SourceStats {
        SourceStats {
            exchanges: self.fetcher.exchanges(),
            ..self.stats
        }
    }
}

impl Drop for HttpSource {
    fn drop(&mut self) {
        self.inbox.drain().for_each(|(_, task)| task.abort());
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
