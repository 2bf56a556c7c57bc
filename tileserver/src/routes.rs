//! Addresses and what they answer.

use std::{borrow::Cow, sync::Arc, time::Duration};

use axum::{
    Extension, Router,
    body::Body,
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header},
    middleware,
    response::Response,
    routing::get,
};
use tileset::{PageId, Tile};
use tower_http::cors::{Any, CorsLayer};
use xxhash_rust::xxh3::xxh3_64;

use crate::{
    Options, Site,
    answer::{self, Fields, Keep},
    batch, conditional,
    failure::Failure,
    guard, log,
    outlet::Outlet,
    parts::FileBody,
    range::{self, Wanted},
    records::What,
    service::{Service, Shared},
    status,
    store::Version,
};

type Serving = State<Arc<Service>>;
type Segments<T> = Result<Path<T>, PathRejection>;
type Answer = Result<Response, Failure>;

/// The service over collections. Needs a tokio runtime; limits on connections are those of whoever runs it.
pub fn router(site: impl Into<Site>, options: &Options) -> Router {
    build(site.into(), options).0
}

/// The service, and what its connections share with it.
pub(crate) fn build(site: Site, options: &Options) -> (Router, Arc<Shared>) {
    let collections: Vec<_> = site
        .collections
        .into_iter()
        .map(|(place, collection)| (place, Arc::new(collection)))
        .collect();
    let all = collections
        .iter()
        .map(|(_, collection)| Arc::clone(collection))
        .collect();
    let shared = Arc::new(Shared::new(options, all, site.static_files));
    let mut router = status::routes(&shared);
    for (place, collection) in collections {
        let service = Arc::new(Service {
            shared: Arc::clone(&shared),
            collection,
        });
        let routes = collection_routes(service);
        router = if place.is_empty() {
            router.merge(routes)
        } else {
            router.nest(&format!("/{place}"), routes)
        };
    }
    let router = router
        .merge(Router::new().fallback(elsewhere).with_state(Arc::clone(&shared)))
        .method_not_allowed_fallback(async || Failure::method_not_allowed())
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), guard::admit))
        .layer(cors())
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), log::access));
    (router, shared)
}

/// Preflights are answered by this layer.
fn cors() -> CorsLayer {
    CorsLayer::new()
        .allow_origin(Any)
        .allow_methods([Method::GET, Method::HEAD, Method::OPTIONS])
        .allow_headers([
            header::AUTHORIZATION,
            header::RANGE,
            header::IF_RANGE,
            header::IF_NONE_MATCH,
            header::CACHE_CONTROL,
            HeaderName::from_static(log::REQUEST_ID),
        ])
        .expose_headers([
            header::ETAG,
            header::CONTENT_RANGE,
            header::CONTENT_LENGTH,
            header::ACCEPT_RANGES,
            header::RETRY_AFTER,
            HeaderName::from_static(log::REQUEST_ID),
        ])
        .max_age(Duration::from_secs(24 * 3600))
}

fn collection_routes(service: Arc<Service>) -> Router {
    Router::new()
        .route("/v1", get(catalogue))
        .route("/v1/", get(catalogue))
        .route("/v1/{file}", get(archive_or_manifest))
        .route("/v1/files/{file}", get(file))
        .route("/v1/files/{hash}/{file}", get(hashed_file))
        .route("/v1/{name}/{id}/index", get(index))
        .route("/v1/{name}/{id}/page/{group}/{mip}/{x}/{y}", get(page))
        .route("/v1/{name}/{id}/column/{group}", get(column))
        .route("/v1/{name}/{id}/batch/{records}", get(records))
        .route_layer(middleware::from_fn_with_state(
            Arc::clone(&service),
            guard::authorize,
        ))
        .with_state(service)
}

async fn catalogue(State(service): Serving, headers: HeaderMap) -> Response {
    answer::document(service.listing().await.catalogue(), &headers, service.private())
}

/// `NAME` is the manifest, `NAME.bsvtf` the archive itself; no archive has a name with that ending.
async fn archive_or_manifest(
    State(service): Serving,
    method: Method,
    headers: HeaderMap,
    file: Segments<String>,
) -> Answer {
    let Path(file) = segments(file)?;
    match file.strip_suffix(".bsvtf") {
        Some(name) => archive(&service, name, &method, &headers).await,
        None => {
            let served = service.newest(&file).await?;
            Ok(answer::document(&served.manifest, &headers, service.private()))
        }
    }
}

async fn archive(service: &Service, name: &str, method: &Method, headers: &HeaderMap) -> Answer {
    let served = service.newest(name).await?;
    let fields = Fields::binary(format!("\"{}\"", served.id()), Keep::Shortly, service.private());
    stored(service, fields, Arc::clone(&served.version), method, headers)
}

/// A file beside the archives, as it is now.
async fn file(State(service): Serving, method: Method, headers: HeaderMap, path: Segments<String>) -> Answer {
    let Path(name) = segments(path)?;
    beside(&service, &name, None, &method, &headers).await
}

/// A file beside the archives, with the hash of its content.
async fn hashed_file(
    State(service): Serving,
    method: Method,
    headers: HeaderMap,
    path: Segments<(String, String)>,
) -> Answer {
    let Path((hash, name)) = segments(path)?;
    beside(&service, &name, Some(&hash), &method, &headers).await
}

async fn beside(
    service: &Service,
    name: &str,
    hash: Option<&str>,
    method: &Method,
    headers: &HeaderMap,
) -> Answer {
    let (fields, version) = service.beside(name, hash).await?;
    let mut response = stored(service, fields, version, method, headers)?;
    // Whatever it holds, it is what its ending says.
    let nosniff = HeaderValue::from_static("nosniff");
    response
        .headers_mut()
        .insert(header::X_CONTENT_TYPE_OPTIONS, nosniff);
    Ok(response)
}

/// A whole file or ranges of it, as it stands in the store.
fn stored(
    service: &Service,
    mut fields: Fields,
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
    let (status, content_range, body) = match wanted {
        Wanted::Refused(detail) => return Err(Failure::range_not_satisfiable(detail, length)),
        Wanted::Whole => (StatusCode::OK, None, FileBody::one(version, records, 0..length)),
        Wanted::Parts(ranges) if ranges.len() == 1 => {
            let range = ranges[0].clone();
            let field = format!("bytes {}-{}/{length}", range.start, range.end - 1);
            let body = FileBody::one(version, records, range);
            (StatusCode::PARTIAL_CONTENT, Some(field), body)
        }
        Wanted::Parts(ranges) => {
            // Anything that does not stand in the file; its ETag and the ranges make that as sure as can be.
            let boundary = format!(
                "{:016x}",
                xxh3_64(format!("{}{ranges:?}", fields.etag).as_bytes())
            );
            let kind = HeaderValue::try_from(format!("multipart/byteranges; boundary={boundary}"));
            let of_parts = std::mem::replace(&mut fields.kind, kind.unwrap_or(HeaderValue::from_static("")));
            let of_parts = of_parts.to_str().unwrap_or_default();
            let body = FileBody::multipart(version, records, ranges, of_parts, &boundary);
            (StatusCode::PARTIAL_CONTENT, None, body)
        }
    };
    let mut response = fields.response(status);
    let out = response.headers_mut();
    out.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    out.insert(header::CONTENT_LENGTH, body.bytes().into());
    out.extend(content_range.and_then(|field| Some((header::CONTENT_RANGE, field.try_into().ok()?))));
    *response.body_mut() = Body::new(body);
    Ok(response)
}

/// A file of the web page, or nothing.
async fn elsewhere(
    State(shared): State<Arc<Shared>>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let path = percent_decode(uri.path());
    match path.and_then(|path| shared.static_files.find(&path)) {
        Some(_) if method != Method::GET && method != Method::HEAD => Err(Failure::method_not_allowed()),
        Some(file) => Ok(answer::static_file(file, &headers)),
        None => Err(Failure::not_found(
            "no such address: GET /v1/ lists what there is",
        )),
    }
}

/// A path without escapes; `None` if it is no UTF-8.
fn percent_decode(path: &str) -> Option<Cow<'_, str>> {
    if !path.contains('%') {
        return Some(path.into());
    }
    let (mut bytes, mut rest) = (Vec::with_capacity(path.len()), path.as_bytes());
    while let [first, tail @ ..] = rest {
        let digits = tail
            .get(..2)
            .filter(|digits| *first == b'%' && digits.iter().all(u8::is_ascii_hexdigit));
        let escaped =
            digits.and_then(|digits| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
        bytes.push(escaped.unwrap_or(*first));
        rest = &tail[if escaped.is_some() { 2 } else { 0 }..];
    }
    String::from_utf8(bytes).ok().map(Cow::Owned)
}

async fn index(State(service): Serving, headers: HeaderMap, path: Segments<(String, String)>) -> Answer {
    let Path((name, id)) = segments(path)?;
    let served = service.pinned(&name, &id).await?;
    let etag = format!("\"{id}\"");
    record(&service, &headers, served, What::Index, etag).await
}

async fn page(
    State(service): Serving,
    headers: HeaderMap,
    path: Segments<(String, String, String, String, String, String)>,
) -> Answer {
    let Path((name, id, group, mip, x, y)) = segments(path)?;
    let tile = Tile {
        mip: number("mip", &mip)?,
        x: number("x", &x)?,
        y: number("y", &y)?,
    };
    let page = PageId {
        group: number("group", &group)?,
        tile,
    };
    let served = service.pinned(&name, &id).await?;
    let hash = served.index.page(page).map_err(not_in_archive)?.hash;
    record(
        &service,
        &headers,
        served,
        What::Page(page),
        format!("\"{hash:08x}\""),
    )
    .await
}

async fn column(
    State(service): Serving,
    headers: HeaderMap,
    path: Segments<(String, String, String)>,
) -> Answer {
    let Path((name, id, group)) = segments(path)?;
    let group: u16 = number("group", &group)?;
    let served = service.pinned(&name, &id).await?;
    let hash = served.index.column(group).map_err(not_in_archive)?.hash;
    record(
        &service,
        &headers,
        served,
        What::Column(group),
        format!("\"{hash:08x}\""),
    )
    .await
}

async fn record(
    service: &Service,
    headers: &HeaderMap,
    served: Arc<crate::collection::Served>,
    what: What,
    etag: String,
) -> Answer {
    let fields = Fields::binary(etag, Keep::ForGood, service.private());
    if fields.known(headers) {
        return Ok(fields.not_modified());
    }
    Ok(fields.whole(service.read(served, what).await?))
}

/// Many records at once.
async fn records(
    State(service): Serving,
    headers: HeaderMap,
    outlet: Option<Extension<Outlet>>,
    path: Segments<(String, String, String)>,
) -> Answer {
    let Path((name, id, list)) = segments(path)?;
    let wanted = batch::wanted(&list)?;
    let served = service.pinned(&name, &id).await?;
    let fields = Fields::binary(batch::etag(&served, &list), Keep::ForGood, service.private());
    if fields.known(&headers) {
        return Ok(fields.not_modified());
    }
    let mut response = fields.response(StatusCode::OK);
    let outlet = outlet.map(|Extension(outlet)| outlet);
    *response.body_mut() = batch::body(served, Arc::clone(&service.shared.records), wanted, outlet);
    Ok(response)
}

/// Segments of the path, unescaped.
fn segments<T>(path: Segments<T>) -> Result<Path<T>, Failure> {
    path.map_err(|error| Failure::bad_request(error.body_text()))
}

/// A number in a path, in the one way it is written: each record has one address.
pub(crate) fn number<T: std::str::FromStr>(what: &str, digits: &str) -> Result<T, Failure> {
    let canonical =
        digits.bytes().all(|byte| byte.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
    let number = digits.parse().ok().filter(|_| canonical);
    number.ok_or_else(|| Failure::bad_request(format!("{what} is {digits:?}, which is no number it can be")))
}

fn not_in_archive(error: tileset::Error) -> Failure {
    Failure::not_found(error.to_string())
}
