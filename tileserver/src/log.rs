//! The access log: one line a request, written when its body is sent or given up.

use std::{
    pin::Pin,
    task::{Context, Poll, ready},
    time::Instant,
};

use axum::{
    body::Body,
    extract::Request,
    http::{Method, StatusCode, Uri},
    middleware::Next,
    response::Response,
};
use bytes::Bytes;
use hyper::body::{Body as HttpBody, Frame, SizeHint};

/// Logs method, path, status, bytes of the body, milliseconds until the last of them was handed to the
/// connection, and whether that was all of the body.
pub(crate) async fn access(request: Request, next: Next) -> Response {
    let (method, uri, begin) = (request.method().clone(), request.uri().clone(), Instant::now());
    let response = next.run(request).await;
    let status = response.status();
    response.map(|body| {
        Body::new(Logged {
            body,
            line: Line {
                method,
                uri,
                status,
                begin,
                bytes: 0,
                complete: false,
            },
        })
    })
}

struct Line {
    method: Method,
    uri: Uri,
    status: StatusCode,
    begin: Instant,
    bytes: u64,
    complete: bool,
}

impl Drop for Line {
    fn drop(&mut self) {
        tracing::info!(
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
        if let Some(Ok(frame)) = &frame {
            self.line.bytes += frame.data_ref().map_or(0, |data| data.len() as u64);
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
        self.line.complete = self.body.is_end_stream();
    }
}
