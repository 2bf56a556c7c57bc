//! Connections to a host, and what can be said when one fails.

use std::{error::Error as _, time::Duration};

use bytes::Bytes;
use http_body_util::Empty;
use hyper::{Request, Response, Uri, body::Incoming, header};
use hyper_util::{
    client::legacy::{Client, connect::HttpConnector},
    rt::{TokioExecutor, TokioTimer},
};

use super::HttpOptions;
use crate::{Error, Result};

/// How long an unused connection is kept.
const IDLE_CONNECTION: Duration = Duration::from_secs(30);

/// Connections that are kept.
pub(super) type Connections = Client<HttpConnector, Empty<Bytes>>;

pub(super) fn connections(options: HttpOptions) -> Connections {
    let mut connector = HttpConnector::new();
    connector.set_nodelay(true);
    connector.set_connect_timeout(Some(options.silence));
    Client::builder(TokioExecutor::new())
        .pool_timer(TokioTimer::new())
        .pool_idle_timeout(IDLE_CONNECTION)
        .pool_max_idle_per_host(options.in_flight)
        .build(connector)
}

/// A GET; `anew`: caches on the way are to ask the host.
pub(super) fn request(url: &str, anew: bool) -> Result<Request<Empty<Bytes>>> {
    let mut request = Request::get(url);
    if anew {
        request = request.header(header::CACHE_CONTROL, "no-cache");
    }
    request.body(Empty::new()).map_err(|error| Error::Source {
        what: url.to_owned(),
        detail: format!("no URL ({error})"),
    })
}

/// Why there is no answer at all: the innermost reason, and what to do.
pub(super) fn unreachable(uri: &Uri, error: &hyper_util::client::legacy::Error) -> String {
    let mut reason = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        reason = error.to_string();
        source = error.source();
    }
    let server = uri
        .authority()
        .map_or("the server", |authority| authority.as_str());
    if error.is_connect() {
        format!(
            "no connection to {server} ({reason}): check that the server runs (eigentile serve DIR --listen \
             HOST:PORT) and that the address given with --tiles is its address"
        )
    } else {
        format!("the connection to {server} failed ({reason})")
    }
}

pub(super) fn silent(silence: Duration) -> String {
    format!("no answer for {} s", silence.as_secs_f64())
}

pub(super) fn broken_off(error: &hyper::Error) -> String {
    format!("the answer broke off ({error})")
}

/// Bytes of status line and header fields, as they stand on an HTTP/1.1 wire.
pub(super) fn head_bytes(response: &Response<Incoming>) -> u64 {
    let status_line =
        "HTTP/1.1 200 \r\n\r\n".len() + response.status().canonical_reason().map_or(0, str::len);
    let fields = response
        .headers()
        .iter()
        .map(|(name, value)| name.as_str().len() + value.len() + 4);
    (status_line + fields.sum::<usize>()) as u64
}
