//! What those who look after the server ask for: is it alive, does it want requests, what has it done.

use std::sync::atomic::Ordering;

use hyper::header::{self, HeaderValue};

use crate::{
    answer::{Answer, Response},
    collection::Entry,
    failure::Failure,
    metrics::Levels,
    service::Shared,
};

pub(crate) fn health() -> Response {
    text("ok\n")
}

/// Yes if all stores answered when they were last asked, at most [`crate::Options::list_age`] ago, and the service
/// was not told to stop.
pub(crate) async fn ready(shared: &Shared) -> Answer {
    if shared.draining.load(Ordering::Relaxed) {
        return Err(Failure::not_ready("the server is about to stop"));
    }
    for (_, collection) in &shared.collections {
        let listing = collection
            .fresh(&shared.records.reads, shared.options.list_age)
            .await;
        if !listing.reachable {
            let detail = "the archives cannot be listed: the server's log says why";
            return Err(Failure::not_ready(detail));
        }
    }
    Ok(text("ready\n"))
}

/// Of what was looked at last: being watched costs no store anything.
pub(crate) fn metrics(shared: &Shared) -> Response {
    let listings = shared
        .collections
        .iter()
        .map(|(_, collection)| collection.listing());
    let listings: Vec<_> = listings.collect();
    let entries = || listings.iter().flat_map(|listing| listing.archives.values());
    let archives = entries().filter(|entry| matches!(entry, Entry::Ready(_))).count();
    let levels = Levels {
        cache_bytes: shared.records.cached_bytes(),
        memory_bytes: shared.records.budget.used(),
        archives: archives as u64,
        broken_archives: (entries().count() - archives) as u64,
        ready: listings.iter().all(|listing| listing.reachable) && !shared.draining.load(Ordering::Relaxed),
    };
    let mut response = text(shared.metrics.text(&levels));
    let kind = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
    response.headers_mut().insert(header::CONTENT_TYPE, kind);
    response
}

fn text(text: impl Into<bytes::Bytes>) -> Response {
    let mut response = Response::new(text.into().into());
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let kind = HeaderValue::from_static("text/plain; charset=utf-8");
    headers.insert(header::CONTENT_TYPE, kind);
    response
}
