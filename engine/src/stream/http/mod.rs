//! A tile server as a source, over HTTP/1.1 with connections that are kept. docs/http.md is the protocol.
//!
//! Requests run on one thread of their own; the frame only submits and polls. Native programs only: a browser
//! has its own client.

mod address;
mod client;
mod fetch;
#[cfg(test)]
mod tests;

use std::{num::NonZeroU32, sync::Arc, time::Duration};

use tokio::{
    runtime::{Builder, Runtime},
    task::AbortHandle,
};

use self::{address::Address, fetch::Fetcher};
use super::{Answer, Request, Ticket, TileSource, inbox::Inbox};
use crate::{Error, Result};

/// How an [`HttpSource`] asks. Defaults work.
#[derive(Clone, Copy, Debug)]
pub struct HttpOptions {
    /// Requests in flight, and so connections, at most; at least one.
    pub in_flight: usize,
    /// How often a request is tried when the connection fails, or the server answers 5xx or 429.
    pub attempts: NonZeroU32,
    /// Pause before the second attempt; it doubles with each further one.
    pub backoff: Duration,
    /// Longest silence: until there is a connection, until an answer begins, and between its parts.
    pub silence: Duration,
}

impl Default for HttpOptions {
    fn default() -> Self {
        const ATTEMPTS: NonZeroU32 = NonZeroU32::new(4).unwrap();
        let (backoff, silence) = (Duration::from_millis(100), Duration::from_secs(20));
        Self {
            in_flight: 32,
            attempts: ATTEMPTS,
            backoff,
            silence,
        }
    }
}

/// The archives of a tile server.
///
/// An archive's index fixes its content id; pages and columns are asked for under that id, at addresses whose
/// content never changes. When the server has a newer archive of the name, records of the old one are refused
/// with an error that says so, until the index is asked for again.
///
/// [`Answer::wire_bytes`] counts bodies and headers that were received, manifests and failed attempts included.
pub struct HttpSource {
    inbox: Inbox<AbortHandle>,
    fetcher: Arc<Fetcher>,
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
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .max_blocking_threads(2) // For looking up host names.
            .thread_name("eigentile-http")
            .enable_all()
            .build()
            .map_err(|error| Error::Source {
                what: "network thread".into(),
                detail: error.to_string(),
            })?;
        let inbox = Inbox::new(options.in_flight.max(1));
        Ok(Self {
            inbox,
            fetcher: Arc::new(Fetcher::new(address, options)),
            runtime: Some(runtime),
        })
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
        let runtime = self.runtime.as_ref()?;
        let (fetcher, answers) = (Arc::clone(&self.fetcher), self.inbox.sender());
        self.inbox.open(|ticket| {
            let fetched = async move {
                let mut wire_bytes = 0;
                let bytes = fetcher.fetch(&request, ticket, &mut wire_bytes).await;
                // Nobody listens any more: the source is gone.
                let _ = answers.send(Answer {
                    ticket,
                    request,
                    bytes,
                    wire_bytes,
                });
            };
            runtime.spawn(fetched).abort_handle()
        })
    }

    fn cancel(&mut self, ticket: Ticket) {
        if let Some(task) = self.inbox.give_up(ticket) {
            task.abort();
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.inbox.poll()
    }

    fn wait(&mut self, limit: Duration) {
        self.inbox.wait(limit);
    }
}

impl Drop for HttpSource {
    fn drop(&mut self) {
        self.inbox.drain().for_each(|task| task.abort());
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
