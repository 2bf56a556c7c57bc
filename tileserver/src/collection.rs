//! The archives of a store: found by listing it, opened once, opened again when they change.

use std::{
    collections::BTreeMap,
    path::Path,
    sync::{Arc, OnceLock, PoisonError, RwLock},
    time::{Duration, Instant},
};

use futures_util::{StreamExt, stream};
use tileset::archive::{HEADER_BYTES, Index};
use tokio::sync::Mutex;

use crate::{
    Error, Options, Result,
    beside::{self, Beside},
    documents::{self, Document},
    reads::Reads,
    store::{Folder, Identity, Listed, Objects, Store, StoreError, Version, archive_name},
};

/// Archives of a collection that are served, the first ones by name. Each may be an open file, and a process may
/// often have only 1024 of these, connections included.
pub const MAX_ARCHIVES: usize = 256;
/// Archives that are opened at the same time.
const OPENING: usize = 8;

/// Archives that are served.
///
/// Requests are looked up in the list of the store by name; no path is ever made of what a client sends.
pub struct Collection {
    store: Arc<dyn Store>,
    listing: RwLock<Arc<Listing>>,
    refreshing: Mutex<()>,
    /// See [`Self::with_tokens`].
    pub(crate) tokens: Vec<String>,
}

/// What was there at a time.
#[derive(Default)]
pub(crate) struct Listing {
    pub(crate) archives: BTreeMap<String, Entry>,
    /// What lies beside them, by file name.
    pub(crate) files: BTreeMap<String, Beside>,
    /// When the store was asked; `None` before the first time.
    asked: Option<Instant>,
    /// Whether it answered. If not, the archives are those of the time before.
    pub(crate) reachable: bool,
    catalogue: OnceLock<Document>,
}

impl Listing {
    /// The catalogue, made when it is first asked for.
    pub(crate) fn catalogue(&self) -> &Document {
        self.catalogue
            .get_or_init(|| documents::catalogue(&self.archives, &self.files))
    }
}

/// An archive of the list.
#[derive(Clone)]
pub(crate) enum Entry {
    Ready(Arc<Served>),
    /// Cannot be served, and why; looked at again when it changes, or if the fault may pass.
    Broken {
        listed: Option<Identity>,
        error: Arc<str>,
    },
}

/// An archive that is served.
pub(crate) struct Served {
    pub(crate) name: String,
    pub(crate) index: Index,
    pub(crate) version: Arc<dyn Version>,
    /// Length of header, manifest and directory.
    pub(crate) prefix_bytes: u64,
    pub(crate) manifest: Document,
    /// What the list said when it was opened.
    listed: Identity,
}

impl Served {
    /// The content id as it stands in addresses: 32 hexadecimal digits.
    pub(crate) fn id(&self) -> String {
        format!("{:032x}", self.index.id)
    }
}

impl Collection {
    /// Lists a folder and opens its archives. One that is damaged is reported in the log and in the catalogue,
    /// and does not keep the others from being served. Blocks.
    ///
    /// # Errors
    /// [`Error::Folder`] if the folder cannot be listed.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self> {
        let folder = folder.as_ref();
        let refuse = |source| Error::Folder {
            path: folder.to_owned(),
            source,
        };
        let store = Arc::new(Folder::new(folder)?);
        // A thread of its own, because the caller may be in a runtime already, or have none.
        std::thread::scope(|scope| {
            let open = || {
                let runtime = tokio::runtime::Builder::new_current_thread()
                    .enable_time()
                    .build();
                runtime
                    .map_err(refuse)?
                    .block_on(Self::of(store, &folder.display().to_string()))
            };
            let opened = scope.spawn(open).join();
            opened.unwrap_or_else(|_| Err(refuse(std::io::Error::other("reading it has failed"))))
        })
    }

    /// Opens what a path or a URL leads to: see [`Folder`] and [`Objects::from_url`].
    ///
    /// # Errors
    /// [`Error::Folder`], [`Error::Source`] if it cannot be listed.
    pub async fn from_url(source: &str) -> Result<Self> {
        if source.contains("://") {
            Self::of(Arc::new(Objects::from_url(source)?), source).await
        } else {
            Self::of(Arc::new(Folder::new(source)?), source).await
        }
    }

    /// Lists a store and opens its archives. `name` is for messages.
    ///
    /// # Errors
    /// [`Error::Source`] if it cannot be listed.
    pub async fn of(store: Arc<dyn Store>, name: &str) -> Result<Self> {
        let collection = Self {
            store,
            listing: RwLock::default(),
            refreshing: Mutex::new(()),
            tokens: Vec::new(),
        };
        let reads = Reads::new(&Options::default(), Arc::default());
        collection.refresh(&reads).await.map_err(|error| Error::Source {
            url: name.to_owned(),
            reason: error.to_string(),
        })?;
        Ok(collection)
    }

    /// Answers only requests with one of these bearer tokens; without tokens, all.
    #[must_use]
    pub fn with_tokens(self, tokens: Vec<String>) -> Self {
        Self { tokens, ..self }
    }

    /// Names of the archives that can be served, in order.
    pub fn names(&self) -> Vec<String> {
        let listing = self.listing();
        let ready = listing
            .archives
            .iter()
            .filter(|(_, entry)| matches!(entry, Entry::Ready(_)));
        ready.map(|(name, _)| name.clone()).collect()
    }

    /// Archives as they were listed last.
    pub(crate) fn listing(&self) -> Arc<Listing> {
        Arc::clone(&self.listing.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Opens a file of the list as it is now.
    pub(crate) async fn open_file(
        &self,
        reads: &Reads,
        file: &str,
    ) -> std::result::Result<Arc<dyn Version>, StoreError> {
        reads.ask(|| self.store.open(file)).await
    }

    /// Archives as they are now, or were at most `age` ago. One look at the store serves all who ask meanwhile, and
    /// goes on when they leave. Where the store does not answer, the last list stands.
    pub(crate) async fn fresh(self: &Arc<Self>, reads: &Arc<Reads>, age: Duration) -> Arc<Listing> {
        let now = Instant::now();
        let known = self.listing();
        if known.asked.is_some_and(|asked| asked + age >= now) {
            return known;
        }
        let (collection, reads) = (Arc::clone(self), Arc::clone(reads));
        let look = tokio::spawn(async move {
            let _one_at_a_time = collection.refreshing.lock().await;
            let known = collection.listing();
            if known.asked.is_some_and(|asked| asked + age >= now) {
                return;
            }
            if let Err(error) = collection.refresh(&reads).await {
                tracing::error!(%error, "the archives cannot be listed: those known are served on");
                collection.replace(Listing {
                    archives: known.archives.clone(),
                    files: known.files.clone(),
                    asked: Some(now),
                    ..Listing::default()
                });
            }
        });
        let _ = look.await; // A panic is in the log; the last list stands.
        self.listing()
    }

    /// Lists the store again, opens what is new or has changed, and puts the new list in the place of the old one
    /// at once. Requests that hold an archive of the old list keep it.
    async fn refresh(&self, reads: &Reads) -> std::result::Result<(), StoreError> {
        let (old, asked) = (self.listing(), Instant::now());
        let listed = reads.ask(|| self.store.list()).await?;
        let files = beside::look(&*self.store, reads, &listed, &old.files).await;
        let archives = listed.into_iter().filter_map(|listed| {
            let name = archive_name(&listed.file)?.to_owned();
            Some((name, listed))
        });
        let archives: Vec<_> = archives.collect();
        let known = &old.archives;
        let entries = stream::iter(archives).map(|(name, listed)| async move {
            let entry = self.entry(reads, &name, &listed, known.get(&name)).await;
            (name, entry)
        });
        let archives = entries.buffered(OPENING).collect().await;
        self.replace(Listing {
            archives,
            files,
            asked: Some(asked),
            reachable: true,
            catalogue: OnceLock::new(),
        });
        Ok(())
    }

    fn replace(&self, listing: Listing) {
        *self.listing.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(listing);
    }

    /// The old entry of an archive if it has not changed, else a new one.
    async fn entry(&self, reads: &Reads, name: &str, listed: &Listed, old: Option<&Entry>) -> Entry {
        let identity = match &listed.identity {
            Ok(identity) => identity,
            Err(error) => return broken(name, None, error, old),
        };
        match old {
            Some(Entry::Ready(served)) if served.listed == *identity => {
                return Entry::Ready(Arc::clone(served));
            }
            Some(Entry::Broken { listed, .. }) if listed.as_ref() == Some(identity) => {
                return old
                    .cloned()
                    .unwrap_or_else(|| broken(name, None, "not there", None));
            }
            _ => {}
        }
        match Served::open(&*self.store, reads, name, &listed.file, identity).await {
            Ok(served) => {
                tracing::info!(
                    archive = name,
                    id = served.id(),
                    bytes = served.index.file_bytes,
                    "serving"
                );
                Entry::Ready(Arc::new(served))
            }
            Err((error, true)) => match old {
                // What it was may still be read; the next look tries again.
                Some(Entry::Ready(served)) => Entry::Ready(Arc::clone(served)),
                _ => broken(name, None, &error, old),
            },
            Err((error, false)) => broken(name, Some(identity.clone()), &error, old),
        }
    }
}

fn broken(name: &str, listed: Option<Identity>, error: &str, old: Option<&Entry>) -> Entry {
    if !matches!(old, Some(Entry::Broken { error: known, .. }) if **known == *error) {
        tracing::warn!(archive = name, error, "not serving");
    }
    Entry::Broken {
        listed,
        error: error.into(),
    }
}

impl Served {
    /// Opens an archive. Errors are for clients as well, so they name no path of this machine; `true` with those
    /// that may pass.
    async fn open(
        store: &dyn Store,
        reads: &Reads,
        name: &str,
        file: &str,
        listed: &Identity,
    ) -> std::result::Result<Self, (String, bool)> {
        let of_store = |error: StoreError| {
            let passes = !matches!(error, StoreError::Refused(_));
            (error.to_string(), passes)
        };
        let of_archive = |error: tileset::Error| (error.to_string(), false);
        let version = reads.ask(|| store.open(file)).await.map_err(of_store)?;
        let length = version.bytes();
        let cut = |needed: u64| (format!("it ends at byte {length}, {needed} are needed"), false);
        let header_bytes = length.min(HEADER_BYTES as u64);
        let header = reads.read(&*version, 0..header_bytes).await.map_err(of_store)?;
        let prefix_bytes = Index::prefix_bytes(&header).map_err(of_archive)?;
        if prefix_bytes > length {
            return Err(cut(prefix_bytes));
        }
        let prefix = reads.read(&*version, 0..prefix_bytes).await.map_err(of_store)?;
        let index = Index::parse(&prefix).map_err(of_archive)?;
        if index.file_bytes != length {
            return Err(cut(index.file_bytes));
        }
        Ok(Self {
            name: name.to_owned(),
            manifest: documents::manifest(name, &index, prefix_bytes),
            index,
            version,
            prefix_bytes,
            listed: listed.clone(),
        })
    }
}
