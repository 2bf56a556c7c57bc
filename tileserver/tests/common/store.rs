//! A store in memory that fails on request.

use std::{
    collections::{BTreeMap, VecDeque},
    ops::Range,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering},
    },
};

use tileserver::store::{Answer, Identity, Listed, Store, StoreError, Version};
use tokio::sync::Notify;

/// What happens to a read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Fault {
    /// As with status 500 or 503, or a length that is wrong.
    Unavailable,
    /// Bytes that are not those of the archive.
    Garbage,
    /// No answer.
    Never,
}

/// An archive, and what its content is known by.
type Stored = (Identity, Arc<Vec<u8>>);

/// Archives, and what shall go wrong.
#[derive(Default)]
pub(crate) struct Faulty(Arc<Inner>);

#[derive(Default)]
pub(crate) struct Inner {
    archives: Mutex<BTreeMap<String, Stored>>,
    versions: AtomicU64,
    faults: Mutex<VecDeque<Fault>>,
    pub(crate) reads: AtomicUsize,
    /// Reads from here on wait for [`Faulty::open_gate`].
    gate: Mutex<Option<u64>>,
    opened: Notify,
    pub(crate) unlisted: AtomicBool,
}

impl Clone for Faulty {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl std::ops::Deref for Faulty {
    type Target = Inner;
    fn deref(&self) -> &Inner {
        &self.0
    }
}

impl Faulty {
    pub(crate) fn put(&self, name: &str, bytes: Vec<u8>) {
        let version = self.versions.fetch_add(1, Ordering::Relaxed);
        let content = (Identity::new(version.to_string()), Arc::new(bytes));
        self.archives.lock().unwrap().insert(name.to_owned(), content);
    }

    /// What happens to the next reads.
    pub(crate) fn fail(&self, faults: impl IntoIterator<Item = Fault>) {
        *self.faults.lock().unwrap() = faults.into_iter().collect();
    }

    pub(crate) fn close_gate(&self, from: u64) {
        *self.gate.lock().unwrap() = Some(from);
    }

    pub(crate) fn open_gate(&self) {
        *self.gate.lock().unwrap() = None;
        self.opened.notify_waiters();
    }

    pub(crate) fn reads(&self) -> usize {
        self.reads.load(Ordering::Relaxed)
    }
}

impl Store for Faulty {
    fn list(&self) -> Answer<'_, Vec<Listed>> {
        Box::pin(async {
            if self.unlisted.load(Ordering::Relaxed) {
                return Err(StoreError::Refused("no list today".into()));
            }
            let archives = self.archives.lock().unwrap();
            let listed = archives.iter().map(|(name, (identity, bytes))| Listed {
                file: format!("{name}.bsvtf"),
                identity: Ok(identity.clone()),
                bytes: bytes.len() as u64,
            });
            Ok(listed.collect())
        })
    }

    fn open<'a>(&'a self, file: &'a str) -> Answer<'a, Arc<dyn Version>> {
        Box::pin(async move {
            let name = file.strip_suffix(".bsvtf").ok_or(StoreError::NotFound)?;
            let (identity, bytes) = self
                .archives
                .lock()
                .unwrap()
                .get(name)
                .cloned()
                .ok_or(StoreError::NotFound)?;
            Ok(Arc::new(Content {
                store: self.clone(),
                name: name.to_owned(),
                identity,
                bytes,
            }) as Arc<dyn Version>)
        })
    }
}

struct Content {
    store: Faulty,
    name: String,
    identity: Identity,
    bytes: Arc<Vec<u8>>,
}

impl Version for Content {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn bytes(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read(&self, range: Range<u64>) -> Answer<'_, Vec<u8>> {
        Box::pin(async move {
            self.store.reads.fetch_add(1, Ordering::Relaxed);
            loop {
                let opened = self.store.opened.notified();
                let gate = *self.store.gate.lock().unwrap();
                if gate.is_none_or(|from| range.start < from) {
                    break;
                }
                opened.await;
            }
            let now = self
                .store
                .archives
                .lock()
                .unwrap()
                .get(&self.name)
                .map(|(identity, _)| identity.clone());
            if now.as_ref() != Some(&self.identity) {
                return Err(StoreError::Changed);
            }
            let bytes = self.bytes[range.start as usize..range.end as usize].to_vec();
            let fault = self.store.faults.lock().unwrap().pop_front();
            match fault {
                None => Ok(bytes),
                Some(Fault::Unavailable) => Err(StoreError::Unavailable("status 500".into())),
                Some(Fault::Garbage) => Ok(bytes.iter().map(|byte| !byte).collect()),
                Some(Fault::Never) => std::future::pending().await,
            }
        })
    }
}
