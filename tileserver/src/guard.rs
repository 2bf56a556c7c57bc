//! Which requests are answered: not too many at once, without a body, in time, and with a token where one is needed.

use std::sync::atomic::Ordering;

use hyper::{
    HeaderMap, Method,
    header::{self, HeaderName, HeaderValue},
};
use subtle::{Choice, ConstantTimeEq};

use crate::{
    answer::Response,
    body::Body,
    failure::Failure,
    service::{Service, Shared},
};

impl Shared {
    /// Takes a place among the requests in progress, if there is one; [`Self::leave`] gives it back.
    pub(crate) fn enter(&self) -> Result<(), Failure> {
        if self.requests.fetch_add(1, Ordering::Relaxed) < self.options.requests.max(1) {
            return Ok(());
        }
        self.leave();
        self.metrics.shed.add(1);
        Err(Failure::busy())
    }

    pub(crate) fn leave(&self) {
        self.requests.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Service<'_> {
    /// Lets pass who has a token of the collection, or everybody if it has none.
    pub(crate) fn authorize(&self, headers: &HeaderMap) -> Result<(), Failure> {
        let tokens = &self.collection.tokens;
        if tokens.is_empty() || known(tokens, headers) {
            Ok(())
        } else {
            Err(Failure::unauthorized())
        }
    }
}

/// Pages of any origin may read answers, and all fields of them. No request comes with cookies, so that this is what a star means
/// (Fetch, section 3.3.3), and it is 71 bytes less in each answer than their names.
static ANYBODY: HeaderValue = HeaderValue::from_static("*");
/// What they may ask, and send along.
const ASKED: [(HeaderName, &str); 4] = [
    (header::ALLOW, "GET, HEAD, OPTIONS"),
    (header::ACCESS_CONTROL_ALLOW_METHODS, "GET,HEAD,OPTIONS"),
    (
        header::ACCESS_CONTROL_ALLOW_HEADERS,
        "authorization,range,if-range,if-none-match,cache-control,x-request-id",
    ),
    (header::ACCESS_CONTROL_MAX_AGE, "86400"),
];

/// The fields of all answers, for pages of other origins.
pub(crate) fn share(headers: &mut HeaderMap) {
    headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, ANYBODY.clone());
    headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, ANYBODY.clone());
}

/// Preflights, and others who ask what may be asked, get an answer without a token and without a place.
pub(crate) fn options() -> Response {
    let mut response = Response::new(Body::Empty);
    let fields = ASKED.map(|(name, value)| (name, HeaderValue::from_static(value)));
    response.headers_mut().extend(fields);
    response
}

/// Whether a request only reads.
pub(crate) fn reads(method: &Method) -> Result<(), Failure> {
    if matches!(*method, Method::GET | Method::HEAD) {
        Ok(())
    } else {
        Err(Failure::method_not_allowed())
    }
}

/// Whether `Authorization` has one of the tokens (RFC 6750, section 2.1). Takes as long for any token of the same
/// length, known or not, so that nothing can be learned from the time it takes.
fn known(tokens: &[String], headers: &HeaderMap) -> bool {
    let field = headers
        .get(header::AUTHORIZATION)
        .map_or(&b""[..], |field| field.as_bytes());
    let Some((scheme, token)) = field.split_at_checked("Bearer ".len()) else {
        return false;
    };
    let same = tokens.iter().fold(Choice::from(0), |known, other| {
        known | other.as_bytes().ct_eq(token)
    });
    scheme.eq_ignore_ascii_case(b"Bearer ") && bool::from(same)
}

#[cfg(test)]
mod tests {
    use hyper::header::HeaderValue;

    use super::*;

    #[test]
    fn tokens() {
        let tokens = ["first".to_owned(), "second".to_owned()];
        for (field, expected) in [
            ("Bearer first", true),
            ("bearer second", true),
            ("Bearer third", false),
            ("Bearer firs", false),
            ("Bearer firstsecond", false),
            ("Bearer ", false),
            ("Bearer", false),
            ("", false),
            ("Basic first", false),
            ("first", false),
        ] {
            let headers = HeaderMap::from_iter([(header::AUTHORIZATION, HeaderValue::from_static(field))]);
            assert_eq!(known(&tokens, &headers), expected, "{field}");
        }
        assert!(!known(&tokens, &HeaderMap::new()));
    }
}
