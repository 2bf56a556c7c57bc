//! Which requests are answered: not too many at once, without a body, in time, and with a token where one is needed.

use std::sync::Arc;

use axum::{
    extract::{MatchedPath, Request, State},
    http::{HeaderMap, header},
    middleware::Next,
    response::Response,
};
use hyper::body::Body;
use subtle::{Choice, ConstantTimeEq};
use tokio::sync::OwnedSemaphorePermit;

use crate::{
    failure::Failure,
    metrics::Route,
    service::{Service, Shared},
};

/// A request's place among those in progress; it travels with the answer until its last byte is sent.
#[derive(Clone)]
pub(crate) struct Place(
    #[expect(dead_code, reason = "is given back when it is dropped")] Arc<OwnedSemaphorePermit>,
);

/// The pattern of addresses that a request's matched.
pub(crate) fn route(request: &Request) -> Route {
    let pattern = request.extensions().get::<MatchedPath>();
    Route::of(pattern.map(MatchedPath::as_str), request.uri().path())
}

/// What holds for every request: there is a place for it, it has no body, and its answer begins in time. Those who
/// look after the server always get in.
pub(crate) async fn admit(
    State(shared): State<Arc<Shared>>,
    request: Request,
    next: Next,
) -> Result<Response, Failure> {
    if !request.body().is_end_stream() {
        return Err(Failure::body_not_allowed());
    }
    let place = match Arc::clone(&shared.requests).try_acquire_owned() {
        _ if route(&request) == Route::Status => None,
        Ok(permit) => Some(Place(Arc::new(permit))),
        Err(_) => {
            shared.metrics.shed.add(1);
            return Err(Failure::busy());
        }
    };
    let answer = tokio::time::timeout(shared.options.request_timeout, next.run(request));
    let mut answer = answer.await.map_err(|_| Failure::busy())?;
    if let Some(place) = place {
        answer.extensions_mut().insert(place);
    }
    Ok(answer)
}

/// Lets pass who has a token of the collection, or everybody if it has none.
pub(crate) async fn authorize(
    State(service): State<Arc<Service>>,
    request: Request,
    next: Next,
) -> Result<Response, Failure> {
    let tokens = &service.collection.tokens;
    if !tokens.is_empty() && !known(tokens, request.headers()) {
        return Err(Failure::unauthorized());
    }
    Ok(next.run(request).await)
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
    use axum::http::HeaderValue;

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
