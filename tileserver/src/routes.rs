//! Addresses and what they answer.

use std::{
    convert::Infallible,
    future::{Future, poll_fn},
    pin::pin,
    sync::Arc,
    task::Poll,
    time::Duration,
};

use hyper::{
    HeaderMap, Method, Request, StatusCode,
    body::{Body as _, Incoming},
    header::{self, HeaderValue},
    http::request::Parts,
};
use tileset::{PageId, Tile};
use tokio::time::timeout;
use xxhash_rust::xxh3::xxh3_64;

use crate::{
    address::{Address, Content, Record, unescaped},
    answer::{self, Answer, Fields, Keep},
    batch,
    body::Body,
    collection::Served,
    conditional,
    failure::Failure,
    guard,
    log::{Line, Logged},
    metrics::Route,
    parts::FileBody,
    pulse::Pulse,
    range::{self, Wanted},
    records::What,
    service::{Service, Shared},
    status,
    store::Version,
};

/// Answers a request: logged, counted, in its place among others, and in time.
pub(crate) async fn answer(
    shared: Arc<Shared>,
    pulse: Arc<Pulse>,
    request: Request<Incoming>,
) -> Result<hyper::Response<Logged>, Infallible> {
    let (head, body) = request.into_parts();
    let has_body = !body.is_end_stream();
    drop(body);
    let address = Address::of(head.uri.path());
    let route = match address.route() {
        Route::Other if !shared.static_files.is_empty() => Route::Site,
        route => route,
    };
    let mut line = Line::new(shared, &pulse, &head, route);
    let answered = if head.method == Method::OPTIONS {
        Ok(guard::options())
    } else if has_body {
        Err(Failure::body_not_allowed())
    } else {
        match line.enter() {
            Ok(()) => {
                let time = line.shared.options.request_timeout;
                in_time(time, handle(&line.shared, &pulse, &head, address)).await
            }
            Err(busy) => Err(busy),
        }
    };
    let mut response = answered.unwrap_or_else(Failure::response);
    guard::share(response.headers_mut());
    if head.method == Method::HEAD {
        without_body(&mut response);
    }
    Ok(line.answered(response))
}

/// An answer, if it comes in time. Most are there at once: those cost no timer.
async fn in_time(time: Duration, answer: impl Future<Output = Answer>) -> Answer {
    let mut answer = pin!(answer);
    match poll_fn(|context| Poll::Ready(answer.as_mut().poll(context))).await {
        Poll::Ready(answer) => answer,
        Poll::Pending => timeout(time, answer)
            .await
            .unwrap_or_else(|_| Err(Failure::busy())),
    }
}

/// Leaves of a body only its length.
fn without_body(response: &mut answer::Response) {
    if let Some(length) = response.body().size_hint().exact() {
        response
            .headers_mut()
            .insert(header::CONTENT_LENGTH, length.into());
    }
    *response.body_mut() = Body::Empty;
}

async fn handle(shared: &Shared, pulse: &Arc<Pulse>, head: &Parts, address: Address<'_>) -> Answer {
    let Address::In(place, content) = address else {
        return elsewhere(shared, head, address).await;
    };
    let mut collections = shared.collections.iter();
    let Some((_, collection)) = collections.find(|(other, _)| other == place) else {
        return elsewhere(shared, head, Address::Elsewhere).await;
    };
    guard::reads(&head.method)?;
    let service = Service { shared, collection };
    service.authorize(&head.headers)?;
    let (name, id, record) = match content {
        Content::Of(name, id, record) => (segment(name)?, segment(id)?, record),
        // Boxed, as is all that may wait for long: the way to a record that is at hand stays small.
        other => return Box::pin(file(service, head, other)).await,
    };
    let served = service.pinned(&name, &id).await?;
    let not_in_archive = |error: tileset::Error| Failure::not_found(error.to_string());
    let (what, etag) = match record {
        Record::Index => (What::Index, format!("\"{id}\"")),
        Record::Page([group, mip, x, y]) => {
            let page = page(group, mip, x, y)?;
            served.index.page(page).map_err(not_in_archive)?;
            (What::Page(page), record_etag(&served))
        }
        Record::Column(group) => {
            let group = number("group", &segment(group)?)?;
            served.index.column(group).map_err(not_in_archive)?;
            (What::Column(group), record_etag(&served))
        }
        Record::Batch(list) => return many(service, pulse, head, served, list),
    };
    let fields = Fields::binary(etag, Keep::ForGood, service.private());
    if fields.known(&head.headers) {
        return Ok(fields.not_modified());
    }
    Ok(fields.whole(service.read(served, what).await?))
}

/// Of a record. Its address names the archive's content, so that there is only one version of it.
fn record_etag(served: &Served) -> String {
    format!("\"{:08x}\"", served.index.id as u32)
}

/// What belongs to no collection.
async fn elsewhere(shared: &Shared, head: &Parts, address: Address<'_>) -> Answer {
    if address != Address::Elsewhere {
        guard::reads(&head.method)?;
    }
    match address {
        Address::Health => Ok(status::health()),
        Address::Ready => Box::pin(status::ready(shared)).await,
        Address::Metrics => Ok(status::metrics(shared)),
        Address::In(..) | Address::Elsewhere => {
            let path = unescaped(head.uri.path());
            let Some(file) = path.and_then(|path| shared.static_files.find(&path)) else {
                return Err(Failure::not_found(
                    "no such address: GET /v1/ lists what there is",
                ));
            };
            guard::reads(&head.method)?;
            Ok(answer::static_file(file, &head.headers))
        }
    }
}

/// What may be another content later.
async fn file(service: Service<'_>, head: &Parts, content: Content<'_>) -> Answer {
    let (headers, method) = (&head.headers, &head.method);
    match content {
        Content::ManifestOrArchive(file) => {
            let file = segment(file)?;
            let Some(name) = file.strip_suffix(".bsvtf") else {
                let served = service.newest(&file).await?;
                return Ok(answer::document(&served.manifest, headers, service.private()));
            };
            let served = service.newest(name).await?;
            let fields = Fields::binary(format!("\"{}\"", served.id()), Keep::Shortly, service.private());
            stored(service, fields, Arc::clone(&served.version), method, headers)
        }
        Content::Index(name) => {
            let served = service.newest(&segment(name)?).await?;
            let fields = Fields::binary(format!("\"{}\"", served.id()), Keep::Shortly, service.private());
            if fields.known(headers) {
                return Ok(fields.not_modified());
            }
            Ok(fields.whole(service.read(served, What::Index).await?))
        }
        Content::Beside(hash, name) => {
            let (fields, version) = service.beside(&segment(name)?, hash).await?;
            let mut response = stored(service, fields, version, method, headers)?;
            // Whatever it holds, it is what its ending says.
            let nosniff = HeaderValue::from_static("nosniff");
            response
                .headers_mut()
                .insert(header::X_CONTENT_TYPE_OPTIONS, nosniff);
            Ok(response)
        }
        Content::Catalogue | Content::Of(..) => {
            let listing = service.listing().await;
            Ok(answer::document(listing.catalogue(), headers, service.private()))
        }
    }
}

/// Many records at once.
fn many(service: Service<'_>, pulse: &Arc<Pulse>, head: &Parts, served: Arc<Served>, list: &str) -> Answer {
    let list = segment(list)?;
    let wanted = batch::wanted(&list)?;
    let fields = Fields::binary(batch::etag(&served, &list), Keep::ForGood, service.private());
    if fields.known(&head.headers) {
        return Ok(fields.not_modified());
    }
    let mut response = fields.response(StatusCode::OK);
    let records = Arc::clone(&service.shared.records);
    *response.body_mut() = batch::body(served, records, wanted, Arc::clone(pulse));
    Ok(response)
}

/// A whole file or ranges of it, as it stands in the store.
fn stored(
    service: Service<'_>,
    fields: Fields,
    version: Arc<dyn Version>,
    method: &Method,
    headers: &HeaderMap,
) -> Answer {
    let length = version.bytes();
    if !conditional::matches(headers, &fields.etag) {
        return Err(Failure::precondition_failed());
    }
    if fields.known(headers) {
        return Ok(fields.not_modified());
    }
    // A range means something for GET only (RFC 9110, section 14.2).
    let range = headers.get(header::RANGE).filter(|_| *method == Method::GET);
    let wanted = match range {
        Some(field) if conditional::range_applies(headers, &fields.etag) => {
            range::wanted(field.to_str().unwrap_or_default(), length)
        }
        _ => Wanted::Whole,
    };
    let records = Arc::clone(&service.shared.records);
    let (status, field, body) = match wanted {
        Wanted::Refused(detail) => return Err(Failure::range_not_satisfiable(detail, length)),
        Wanted::Whole => (StatusCode::OK, None, FileBody::one(version, records, 0..length)),
        Wanted::Parts(ranges) if ranges.len() == 1 => {
            let range = ranges[0].clone();
            let field = format!("bytes {}-{}/{length}", range.start, range.end - 1);
            let body = FileBody::one(version, records, range);
            (
                StatusCode::PARTIAL_CONTENT,
                Some((header::CONTENT_RANGE, field)),
                body,
            )
        }
        Wanted::Parts(ranges) => {
            // Anything that does not stand in the file; its ETag and the ranges make that as sure as can be.
            let boundary = format!(
                "{:016x}",
                xxh3_64(format!("{}{ranges:?}", fields.etag).as_bytes())
            );
            let field = format!("multipart/byteranges; boundary={boundary}");
            let body = FileBody::multipart(version, records, ranges, fields.kind, &boundary);
            (
                StatusCode::PARTIAL_CONTENT,
                Some((header::CONTENT_TYPE, field)),
                body,
            )
        }
    };
    let mut response = fields.response(status);
    let out = response.headers_mut();
    out.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    if let Some((name, value)) = field
        && let Ok(value) = HeaderValue::try_from(value)
    {
        out.insert(name, value);
    }
    *response.body_mut() = Body::File(Box::new(body));
    Ok(response)
}

/// A segment of the path, unescaped.
fn segment(segment: &str) -> Result<std::borrow::Cow<'_, str>, Failure> {
    unescaped(segment).ok_or_else(|| Failure::bad_request(format!("{segment:?} in the path is no UTF-8")))
}

fn page(group: &str, mip: &str, x: &str, y: &str) -> Result<PageId, Failure> {
    let tile = Tile {
        mip: number("mip", &segment(mip)?)?,
        x: number("x", &segment(x)?)?,
        y: number("y", &segment(y)?)?,
    };
    let group = number("group", &segment(group)?)?;
    Ok(PageId { group, tile })
}

/// A number in a path, in the one way it is written: each record has one address.
pub(crate) fn number<T: std::str::FromStr>(what: &str, digits: &str) -> Result<T, Failure> {
    let canonical =
        digits.bytes().all(|byte| byte.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
    let number = digits.parse().ok().filter(|_| canonical);
    number.ok_or_else(|| Failure::bad_request(format!("{what} is {digits:?}, which is no number it can be")))
}
