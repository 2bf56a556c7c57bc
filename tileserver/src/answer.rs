//! The fields of answers, and which form of a document a client takes.

use bytes::Bytes;
use hyper::{
    HeaderMap, StatusCode,
    header::{self, HeaderValue},
};

use crate::{body::Body, conditional, documents::Document, failure::Failure};

/// An answer without what all answers have in common.
pub(crate) type Response = hyper::Response<Body>;
/// An answer or an error.
pub(crate) type Answer = Result<Response, Failure>;

/// How long caches may keep an answer.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keep {
    /// What never changes at its address.
    ForGood,
    /// What changes when an archive does.
    Shortly,
}

/// Records are compressed already.
const BINARY: &str = "application/octet-stream";

/// What an answer says about its content.
pub(crate) struct Fields {
    pub(crate) etag: String,
    pub(crate) keep: Keep,
    pub(crate) kind: &'static str,
    /// Only the cache of the one who asked may keep it.
    pub(crate) private: bool,
}

impl Fields {
    pub(crate) fn new(etag: String, keep: Keep, kind: &'static str, private: bool) -> Self {
        Self {
            etag,
            keep,
            kind,
            private,
        }
    }

    pub(crate) fn binary(etag: String, keep: Keep, private: bool) -> Self {
        Self::new(etag, keep, BINARY, private)
    }

    /// Whether the client has this content already.
    pub(crate) fn known(&self, headers: &HeaderMap) -> bool {
        conditional::none_match(headers, &self.etag)
    }

    /// The head of an answer that has content.
    pub(crate) fn response(self, status: StatusCode) -> Response {
        let kind = HeaderValue::from_static(self.kind);
        let mut response = self.head(status);
        response.headers_mut().insert(header::CONTENT_TYPE, kind);
        response
    }

    pub(crate) fn not_modified(self) -> Response {
        self.head(StatusCode::NOT_MODIFIED)
    }

    pub(crate) fn whole(self, bytes: Bytes) -> Response {
        let mut response = self.response(StatusCode::OK);
        *response.body_mut() = bytes.into();
        response
    }

    fn head(self, status: StatusCode) -> Response {
        let mut response = Response::new(Body::Empty);
        *response.status_mut() = status;
        let cache = match (self.keep, self.private) {
            (Keep::ForGood, false) => "public, max-age=31536000, immutable",
            (Keep::ForGood, true) => "private, max-age=31536000, immutable",
            (Keep::Shortly, false) => "public, max-age=5, must-revalidate",
            (Keep::Shortly, true) => "private, max-age=5, must-revalidate",
        };
        let headers = response.headers_mut();
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(cache));
        headers.extend(HeaderValue::try_from(self.etag).map(|etag| (header::ETAG, etag)));
        response
    }
}

/// A document in the form that the client takes, or that it has it already.
pub(crate) fn document(document: &Document, headers: &HeaderMap, private: bool) -> Response {
    let brotli = document
        .brotli
        .as_ref()
        .filter(|_| takes(headers, "br"))
        .map(|form| (form, "br"));
    let gzip = || {
        document
            .gzip
            .as_ref()
            .filter(|_| takes(headers, "gzip"))
            .map(|form| (form, "gzip"))
    };
    let coded = brotli.or_else(gzip);
    let encoded = coded.map_or(&document.plain, |(form, _)| form);
    let fields = Fields::new(encoded.etag.clone(), document.keep, document.kind, private);
    let mut response = if fields.known(headers) {
        fields.not_modified()
    } else {
        fields.whole(encoded.bytes.clone())
    };
    let out = response.headers_mut();
    if document.brotli.is_some() || document.gzip.is_some() {
        out.append(header::VARY, HeaderValue::from_static("accept-encoding"));
    }
    if let Some((_, coding)) = coded {
        out.insert(header::CONTENT_ENCODING, HeaderValue::from_static(coding));
    }
    response
}

/// What pages of the server may do in a browser: run the server's own scripts and WebAssembly, and read archives wherever they are.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; \
    img-src * data: blob:; connect-src *; worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'";

/// A file of a web page.
pub(crate) fn static_file(file: &Document, headers: &HeaderMap) -> Response {
    let mut response = document(file, headers, false);
    let out = response.headers_mut();
    out.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    out.insert(
        header::X_CONTENT_TYPE_OPTIONS,
        HeaderValue::from_static("nosniff"),
    );
    response
}

/// Whether `Accept-Encoding` has a coding, or all, with a weight that is not zero (RFC 9110, section 12.5.3).
pub(crate) fn takes(headers: &HeaderMap, wanted: &str) -> bool {
    let (mut named, mut all) = (None, None);
    let fields = headers.get_all(header::ACCEPT_ENCODING).iter();
    for item in fields
        .filter_map(|field| field.to_str().ok())
        .flat_map(|field| field.split(','))
    {
        let mut parts = item.split(';').map(str::trim);
        let coding = parts.next().unwrap_or_default();
        let weight = parts
            .find_map(|part| part.strip_prefix("q=")?.parse::<f32>().ok())
            .unwrap_or(1.0);
        if coding.eq_ignore_ascii_case(wanted) {
            named = Some(weight > 0.0);
        } else if coding == "*" {
            all = Some(weight > 0.0);
        }
    }
    named.or(all).unwrap_or(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_are_negotiated() {
        for (field, expected) in [
            ("gzip", true),
            ("br, GZIP;q=0.5", true),
            ("*", true),
            ("*;q=0, gzip", true),
            ("gzip;q=0, *", false),
            ("gzip; q=0.000", false),
            ("identity", false),
            ("", false),
            ("gzipped", false),
        ] {
            let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(field))]);
            assert_eq!(takes(&headers, "gzip"), expected, "{field}");
        }
        assert!(!takes(&HeaderMap::new(), "gzip"));
    }
}
