//! The access log: one line a request, written when its body is sent or given up. Requests are counted here, too.

use std::{
    collections::hash_map::RandomState,
    hash::BuildHasher,
    io,
    pin::Pin,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicU64, Ordering},
    },
    task::{Context, Poll, ready},
    time::Instant,
};

use bytes::Bytes;
use hyper::{
    HeaderMap, Method, Response, StatusCode, Uri,
    body::{Body as HttpBody, Frame, SizeHint},
    header::{HeaderName, HeaderValue},
    http::request::Parts,
};

use crate::{body::Body, failure::Failure, metrics::Route, pulse::Pulse, service::Shared};

/// The field that names a request, from proxies and to clients.
pub(crate) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest name that is taken over.
const MAX_ID_BYTES: usize = 64;

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
    let digits: [u8; 16] =
        std::array::from_fn(|at| b"0123456789abcdef"[(number >> (60 - 4 * at)) as usize & 15]);
    // Digits only, which are a field always.
    HeaderValue::from_bytes(&digits).unwrap_or(HeaderValue::from_static("-"))
}

/// A request, from its head to the last byte of its answer: id, method, path, status, bytes of the body, milliseconds until
/// the last of them was handed to the connection, and whether that was all of the body.
pub(crate) struct Line {
    pub(crate) shared: Arc<Shared>,
    pulse: Arc<Pulse>,
    route: Route,
    id: HeaderValue,
    method: Method,
    uri: Uri,
    status: StatusCode,
    begin: Instant,
    bytes: u64,
    complete: bool,
    /// Has a place among those in progress.
    entered: bool,
}

impl Line {
    pub(crate) fn new(shared: Arc<Shared>, pulse: &Arc<Pulse>, head: &Parts, route: Route) -> Self {
        pulse.request();
        shared.metrics.requests_begun.add(1);
        Self {
            shared,
            pulse: Arc::clone(pulse),
            route,
            id: request_id(&head.headers),
            method: head.method.clone(),
            uri: head.uri.clone(),
            // Stands if the client leaves before there is an answer, as nginx has it.
            status: StatusCode::from_u16(499).unwrap_or_default(),
            begin: Instant::now(),
            bytes: 0,
            complete: false,
            entered: false,
        }
    }

    /// Takes a place for as long as this lives. Those who look after the server always get in.
    pub(crate) fn enter(&mut self) -> Result<(), Failure> {
        if self.route != Route::Status {
            self.shared.enter()?;
            self.entered = true;
        }
        Ok(())
    }

    /// The answer, which takes the line along.
    pub(crate) fn answered(mut self, mut response: Response<Body>) -> Response<Logged> {
        self.status = response.status();
        self.shared
            .metrics
            .begun(self.route, self.status, self.begin.elapsed());
        response.headers_mut().insert(REQUEST_ID, self.id.clone());
        response.map(|body| Logged { body, line: self })
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.pulse.answered();
        if self.entered {
            self.shared.leave();
        }
        let metrics = &self.shared.metrics;
        metrics.requests_ended.add(1);
        metrics.sent(self.route, self.bytes);
        if !self.complete {
            metrics.broken_off.add(1);
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

/// A body whose bytes are counted.
pub(crate) struct Logged {
    body: Body,
    line: Line,
}

impl HttpBody for Logged {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Frame<Bytes>>>> {
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
            let headers = HeaderMap::from_iter([(REQUEST_ID, HeaderValue::from_str(given).unwrap())]);
            request_id(&headers).to_str().unwrap().to_owned()
        };
        assert_eq!(id("a-1_b.c:2"), "a-1_b.c:2");
        for bad in ["", "with space", "quote\"", &"x".repeat(65)] {
            assert_eq!(id(bad).len(), 16, "{bad}");
        }
        assert_ne!(id(""), id(""));
    }
}
