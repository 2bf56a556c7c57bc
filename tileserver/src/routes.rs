//! Addresses and what they answer.

use std::{sync::Arc, time::Duration};

use axum::{
    Extension, Router,
    body::Body,
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
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
    parts::ArchiveBody,
    range::{self, Wanted},
    records::What,
    service::{Service, Shared},
    status,
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
    let shared = Arc::new(Shared::new(options, all));
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
        .fallback(async || Failure::not_found("no such address: GET /v1/ lists what there is"))
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

/// The whole archive or ranges of it, as it stands in the store.
async fn archive(service: &Service, name: &str, method: &Method, headers: &HeaderMap) -> Answer {
    let served = service.newest(name).await?;
    let length = served.index.file_bytes;
    let mut fields = Fields::binary(format!("\"{}\"", served.id()), Keep::Shortly, service.private());
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
        Wanted::Whole => (StatusCode::OK, None, ArchiveBody::one(served, records, 0..length)),
        Wanted::Parts(ranges) if ranges.len() == 1 => {
            let range = ranges[0].clone();
            let field = format!("bytes {}-{}/{length}", range.start, range.end - 1);
            (
                StatusCode::PARTIAL_CONTENT,
                Some(field),
                ArchiveBody::one(served, records, range),
            )
        }
        Wanted::Parts(ranges) => {
            // Anything that does not stand in the archive; its id and the ranges make that as sure as can be.
            let boundary = format!(
                "{:016x}",
                xxh3_64(format!("{}{ranges:?}", served.id()).as_bytes())
            );
            let kind = HeaderValue::try_from(format!("multipart/byteranges; boundary={boundary}"));
            fields.kind = kind.unwrap_or(fields.kind);
            let body = ArchiveBody::multipart(served, records, ranges, &boundary);
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
