//! One GET: attempts, the body and its bound, and what the server says when it has nothing.

use std::{error::Error as _, time::Duration};

use bytes::{Bytes, BytesMut};
use http_body_util::{BodyExt, Empty};
use hyper::{Response, StatusCode, Uri, body::Incoming, header};
use hyper_util::{
    client::legacy::{Client, connect::HttpConnector},
    rt::{TokioExecutor, TokioTimer},
};
use serde::Deserialize;
use tokio::time::timeout;

use super::HttpOptions;
use crate::{Error, Result};

/// Largest error message that is read from a server.
const MAX_MESSAGE_BYTES: u64 = 16 << 10;
/// How long an unused connection is kept.
const IDLE_CONNECTION: Duration = Duration::from_secs(30);

/// The end of a request that reached the server.
pub(super) enum Got {
    Bytes(Bytes),
    /// 404 or 410, and what the server says about it.
    Missing(String),
}

/// The end of one attempt that got nothing.
enum Failure {
    /// Worth another attempt.
    Transient(String),
    Final(Error),
}

/// Connections to one server, and how it is asked.
pub(super) struct HttpClient {
    client: Client<HttpConnector, Empty<Bytes>>,
    options: HttpOptions,
}

impl HttpClient {
    pub(super) fn new(options: HttpOptions) -> Self {
        let mut connector = HttpConnector::new();
        connector.set_nodelay(true);
        connector.set_connect_timeout(Some(options.silence));
        let client = Client::builder(TokioExecutor::new())
            .pool_timer(TokioTimer::new())
            .pool_idle_timeout(IDLE_CONNECTION)
            .pool_max_idle_per_host(options.in_flight)
            .build(connector);
        Self { client, options }
    }

    /// Gets up to `limit` bytes from `url`, in several attempts with pauses that double. All bytes that are
    /// received are added to `wire_bytes`. Pauses differ with `spread`, so that requests which failed together do
    /// not come back together.
    pub(super) async fn get(&self, url: &str, limit: u64, spread: u64, wire_bytes: &mut u64) -> Result<Got> {
        let failed = |detail: String| Error::Source {
            what: url.to_owned(),
            detail,
        };
        let uri: Uri = url.parse().map_err(|error| failed(format!("no URL ({error})")))?;
        let attempts = self.options.attempts.get();
        let mut pause = self.options.backoff;
        let mut attempt = 1;
        loop {
            let detail = match self.attempt(&uri, limit, wire_bytes).await {
                Ok(got) => return Ok(got),
                Err(Failure::Final(error)) => return Err(error),
                Err(Failure::Transient(detail)) => detail,
            };
            if attempt == attempts {
                return Err(failed(format!("{detail} (after {attempts} attempts)")));
            }
            tokio::time::sleep(pause.saturating_add(pause / 32 * (spread % 16) as u32)).await;
            pause = pause.saturating_mul(2);
            attempt += 1;
        }
    }

    async fn attempt(
        &self,
        uri: &Uri,
        limit: u64,
        wire_bytes: &mut u64,
    ) -> std::result::Result<Got, Failure> {
        let silence = self.options.silence;
        let response = timeout(silence, self.client.get(uri.clone())).await;
        let response = response
            .map_err(|_| silent(silence))?
            .map_err(|error| unreachable(uri, &error))?;
        *wire_bytes += head_bytes(&response);
        let status = response.status();
        if status == StatusCode::OK || status == StatusCode::NO_CONTENT {
            return self.body(uri, response, limit, wire_bytes).await.map(Got::Bytes);
        }
        let message = self.message(uri, response, wire_bytes).await;
        match status {
            StatusCode::NOT_FOUND | StatusCode::GONE => Ok(Got::Missing(message)),
            StatusCode::TOO_MANY_REQUESTS | StatusCode::REQUEST_TIMEOUT => Err(Failure::Transient(message)),
            _ if status.is_server_error() => Err(Failure::Transient(message)),
            _ => Err(Failure::Final(Error::Source {
                what: uri.to_string(),
                detail: message,
            })),
        }
    }

    /// Reads a body of at most `limit` bytes. Memory grows with what arrives, not with what is announced.
    async fn body(
        &self,
        uri: &Uri,
        response: Response<Incoming>,
        limit: u64,
        wire_bytes: &mut u64,
    ) -> std::result::Result<Bytes, Failure> {
        let silence = self.options.silence;
        let mut body = response.into_body();
        let mut all = BytesMut::new();
        while let Some(frame) = timeout(silence, body.frame())
            .await
            .map_err(|_| silent(silence))?
        {
            let frame =
                frame.map_err(|error| Failure::Transient(format!("the answer broke off ({error})")))?;
            let Ok(data) = frame.into_data() else { continue };
            *wire_bytes += data.len() as u64;
            if (all.len() + data.len()) as u64 > limit {
                let detail = format!("the answer is longer than the {limit} bytes that are expected at most");
                return Err(Failure::Final(Error::Source {
                    what: uri.to_string(),
                    detail,
                }));
            }
            all.extend_from_slice(&data);
        }
        Ok(all.freeze())
    }

    /// What the server says about an answer that is none.
    async fn message(&self, uri: &Uri, response: Response<Incoming>, wire_bytes: &mut u64) -> String {
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
            .body(uri, response, MAX_MESSAGE_BYTES, wire_bytes)
            .await
            .ok()
            .filter(|_| json);
        match body.and_then(|body| serde_json::from_slice::<Message>(&body).ok()) {
            Some(Message { error, detail }) => format!("{status}: {error}: {detail}"),
            None => status.to_string(),
        }
    }
}

/// Why there is no answer at all: the innermost reason, and what to do.
fn unreachable(uri: &Uri, error: &hyper_util::client::legacy::Error) -> Failure {
    let mut reason = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        reason = error.to_string();
        source = error.source();
    }
    let server = uri
        .authority()
        .map_or("the server", |authority| authority.as_str());
    Failure::Transient(if error.is_connect() {
        format!(
            "no connection to {server} ({reason}): check that the server runs (eigentile serve DIR --listen \
             HOST:PORT) and that the address given with --tiles is its address"
        )
    } else {
        format!("the connection to {server} failed ({reason})")
    })
}

fn silent(silence: Duration) -> Failure {
    Failure::Transient(format!("no answer for {} s", silence.as_secs_f64()))
}

/// Bytes of status line and header fields, as they stand on an HTTP/1.1 wire.
fn head_bytes(response: &Response<Incoming>) -> u64 {
    let status_line =
        "HTTP/1.1 200 \r\n\r\n".len() + response.status().canonical_reason().map_or(0, str::len);
    let fields = response
        .headers()
        .iter()
        .map(|(name, value)| name.as_str().len() + value.len() + 4);
    (status_line + fields.sum::<usize>()) as u64
}
