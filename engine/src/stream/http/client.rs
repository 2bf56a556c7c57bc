//! One GET: the body and its bound, and what the server says when it has nothing.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use bytes::{Bytes, BytesMut};
use http_body_util::BodyExt;
use hyper::{Response, StatusCode, body::Incoming, header};
use serde::Deserialize;
use tokio::time::timeout;

use super::{
    HttpOptions,
    connect::{Connections, Reached, broken_off, fields, silent},
};
use crate::{Error, Result};

/// Largest error message that is read from a server.
const MAX_MESSAGE_BYTES: u64 = 16 << 10;

/// The end of a request that reached the server.
pub(super) enum Got {
    /// With its ETag, if there is one.
    Bytes(Bytes, Option<String>),
    /// 404 or 410, and what the server says about it.
    Missing(String),
}

/// The head of an answer.
pub(super) enum Begun {
    /// There is something, and this it comes as, with its ETag, if there is one.
    Body(Incoming, Option<String>),
    /// 404 or 410, and what the server says about it.
    Missing(String),
}

/// Connections to one server, and how it is asked.
pub(super) struct HttpClient {
    connections: Arc<Connections>,
    silence: Duration,
    exchanges: AtomicU64,
    received: AtomicU64,
}

impl HttpClient {
    /// # Errors
    /// Those of [`Connections::new`].
    pub(super) fn new(options: &HttpOptions) -> Result<Self> {
        Ok(Self {
            connections: Connections::new(options)?,
            silence: options.silence,
            exchanges: AtomicU64::new(0),
            received: AtomicU64::new(0),
        })
    }

    /// GETs so far.
    pub(super) fn exchanges(&self) -> u64 {
        self.exchanges.load(Ordering::Relaxed)
    }

    /// Bytes so far, headers included, wanted or not.
    pub(super) fn received(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }

    fn count(&self, bytes: u64, wire_bytes: &AtomicU64) {
        self.received.fetch_add(bytes, Ordering::Relaxed);
        wire_bytes.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Gets up to `limit` bytes from `url`, from the server itself if `anew`. All bytes that are received are added
    /// to `wire_bytes`.
    pub(super) async fn get(&self, url: &str, limit: u64, anew: bool, wire_bytes: &AtomicU64) -> Result<Got> {
        match self.begin(url, anew, wire_bytes).await? {
            Begun::Body(body, etag) => {
                let bytes = self.body(url, body, limit, wire_bytes).await?;
                Ok(Got::Bytes(bytes, etag))
            }
            Begun::Missing(message) => Ok(Got::Missing(message)),
        }
    }

    /// Sends a GET and waits for its head, which is added to `wire_bytes`.
    pub(super) async fn begin(&self, url: &str, anew: bool, wire_bytes: &AtomicU64) -> Result<Begun> {
        let reached = self.connections.get(url, &fields(anew)).await;
        let exchanges = reached.as_ref().map_or(1, |reached| reached.exchanges);
        self.exchanges.fetch_add(exchanges, Ordering::Relaxed);
        let Reached {
            response, head_bytes, ..
        } = reached.map_err(|detail| passing(url, detail, None))?;
        self.count(head_bytes, wire_bytes);
        let status = response.status();
        if status == StatusCode::OK || status == StatusCode::NO_CONTENT {
            let etag = response.headers().get(header::ETAG);
            let etag = etag.and_then(|etag| etag.to_str().ok()).map(str::to_owned);
            return Ok(Begun::Body(response.into_body(), etag));
        }
        let retry_after = response
            .headers()
            .get(header::RETRY_AFTER)
            .and_then(|seconds| seconds.to_str().ok()?.trim().parse().ok())
            .map(Duration::from_secs);
        let message = self.message(url, response, wire_bytes).await;
        match status {
            StatusCode::NOT_FOUND | StatusCode::GONE => Ok(Begun::Missing(message)),
            StatusCode::TOO_MANY_REQUESTS | StatusCode::REQUEST_TIMEOUT => {
                Err(passing(url, message, retry_after))
            }
            _ if status.is_server_error() => Err(passing(url, message, retry_after)),
            _ => Err(Error::Source {
                what: url.to_owned(),
                detail: message,
            }),
        }
    }

    /// The next bytes of a body; `None` at its end. The caller counts them.
    pub(super) async fn data(&self, url: &str, body: &mut Incoming) -> Result<Option<Bytes>> {
        let silence = self.silence;
        while let Some(frame) = timeout(silence, body.frame())
            .await
            .map_err(|_| passing(url, silent(silence), None))?
        {
            let frame = frame.map_err(|error| passing(url, broken_off(&error), None))?;
            if let Ok(data) = frame.into_data() {
                self.received.fetch_add(data.len() as u64, Ordering::Relaxed);
                return Ok(Some(data));
            }
        }
        Ok(None)
    }

    /// Reads a body of at most `limit` bytes. Memory grows with what arrives, not with what is announced.
    async fn body(&self, url: &str, mut body: Incoming, limit: u64, wire_bytes: &AtomicU64) -> Result<Bytes> {
        let mut all = BytesMut::new();
        while let Some(data) = self.data(url, &mut body).await? {
            wire_bytes.fetch_add(data.len() as u64, Ordering::Relaxed);
            if (all.len() + data.len()) as u64 > limit {
                let detail = format!("the answer is longer than the {limit} bytes that are expected at most");
                return Err(Error::Source {
                    what: url.to_owned(),
                    detail,
                });
            }
            all.extend_from_slice(&data);
        }
        Ok(all.freeze())
    }

    /// What the server says about an answer that is none.
    async fn message(&self, url: &str, response: Response<Incoming>, wire_bytes: &AtomicU64) -> String {
        #[derive(Deserialize)]
        struct Message {
            error: String,
            detail: String,
        }
        let status = response.status();
        let json = response
            .headers()
            .get(header::CONTENT_TYPE)
            .is_some_and(|kind| kind == "application/json");
        let body = self
            .body(url, response.into_body(), MAX_MESSAGE_BYTES, wire_bytes)
            .await
            .ok()
            .filter(|_| json);
        match body.and_then(|body| serde_json::from_slice::<Message>(&body).ok()) {
            Some(Message { error, detail }) => format!("{status}: {error}: {detail}"),
            None => status.to_string(),
        }
    }
}

/// A failure that asking again may mend.
fn passing(url: &str, detail: String, retry_after: Option<Duration>) -> Error {
    Error::Unavailable {
        what: url.to_owned(),
        detail,
        retry_after,
    }
}
