//! The access log: one line a request, written when its body is sent or given up. Requests are counted here, too.

use std::{
    collections::hash_map::RandomState,
    hash::BuildHasher,
    pin::Pin,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicU64, Ordering},
    },
    task::{Context, Poll, ready},
    time::Instant,
};

use axum::{
    body::Body,
    extract::{Request, State},
    http::{HeaderMap, HeaderValue, Method, StatusCode, Uri},
    middleware::Next,
    response::Response,
};
use bytes::Bytes;
use hyper::body::{Body as HttpBody, Frame, SizeHint};

use crate::{
    guard::{self, Place},
    metrics::{Metrics, Route},
    service::Shared,
};

/// The field that names a request, from proxies and to clients.
pub(crate) const REQUEST_ID: &str = "x-request-id";
/// Longest name that is taken over.
const MAX_ID_BYTES: usize = 64;

/// Logs id, method, path, status, bytes of the body, milliseconds until the last of them was handed to the
/// connection, and whether that was all of the body.
pub(crate) async fn access(State(shared): State<Arc<Shared>>, request: Request, next: Next) -> Response {
    let id = request_id(request.headers());
    let (method, uri, begin) = (request.method().clone(), request.uri().clone(), Instant::now());
    let mut line = Line {
        metrics: Arc::clone(&shared.metrics),
        route: guard::route(&request),
        id: id.clone(),
        method,
        uri,
        // Stands if the client leaves before there is an answer, as nginx has it.
        status: StatusCode::from_u16(499).unwrap_or_default(),
        begin,
        bytes: 0,
        complete: false,
        _place: None,
    };
    line.metrics.requests_begun.add(1);
    let mut response = next.run(request).await;
    line.status = response.status();
    line._place = response.extensions_mut().remove::<Place>();
    line.metrics.begun(line.route, line.status, begin.elapsed());
    response.headers_mut().insert(REQUEST_ID, id);
    response.map(|body| Body::new(Logged { body, line }))
}

/// The id that a client or a proxy has given, if it cannot do harm in a log, or a new one.
pub(crate) fn request_id(headers: &HeaderMap) -> HeaderValue {
    let harmless = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.' | b':');
    let given = headers
        .get(REQUEST_ID)
        .filter(|id| (1..=MAX_ID_BYTES).contains(&id.len()) && id.as_bytes().iter().all(harmless));
    given.cloned().unwrap_or_else(new_id)
}

/// 16 hexadecimal digits that no other request of this process has, and hardly one of another.
fn new_id() -> HeaderValue {
    static START: LazyLock<u64> = LazyLock::new(|| RandomState::new().hash_one(()));
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let number = START.wrapping_add(COUNT.fetch_add(1, Ordering::Relaxed));
    // Digits only, which are a field always.
    HeaderValue::try_from(format!("{number:016x}")).unwrap_or(HeaderValue::from_static("-"))
}

struct Line {
    metrics: Arc<Metrics>,
    route: Route,
    id: HeaderValue,
    method: Method,
    uri: Uri,
    status: StatusCode,
    begin: Instant,
    bytes: u64,
    complete: bool,
    /// Held until the line is written.
    _place: Option<Place>,
}

impl Drop for Line {
    fn drop(&mut self) {
        self.metrics.requests_ended.add(1);
        self.metrics.sent(self.route, self.bytes);
        if !self.complete {
            self.metrics.broken_off.add(1);
        }
        tracing::info!(
            id = self.id.to_str().unwrap_or_default(),
            method = %self.method,
            path = self.uri.path(),
            status = self.status.as_u16(),
            bytes = self.bytes,
            ms = self.begin.elapsed().as_secs_f64() * 1e3,
            complete = self.complete,
            "request"
        );
    }
}

struct Logged {
    body: Body,
    line: Line,
}

impl HttpBody for Logged {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context));
        match &frame {
            Some(Ok(frame)) => self.line.bytes += frame.data_ref().map_or(0, |data| data.len() as u64),
            Some(Err(_)) => {}
            None => self.line.complete = true,
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Logged {
    fn drop(&mut self) {
        // A connection need not ask for the end of a body whose length it knows.
        self.line.complete |= self.body.is_end_stream();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_taken_over_or_made() {
        let id = |given: &str| {
            let headers = HeaderMap::from_iter([(
                axum::http::HeaderName::from_static(REQUEST_ID),
                HeaderValue::from_str(given).unwrap(),
            )]);
            request_id(&headers).to_str().unwrap().to_owned()
        };
        assert_eq!(id("a-1_b.c:2"), "a-1_b.c:2");
        for bad in ["", "with space", "quote\"", &"x".repeat(65)] {
            assert_eq!(id(bad).len(), 16, "{bad}");
        }
        assert_ne!(id(""), id(""));
    }
}
