//! Addresses and what they answer.

use std::{sync::Arc, time::Duration};

use axum::{
    Router,
    body::Body,
    extract::{Path, Request, State, rejection::PathRejection},
    http::{HeaderMap, HeaderValue, Method, StatusCode, header},
    middleware::{self, Next},
    response::Response,
    routing::get,
};
use bytes::Bytes;
use tileset::{PageId, Record, Tile};
use tower_http::cors::{Any, CorsLayer};

use crate::{
    Collection, Options,
    budget::Budget,
    collection::{Entry, Listing, Served},
    conditional,
    documents::{self, etag_of},
    failure::Failure,
    log,
    range::{self, Wanted},
    whole::ArchiveBody,
};

/// For content that never changes at its address.
const IMMUTABLE: &str = "public, max-age=31536000, immutable";
/// For what changes when a file of the folder does.
const SHORT_LIVED: &str = "public, max-age=5, must-revalidate";
const BINARY: &str = "application/octet-stream";
const JSON: &str = "application/json";

/// What all requests share.
struct Service {
    collection: Arc<Collection>,
    budget: Arc<Budget>,
    request_timeout: Duration,
}

type Shared = State<Arc<Service>>;
type Segments<T> = Result<Path<T>, PathRejection>;
type Answer = Result<Response, Failure>;

/// The service over a collection. Needs a tokio runtime; limits on connections are those of whoever runs it.
pub fn router(collection: Collection, options: &Options) -> Router {
    let service = Arc::new(Service {
        collection: Arc::new(collection),
        budget: Arc::new(Budget::new(options)),
        request_timeout: options.request_timeout,
    });
    // Preflights are answered by this layer.
    let cors = CorsLayer::new()
        .allow_origin(Any)
        .allow_methods([Method::GET, Method::HEAD, Method::OPTIONS])
        .allow_headers([
            header::RANGE,
            header::IF_RANGE,
            header::IF_NONE_MATCH,
            header::CACHE_CONTROL,
        ])
        .expose_headers([
            header::ETAG,
            header::CONTENT_RANGE,
            header::CONTENT_LENGTH,
            header::ACCEPT_RANGES,
        ])
        .max_age(Duration::from_secs(24 * 3600));
    Router::new()
        .route(
            "/health",
            get(async || ([(header::CACHE_CONTROL, "no-store")], "ok\n")),
        )
        .route("/v1", get(catalogue))
        .route("/v1/", get(catalogue))
        .route("/v1/{file}", get(archive_or_manifest))
        .route("/v1/{name}/{id}/index", get(index))
        .route("/v1/{name}/{id}/page/{group}/{mip}/{x}/{y}", get(page))
        .route("/v1/{name}/{id}/column/{group}", get(column))
        .fallback(async || Failure::not_found("no such address: GET /v1/ lists what there is"))
        .method_not_allowed_fallback(async || Failure::method_not_allowed())
        .layer(middleware::from_fn_with_state(Arc::clone(&service), guard))
        .layer(cors)
        .layer(middleware::from_fn(log::access))
        .with_state(service)
}

/// What holds for every request: it has no body, and its answer begins in time.
async fn guard(State(service): Shared, request: Request, next: Next) -> Result<Response, Failure> {
    let headers = request.headers();
    let length = headers.get(header::CONTENT_LENGTH);
    if headers.contains_key(header::TRANSFER_ENCODING) || length.is_some_and(|length| length != "0") {
        return Err(Failure::body_not_allowed());
    }
    let answer = tokio::time::timeout(service.request_timeout, next.run(request));
    answer.await.map_err(|_| Failure::busy())
}

async fn catalogue(State(service): Shared, headers: HeaderMap) -> Answer {
    let listing = service.refresh().await?;
    let json = documents::catalogue(&listing);
    let fields = Fields {
        etag: etag_of(&json),
        cache: SHORT_LIVED,
        kind: JSON,
    };
    Ok(if fields.known(&headers) {
        fields.not_modified()
    } else {
        fields.whole(json)
    })
}

/// `NAME` is the manifest, `NAME.bsvtf` the archive itself; no archive has a name with that ending.
async fn archive_or_manifest(
    State(service): Shared,
    method: Method,
    headers: HeaderMap,
    file: Segments<String>,
) -> Answer {
    let Path(file) = segments(file)?;
    match file.strip_suffix(".bsvtf") {
        Some(name) => service.archive(name, &method, &headers).await,
        None => service.manifest(&file, &headers).await,
    }
}

async fn index(State(service): Shared, headers: HeaderMap, path: Segments<(String, String)>) -> Answer {
    let Path((name, id)) = segments(path)?;
    let served = service.pinned(&name, &id).await?;
    let fields = Fields {
        etag: format!("\"{}\"", served.id()),
        cache: IMMUTABLE,
        kind: BINARY,
    };
    if fields.known(&headers) {
        return Ok(fields.not_modified());
    }
    let bytes = service.read(&served, "index", served.prefix_bytes, |served| {
        let prefix = served.archive.prefix()?;
        // The file may have been written over since it was opened.
        let id = tileset::archive::Index::parse(&prefix)?.id;
        if id != served.index().id {
            let (what, detail) = (
                "index".to_owned(),
                format!("content id {id:032x}, expected {}", served.id()),
            );
            return Err(tileset::Error::Corrupt {
                what,
                offset: 0,
                detail,
            });
        }
        Ok(prefix)
    });
    Ok(fields.whole(bytes.await?))
}

async fn page(
    State(service): Shared,
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
    let record = served.index().page(page).map_err(not_in_archive)?;
    service
        .record(&headers, &served, page.to_string(), record, move |served| {
            served.archive.read_page(page)
        })
        .await
}

async fn column(
    State(service): Shared,
    headers: HeaderMap,
    path: Segments<(String, String, String)>,
) -> Answer {
    let Path((name, id, group)) = segments(path)?;
    let group: u16 = number("group", &group)?;
    let served = service.pinned(&name, &id).await?;
    let record = served.index().column(group).map_err(not_in_archive)?;
    let what = format!("column of group {group}");
    service
        .record(&headers, &served, what, record, move |served| {
            served.archive.read_column(group)
        })
        .await
}

impl Service {
    async fn refresh(&self) -> Result<Arc<Listing>, Failure> {
        let collection = Arc::clone(&self.collection);
        self.budget
            .blocking(move || collection.refresh())
            .await?
            .map_err(|error| {
                tracing::error!(%error, "the folder cannot be listed");
                Failure::internal("the folder of the archives cannot be listed: the server's log says why")
            })
    }

    /// The archive of this name as the folder has it now.
    async fn newest(&self, name: &str) -> Result<Arc<Served>, Failure> {
        match self.refresh().await?.get(name) {
            Some(Entry::Ready(served)) => Ok(Arc::clone(served)),
            Some(Entry::Broken { error, .. }) => Err(Failure::corrupt(format!("archive {name:?}: {error}"))),
            None => Err(Failure::no_archive(name)),
        }
    }

    /// The archive with this content. The folder is only looked at if it is not the one that is open.
    async fn pinned(&self, name: &str, id: &str) -> Result<Arc<Served>, Failure> {
        if id.len() != 32 || !id.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f')) {
            return Err(Failure::not_found(format!(
                "{id:?} is no content id: GET /v1/ lists what there is"
            )));
        }
        if let Some(Entry::Ready(served)) = self.collection.listing().get(name)
            && served.id() == id
        {
            return Ok(Arc::clone(served));
        }
        let served = self.newest(name).await?;
        if served.id() == id {
            Ok(served)
        } else {
            Err(Failure::gone(name, &served.id()))
        }
    }

    async fn manifest(&self, name: &str, headers: &HeaderMap) -> Answer {
        let served = self.newest(name).await?;
        let fields = Fields {
            etag: served.manifest_etag.clone(),
            cache: SHORT_LIVED,
            kind: JSON,
        };
        Ok(if fields.known(headers) {
            fields.not_modified()
        } else {
            fields.whole(served.manifest_json.clone())
        })
    }

    /// The whole archive or a range of it, as it stands in the file.
    async fn archive(&self, name: &str, method: &Method, headers: &HeaderMap) -> Answer {
        let served = self.newest(name).await?;
        let length = served.index().file_bytes;
        let fields = Fields {
            etag: format!("\"{}\"", served.id()),
            cache: SHORT_LIVED,
            kind: BINARY,
        };
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
        let (status, range) = match wanted {
            Wanted::Whole => (StatusCode::OK, 0..length),
            Wanted::Part(part) => (StatusCode::PARTIAL_CONTENT, part),
            Wanted::Refused(detail) => return Err(Failure::range_not_satisfiable(detail, length)),
        };
        let mut response = fields.response(status);
        let out = response.headers_mut();
        out.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        out.insert(header::CONTENT_LENGTH, (range.end - range.start).into());
        if status == StatusCode::PARTIAL_CONTENT {
            let content_range = format!("bytes {}-{}/{length}", range.start, range.end - 1);
            out.extend(HeaderValue::try_from(content_range).map(|value| (header::CONTENT_RANGE, value)));
        }
        *response.body_mut() = Body::new(ArchiveBody::new(served, Arc::clone(&self.budget), range));
        Ok(response)
    }

    async fn record(
        &self,
        headers: &HeaderMap,
        served: &Arc<Served>,
        what: String,
        record: Record,
        read: impl FnOnce(&Served) -> tileset::Result<Vec<u8>> + Send + 'static,
    ) -> Answer {
        let fields = Fields {
            etag: format!("\"{:08x}\"", record.hash),
            cache: IMMUTABLE,
            kind: BINARY,
        };
        if fields.known(headers) {
            return Ok(fields.not_modified());
        }
        Ok(fields.whole(self.read(served, &what, record.length.into(), read).await?))
    }

    /// Reads about `length` bytes of an archive with `read`, which checks them.
    async fn read(
        &self,
        served: &Arc<Served>,
        what: &str,
        length: u64,
        read: impl FnOnce(&Served) -> tileset::Result<Vec<u8>> + Send + 'static,
    ) -> Result<Bytes, Failure> {
        let archive = Arc::clone(served);
        self.budget.read(length, move || read(&archive)).await?.map_err(|error| {
            tracing::error!(archive = served.name, id = served.id(), what, %error, "a record does not hold");
            Failure::corrupt(format!("archive {:?}, {what}: it cannot be read or does not hold", served.name))
        })
    }
}

/// What an answer says about its content.
struct Fields {
    etag: String,
    cache: &'static str,
    kind: &'static str,
}

impl Fields {
    /// Whether the client has this content already.
    fn known(&self, headers: &HeaderMap) -> bool {
        conditional::none_match(headers, &self.etag)
    }

    fn response(&self, status: StatusCode) -> Response {
        let mut response = Response::default();
        *response.status_mut() = status;
        let headers = response.headers_mut();
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(self.cache));
        headers.extend(HeaderValue::try_from(&self.etag).map(|etag| (header::ETAG, etag)));
        if status != StatusCode::NOT_MODIFIED {
            headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.kind));
        }
        response
    }

    fn not_modified(&self) -> Response {
        self.response(StatusCode::NOT_MODIFIED)
    }

    fn whole(&self, bytes: Bytes) -> Response {
        let mut response = self.response(StatusCode::OK);
        response
            .headers_mut()
            .insert(header::CONTENT_LENGTH, bytes.len().into());
        *response.body_mut() = Body::from(bytes);
        response
    }
}

/// Segments of the path, unescaped.
fn segments<T>(path: Segments<T>) -> Result<Path<T>, Failure> {
    path.map_err(|error| Failure::bad_request(error.body_text()))
}

/// A number in a path, in the one way it is written: each record has one address.
fn number<T: std::str::FromStr>(what: &str, digits: &str) -> Result<T, Failure> {
    let canonical =
        digits.bytes().all(|byte| byte.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
    let number = digits.parse().ok().filter(|_| canonical);
    number.ok_or_else(|| Failure::bad_request(format!("{what} is {digits:?}, which is no number it can be")))
}

fn not_in_archive(error: tileset::Error) -> Failure {
    Failure::not_found(error.to_string())
}
