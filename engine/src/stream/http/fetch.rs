//! One request: the index of an archive, whose ETag names its content, or a record under that content's address.

use std::{
    collections::HashMap,
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use bytes::Bytes;
use serde::{Deserialize, de::IgnoredAny};
use tileset::{
    archive::{CHECKSUM_BYTES, Index, MAX_INDEX_BYTES},
    codec::{MAX_COLUMN_BYTES, MAX_PAGE_BYTES},
};

use super::{
    super::{Request, Ticket, directories::parse_shared, together::Waiting},
    HttpOptions,
    address::Address,
    batch::{self, Carrier, Frames},
    client::{Begun, Got, HttpClient},
};
use crate::{Error, Result};

/// Largest manifest: 2 × 4096 directions and 1024 singular values take about 0.6 MiB as JSON.
const MAX_MANIFEST_BYTES: u64 = 4 << 20;
/// Largest records, with their checksums.
const MAX_STORED_PAGE_BYTES: u64 = (MAX_PAGE_BYTES + CHECKSUM_BYTES) as u64;
const MAX_STORED_COLUMN_BYTES: u64 = (MAX_COLUMN_BYTES + CHECKSUM_BYTES) as u64;
/// Archives that are known by name at the same time.
const MAX_ARCHIVES: usize = 4096;

/// The archive that requests are for, as its index or, while nobody has asked for that, the server's manifest has it.
#[derive(Clone, Deserialize)]
struct Known {
    /// Content id, 32 hexadecimal digits.
    id: String,
    largest_page_bytes: u64,
    largest_column_bytes: u64,
    #[serde(default)]
    urls: Urls,
    /// What the archive says about its records.
    #[serde(skip)]
    index: Option<Arc<Index>>,
}

/// What the server does.
#[derive(Clone, Default, Deserialize)]
struct Urls {
    /// Many records in one answer.
    batch: Option<IgnoredAny>,
}

impl Known {
    /// As an index says it. If it does not hold, whoever has asked for it will see.
    fn by_index(bytes: &Bytes, id: &str) -> Self {
        Self {
            id: id.to_owned(),
            largest_page_bytes: MAX_STORED_PAGE_BYTES,
            largest_column_bytes: MAX_STORED_COLUMN_BYTES,
            // Who answers for an index by name does batches.
            urls: Urls {
                batch: Some(IgnoredAny),
            },
            index: parse_shared(bytes).ok(),
        }
    }

    /// Most bytes that an answer may have: what the archive says, within what this program accepts.
    fn limit(&self, request: &Request) -> u64 {
        let (largest, most) = match request {
            Request::Index { .. } => (MAX_INDEX_BYTES, MAX_INDEX_BYTES),
            Request::Page { .. } => (self.largest_page_bytes, MAX_STORED_PAGE_BYTES),
            Request::Column { .. } => (self.largest_column_bytes, MAX_STORED_COLUMN_BYTES),
        };
        self.length(request).unwrap_or(largest).min(most)
    }

    /// Bytes of a record, if they are known.
    fn length(&self, request: &Request) -> Option<u64> {
        let record = request.record(self.index.as_ref()?).ok()??;
        Some(record.length.into())
    }
}

/// A request, and what is known of it while it is on its way.
pub(super) struct Flight {
    pub(super) request: Request,
    /// Caches on the way are to ask the server.
    pub(super) anew: bool,
    /// Bytes that were received for it.
    pub(super) wire_bytes: AtomicU64,
    /// Bytes of the record; 0 while it is not known.
    pub(super) length: AtomicU64,
    /// What brings it, once it is sent.
    pub(super) carrier: OnceLock<Arc<Carrier>>,
    /// It is answered, or given up.
    over: AtomicBool,
}

impl Flight {
    pub(super) fn new(request: Request, anew: bool) -> Self {
        Self {
            request,
            anew,
            wire_bytes: AtomicU64::new(0),
            length: AtomicU64::new(0),
            carrier: OnceLock::new(),
            over: AtomicBool::new(false),
        }
    }

    /// It is answered.
    pub(super) fn end(&self) {
        self.leave();
    }

    /// Nobody waits for it. Returns whether it will not come: it was not sent, or nobody waits for anything else that
    /// comes with it, and all is broken off.
    pub(super) fn give_up(&self) -> bool {
        match self.carrier.get() {
            None => true,
            Some(carrier) => {
                let last = self.leave();
                if last {
                    carrier.abort();
                }
                last
            }
        }
    }

    /// Returns whether it was the last one of its carrier.
    fn leave(&self) -> bool {
        let first = !self.over.swap(true, Ordering::Relaxed);
        first && self.carrier.get().is_some_and(|carrier| carrier.leave())
    }
}

impl Waiting for (Ticket, Arc<Flight>) {
    fn request(&self) -> &Request {
        &self.1.request
    }

    fn is_alone(&self) -> bool {
        self.1.anew
    }
}

/// An archive's manifest; the lock is held while it is fetched, so that it is fetched once.
type Slot = Arc<tokio::sync::Mutex<Option<Known>>>;

/// A server, and what is known of its archives.
pub(super) struct Fetcher {
    client: HttpClient,
    address: Address,
    archives: Mutex<HashMap<Arc<str>, Slot>>,
}

impl Fetcher {
    /// # Errors
    /// Those of [`HttpClient::new`].
    pub(super) fn new(address: Address, options: &HttpOptions) -> Result<Self> {
        Ok(Self {
            client: HttpClient::new(options)?,
            address,
            archives: Mutex::default(),
        })
    }

    /// Fetches what is asked for.
    pub(super) async fn fetch(&self, flight: &Flight) -> Result<Bytes> {
        let exchange = Exchange {
            fetcher: self,
            request: &flight.request,
            flight,
        };
        let slot = self.slot(&flight.request)?;
        match flight.request {
            Request::Index { .. } => exchange.index(&slot).await,
            _ => exchange.record(&slot).await,
        }
    }

    /// Whether many records of an archive can be had in one answer, as far as is known.
    pub(super) fn has_batches(&self, archive: &str) -> bool {
        let archives = self.archives.lock().unwrap_or_else(PoisonError::into_inner);
        let known = archives.get(archive).and_then(|slot| slot.try_lock().ok());
        known.is_some_and(|known| known.as_ref().is_some_and(|known| known.urls.batch.is_some()))
    }

    /// Fetches records of one archive in one exchange, and hands each to `answer` as soon as it is there.
    pub(super) async fn fetch_all(&self, flights: &[Arc<Flight>], answer: impl Fn(usize, Result<Bytes>)) {
        let Some(first) = flights.first() else { return };
        let known = match self.slot(&first.request) {
            Ok(slot) => slot.lock().await.clone(),
            Err(_) => None,
        };
        let mut came = 0;
        if let Some(known) = known {
            match self.batch(&known, flights, &mut came, &answer).await {
                Ok(()) => {}
                Err(error) => {
                    for (at, flight) in flights.iter().enumerate().skip(came) {
                        answer(at, Err(worded_again(&error, &flight.request)));
                    }
                    return;
                }
            }
        }
        // The server has no such batch: what it says to each will tell why.
        for (at, flight) in flights.iter().enumerate().skip(came) {
            answer(at, self.fetch(flight).await);
        }
    }

    /// Reads a batch; `came` counts the records that were answered, all unless there is no such batch.
    async fn batch(
        &self,
        known: &Known,
        flights: &[Arc<Flight>],
        came: &mut usize,
        answer: &impl Fn(usize, Result<Bytes>),
    ) -> Result<()> {
        for flight in flights {
            let length = known.length(&flight.request).unwrap_or(0);
            flight.length.store(length, Ordering::Relaxed);
        }
        let list = batch::list(flights);
        let url = self.address.batch(flights[0].request.archive(), &known.id, &list);
        let Begun::Body(mut body, _) = self.client.begin(&url, false, &flights[0].wire_bytes).await? else {
            return Ok(());
        };
        let mut frames = Frames::default();
        while *came < flights.len() {
            let flight = &flights[*came];
            let failed = |detail: String| Error::Source {
                what: url.clone(),
                detail,
            };
            let Some(frame) = frames
                .next(&flight.request, known.limit(&flight.request))
                .map_err(failed)?
            else {
                match self.client.data(&url, &mut body).await? {
                    Some(data) => frames.push(&data),
                    None => {
                        return Err(Error::Unavailable {
                            what: url,
                            detail: format!("the batch ends after {came} of {} records", flights.len()),
                            retry_after: None,
                        });
                    }
                }
                continue;
            };
            let taken = frames.taken(&frame);
            flight.wire_bytes.fetch_add(taken, Ordering::Relaxed);
            let bytes = match batch::answer(&flight.request, &url, frame) {
                Some(bytes) => bytes,
                None => self.fetch(flight).await,
            };
            answer(*came, bytes);
            *came += 1;
        }
        Ok(())
    }

    /// Exchanges with the server so far.
    pub(super) fn exchanges(&self) -> u64 {
        self.client.exchanges()
    }

    /// Bytes so far, wanted or not.
    pub(super) fn received(&self) -> u64 {
        self.client.received()
    }

    /// Where the server is.
    pub(super) fn origin(&self) -> &str {
        self.address.base()
    }

    fn slot(&self, request: &Request) -> Result<Slot> {
        // Under such names a server has the catalogue, and the archives' files.
        if request.archive().is_empty() || request.archive().ends_with(".bsvtf") {
            return Err(Error::NotFound(format!(
                "{request} (names of archives have no extension)"
            )));
        }
        let mut archives = self.archives.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(slot) = archives.get(request.archive()) {
            return Ok(Arc::clone(slot));
        }
        if archives.len() >= MAX_ARCHIVES {
            let detail = format!("more than {MAX_ARCHIVES} archives from one server: use fewer materials");
            return Err(Error::Source {
                what: request.to_string(),
                detail,
            });
        }
        Ok(Arc::clone(
            archives.entry(Arc::clone(request.archive())).or_default(),
        ))
    }
}

/// The same failure for another request of the batch.
fn worded_again(error: &Error, request: &Request) -> Error {
    match error {
        Error::Unavailable {
            detail, retry_after, ..
        } => Error::Unavailable {
            what: request.to_string(),
            detail: detail.clone(),
            retry_after: *retry_after,
        },
        other => Error::Source {
            what: request.to_string(),
            detail: other.to_string(),
        },
    }
}

/// One request on its way: several exchanges with the server.
struct Exchange<'a> {
    fetcher: &'a Fetcher,
    request: &'a Request,
    flight: &'a Flight,
}

impl Exchange<'_> {
    /// The index of the archive that the server has now; from here on records are asked for under its id.
    async fn index(&self, slot: &Slot) -> Result<Bytes> {
        let mut slot = slot.lock().await;
        let url = self.fetcher.address.index(self.request.archive());
        let (bytes, etag) = match self.get(&url, MAX_INDEX_BYTES).await? {
            Got::Bytes(bytes, etag) => (bytes, etag.unwrap_or_default()),
            Got::Missing(detail) => return Err(Error::NotFound(format!("{} ({detail})", self.request))),
        };
        // A proxy that changes nothing else may still make it a weak one.
        let id = etag.trim_start_matches("W/").trim_matches('"');
        if !is_content_id(id) {
            return Err(Error::Source {
                what: url,
                detail: format!(
                    "no index of a tile server (its ETag is {etag:?}, no content id of 32 hexadecimal digits): check the address"
                ),
            });
        }
        *slot = Some(Known::by_index(&bytes, id));
        Ok(bytes)
    }

    async fn record(&self, slot: &Slot) -> Result<Bytes> {
        let known = {
            let mut slot = slot.lock().await;
            match &*slot {
                Some(known) => known.clone(),
                None => slot.insert(self.manifest().await?).clone(),
            }
        };
        let length = known.length(self.request).unwrap_or(0);
        self.flight.length.store(length, Ordering::Relaxed);
        let url = self.fetcher.address.record(self.request, &known.id);
        let detail = match self.get(&url, known.limit(self.request)).await? {
            Got::Bytes(bytes, _) => return Ok(bytes),
            Got::Missing(detail) => detail,
        };
        let now = self.manifest().await?;
        if now.id == known.id {
            return Err(Error::NotFound(format!("{} ({detail})", self.request)));
        }
        // The bytes of another archive would not hold against the directory of this one.
        let detail = format!(
            "the archive changed on the server from {} to {}: load it again",
            known.id, now.id
        );
        Err(Error::Changed {
            what: self.request.to_string(),
            detail,
        })
    }

    async fn manifest(&self) -> Result<Known> {
        let url = self.fetcher.address.manifest(self.request.archive());
        let json = match self.get(&url, MAX_MANIFEST_BYTES).await? {
            Got::Bytes(json, _) => json,
            Got::Missing(detail) => return Err(Error::NotFound(format!("{url} ({detail})"))),
        };
        let refuse = |detail: String| Error::Source {
            what: url.clone(),
            detail,
        };
        let known: Known = serde_json::from_slice(&json).map_err(|error| {
            refuse(format!(
                "no manifest of a tile server ({error}): check the address"
            ))
        })?;
        if !is_content_id(&known.id) {
            return Err(refuse(format!(
                "{:?} is no content id of 32 hexadecimal digits",
                known.id
            )));
        }
        Ok(known)
    }

    async fn get(&self, url: &str, limit: u64) -> Result<Got> {
        let (client, flight) = (&self.fetcher.client, self.flight);
        client.get(url, limit, flight.anew, &flight.wire_bytes).await
    }
}

fn is_content_id(id: &str) -> bool {
    id.len() == 32 && id.bytes().all(|byte| byte.is_ascii_hexdigit())
}
