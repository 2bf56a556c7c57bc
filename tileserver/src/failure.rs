//! What a client is told when it gets no record: JSON of `error`, a short code, and `detail`, a sentence.

use hyper::{
    StatusCode,
    header::{self, HeaderName, HeaderValue},
};

use crate::answer::Response;

/// An answer that is an error.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) status: StatusCode,
    error: &'static str,
    detail: String,
    header: Option<(HeaderName, HeaderValue)>,
}

impl Failure {
    fn new(status: StatusCode, error: &'static str, detail: impl Into<String>) -> Self {
        Self {
            status,
            error,
            detail: detail.into(),
            header: None,
        }
    }

    pub(crate) fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "bad-request", detail)
    }

    pub(crate) fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", detail)
    }

    pub(crate) fn no_archive(name: &str) -> Self {
        Self::not_found(format!("no archive {name:?} here: GET /v1/ lists what there is"))
    }

    /// It is there with another content.
    pub(crate) fn gone(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::GONE, "gone", detail)
    }

    pub(crate) fn method_not_allowed() -> Self {
        let detail = "only GET, HEAD and OPTIONS are answered";
        let allow = (header::ALLOW, HeaderValue::from_static("GET, HEAD, OPTIONS"));
        Self {
            header: Some(allow),
            ..Self::new(StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed", detail)
        }
    }

    pub(crate) fn body_not_allowed() -> Self {
        let close = (header::CONNECTION, HeaderValue::from_static("close"));
        let detail = "requests have no body here";
        Self {
            header: Some(close),
            ..Self::new(StatusCode::PAYLOAD_TOO_LARGE, "body-not-allowed", detail)
        }
    }

    pub(crate) fn precondition_failed() -> Self {
        let detail = "it is not what If-Match names any more: GET its manifest or the catalogue again";
        Self::new(StatusCode::PRECONDITION_FAILED, "precondition-failed", detail)
    }

    pub(crate) fn range_not_satisfiable(detail: &str, length: u64) -> Self {
        let detail = format!("{detail}; the file has {length} bytes");
        let mut failure = Self::new(StatusCode::RANGE_NOT_SATISFIABLE, "range-not-satisfiable", detail);
        failure.header = HeaderValue::try_from(format!("bytes */{length}"))
            .ok()
            .map(|v| (header::CONTENT_RANGE, v));
        failure
    }

    pub(crate) fn busy() -> Self {
        let later = (header::RETRY_AFTER, HeaderValue::from_static("1"));
        let detail = "the server has too much to do: ask again later";
        Self {
            header: Some(later),
            ..Self::new(StatusCode::SERVICE_UNAVAILABLE, "busy", detail)
        }
    }

    /// The store does not answer; its own words are for the log, which has them.
    pub(crate) fn unavailable() -> Self {
        let later = (header::RETRY_AFTER, HeaderValue::from_static("5"));
        let detail = "the store of the archives does not answer: ask again later";
        Self {
            header: Some(later),
            ..Self::new(StatusCode::SERVICE_UNAVAILABLE, "unavailable", detail)
        }
    }

    pub(crate) fn not_ready(detail: &str) -> Self {
        let later = (header::RETRY_AFTER, HeaderValue::from_static("1"));
        Self {
            header: Some(later),
            ..Self::new(StatusCode::SERVICE_UNAVAILABLE, "not-ready", detail)
        }
    }

    pub(crate) fn unauthorized() -> Self {
        let ask = (header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        let detail = "these archives are for holders of a token: send \"Authorization: Bearer TOKEN\"";
        Self {
            header: Some(ask),
            ..Self::new(StatusCode::UNAUTHORIZED, "unauthorized", detail)
        }
    }

    /// The archive does not hold; the details are for the log, which has them.
    pub(crate) fn corrupt(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "corrupt", detail)
    }

    /// What the client reads.
    pub(crate) fn json(&self) -> String {
        serde_json::json!({ "error": self.error, "detail": self.detail }).to_string()
    }

    /// As an answer. An error may be over in a moment: no cache keeps it.
    pub(crate) fn response(self) -> Response {
        let mut response = Response::new(self.json().into());
        *response.status_mut() = self.status;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/json"));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        headers.extend(self.header);
        response
    }
}
