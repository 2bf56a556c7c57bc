//! What those who look after the server ask for: is it alive, does it want requests, what has it done.

use std::sync::{Arc, atomic::Ordering};

use axum::{
    Router,
    extract::State,
    http::header,
    response::{IntoResponse, Response},
    routing::get,
};

use crate::{collection::Entry, failure::Failure, metrics::Levels, service::Shared};

const NOT_KEPT: (header::HeaderName, &str) = (header::CACHE_CONTROL, "no-store");

pub(crate) fn routes(shared: &Arc<Shared>) -> Router {
    Router::new()
        .route("/health", get(async || ([NOT_KEPT], "ok\n")))
        .route("/ready", get(ready))
        .route("/metrics", get(metrics))
        .with_state(Arc::clone(shared))
}

/// Yes if all stores answered when they were last asked, at most [`crate::Options::list_age`] ago, and the service
/// was not told to stop.
async fn ready(State(shared): State<Arc<Shared>>) -> Result<Response, Failure> {
    if shared.draining.load(Ordering::Relaxed) {
        return Err(Failure::not_ready("the server is about to stop"));
    }
    for collection in &shared.collections {
        if !collection
            .fresh(&shared.records.reads, shared.options.list_age)
            .await
            .reachable
        {
            return Err(Failure::not_ready(
                "the archives cannot be listed: the server's log says why",
            ));
        }
    }
    Ok(([NOT_KEPT], "ready\n").into_response())
}

/// Of what was looked at last: being watched costs no store anything.
async fn metrics(State(shared): State<Arc<Shared>>) -> Response {
    let listings: Vec<_> = shared
        .collections
        .iter()
        .map(|collection| collection.listing())
        .collect();
    let entries = || listings.iter().flat_map(|listing| listing.archives.values());
    let archives = entries().filter(|entry| matches!(entry, Entry::Ready(_))).count();
    let levels = Levels {
        cache_bytes: shared.records.cached_bytes(),
        memory_bytes: shared.records.budget.used(),
        archives: archives as u64,
        broken_archives: (entries().count() - archives) as u64,
        ready: listings.iter().all(|listing| listing.reachable) && !shared.draining.load(Ordering::Relaxed),
    };
    let kind = (header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8");
    ([NOT_KEPT, kind], shared.metrics.text(&levels)).into_response()
}
