//! The directories of archives, parsed once for all that look into them.
//!
//! Sources and decorators on top of each other, and several sources of one program, often need the same directory, of
//! many megabytes for a large archive. Its content is its name, so that one copy can serve all.

use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError, Weak},
};

use bytes::Bytes;
use tileset::archive::Index;
use xxhash_rust::xxh3::xxh3_128;

use super::Request;
use crate::Result;

/// Indices that somebody holds, by the hash of their bytes.
static SHARED: Mutex<Vec<(u128, Weak<Index>)>> = Mutex::new(Vec::new());

/// The index in an archive's prefix; the one that was parsed before, if that is still in use.
///
/// # Errors
/// Those of [`Index::parse`].
pub fn parse_shared(prefix: &[u8]) -> Result<Arc<Index>> {
    let hash = xxh3_128(prefix);
    let known = |shared: &[(u128, Weak<Index>)]| {
        let (_, index) = shared.iter().find(|(known, _)| *known == hash)?;
        index.upgrade()
    };
    let lock = || SHARED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(index) = known(&lock()) {
        return Ok(index);
    }
    // Not under the lock: large ones take a while.
    let index = Arc::new(Index::parse(prefix)?);
    let mut shared = lock();
    shared.retain(|(_, index)| index.strong_count() > 0);
    shared.push((hash, Arc::downgrade(&index)));
    Ok(index)
}

/// What a decorator knows of the archives that were asked for.
#[derive(Default)]
pub(super) struct Directories {
    by_archive: HashMap<Arc<str>, Arc<Index>>,
}

impl Directories {
    /// Takes an index that has come; returns it.
    pub(super) fn learn(&mut self, archive: &Arc<str>, prefix: &Bytes) -> Result<Arc<Index>> {
        let index = parse_shared(prefix)?;
        self.by_archive.insert(Arc::clone(archive), Arc::clone(&index));
        Ok(index)
    }

    /// The index of an archive, once it has come.
    pub(super) fn get(&self, archive: &str) -> Option<&Arc<Index>> {
        self.by_archive.get(archive)
    }

    /// Takes an index, and checks a record against the one that was taken before. This is the one place where what
    /// comes from outside is held against its checksum. `None` where there is no index to check against.
    pub(super) fn check(&mut self, request: &Request, bytes: &Bytes) -> Option<Result<()>> {
        if let Request::Index { archive } = request {
            return Some(self.learn(archive, bytes).map(|_| ()));
        }
        let index = self.by_archive.get(request.archive())?;
        Some(match request.record(index) {
            Ok(Some(record)) => match index.verify(&request.to_string(), record, bytes) {
                Ok(_) => Ok(()),
                Err(error) => Err(error.into()),
            },
            Ok(None) => Ok(()),
            Err(error) => Err(error),
        })
    }

    /// Whether a record is known to be whole.
    pub(super) fn holds(&mut self, request: &Request, bytes: &Bytes) -> bool {
        matches!(self.check(request, bytes), Some(Ok(())))
    }
}
