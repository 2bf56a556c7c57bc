//! Files beside archives: thumbnails, and scenes with their buffers and textures.
//!
//! They are looked up in the list of the store like archives, opened when they are asked for, and sent as they stand. Thumbnails have
//! a hash of their content, so that catalogues name them by addresses that caches may keep for good.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use futures_util::{StreamExt, stream};
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

use crate::{
    answer::{Fields, Keep},
    failure::Failure,
    reads::Reads,
    service::Service,
    store::{Identity, Kind, Listed, Store, StoreError, Version},
};

/// Files beside archives that are served in a collection, the first ones by name.
pub const MAX_FILES: usize = 1024;
/// Longest picture that is taken for a thumbnail: it is read when the store is listed.
const MAX_THUMBNAIL_BYTES: u64 = 2 << 20;
/// Files that are read at the same time.
const OPENING: usize = 8;
/// Endings of thumbnails, the one that wins first.
const THUMBNAILS: [&str; 4] = ["webp", "jpg", "jpeg", "png"];

/// A file of the list that is no archive.
#[derive(Clone, Debug)]
pub(crate) struct Beside {
    pub(crate) kind: Kind,
    pub(crate) bytes: u64,
    media: &'static str,
    identity: Identity,
    /// Of the content; for thumbnails only.
    hash: Option<u128>,
}

/// The files of a list that are no archives. Those that have not changed keep their hashes.
pub(crate) async fn look(
    store: &dyn Store,
    reads: &Reads,
    listed: &[Listed],
    old: &BTreeMap<String, Beside>,
) -> BTreeMap<String, Beside> {
    let subjects = listed.iter().filter_map(|listed| {
        let subject = matches!(Kind::of(&listed.file), Some((Kind::Archive | Kind::Scene, _)));
        stem(&listed.file).filter(|_| subject)
    });
    let subjects: BTreeSet<_> = subjects.collect();
    let mut files = Vec::new();
    for listed in listed {
        let Some((kind, media)) = Kind::of(&listed.file).filter(|(kind, _)| *kind != Kind::Archive) else {
            continue;
        };
        let Ok(identity) = listed.identity.clone() else {
            continue;
        };
        let known = old.get(&listed.file).filter(|old| old.identity == identity);
        let file = Beside {
            kind,
            bytes: listed.bytes,
            media,
            identity,
            hash: known.and_then(|known| known.hash),
        };
        let thumbnail = kind == Kind::Picture
            && file.bytes <= MAX_THUMBNAIL_BYTES
            && stem(&listed.file).is_some_and(|stem| subjects.contains(stem));
        files.push((listed.file.clone(), file, thumbnail));
    }
    let hashed = stream::iter(files).map(|(name, mut file, thumbnail)| async move {
        if thumbnail && file.hash.is_none() {
            file.hash = hash(store, reads, &name, &file).await;
        }
        (name, file)
    });
    hashed.buffered(OPENING).collect().await
}

/// The hash of a file's content, if it is still the one that was listed. The next look tries again.
async fn hash(store: &dyn Store, reads: &Reads, name: &str, file: &Beside) -> Option<u128> {
    let read = async {
        let version = reads.ask(|| store.open(name)).await?;
        if *version.identity() != file.identity || version.bytes() != file.bytes {
            return Err(StoreError::Changed);
        }
        reads.read(&*version, 0..file.bytes).await
    };
    match read.await {
        Ok(bytes) => Some(xxh3_128(&bytes)),
        Err(error) => {
            tracing::warn!(file = name, %error, "no thumbnail");
            None
        }
    }
}

/// A file's name without its ending.
pub(crate) fn stem(file: &str) -> Option<&str> {
    file.rsplit_once('.').map(|(stem, _)| stem)
}

/// The thumbnail of an archive or a scene: its file, and the hash in its address.
pub(crate) fn thumbnail(files: &BTreeMap<String, Beside>, stem: &str) -> Option<(String, u128)> {
    THUMBNAILS.iter().find_map(|ending| {
        let file = format!("{stem}.{ending}");
        let hash = files.get(&file)?.hash?;
        Some((file, hash))
    })
}

impl Service<'_> {
    /// A file as it is now, opened. With the hash of an address, only if that is what it holds.
    pub(crate) async fn beside(
        &self,
        name: &str,
        hash: Option<&str>,
    ) -> Result<(Fields, Arc<dyn Version>), Failure> {
        let absent = || Failure::not_found(format!("no file {name:?} here: GET /v1/ lists what there is"));
        let mut listing = self.listing().await;
        let mut again = true;
        loop {
            let file = listing.files.get(name).ok_or_else(absent)?;
            let current = file.hash.map(|hash| format!("{hash:032x}"));
            if hash.is_some() && hash != current.as_deref() {
                let detail = format!("{name:?} has another content now: GET /v1/ again");
                return Err(Failure::gone(detail));
            }
            let version = self
                .collection
                .open_file(&self.shared.records.reads, name)
                .await
                .map_err(|error| match error {
                    StoreError::NotFound => absent(),
                    StoreError::Refused(reason) => Failure::corrupt(format!("file {name:?}: {reason}")),
                    StoreError::Changed | StoreError::Unavailable(_) => Failure::unavailable(),
                })?;
            // Newer than the list says: only an address that says nothing of its content can lead to it.
            if *version.identity() != file.identity && hash.is_some() && again {
                again = false;
                listing = self.look_again().await;
                continue;
            }
            if *version.identity() != file.identity && hash.is_some() {
                return Err(Failure::unavailable());
            }
            let etag = match hash {
                Some(hash) => format!("\"{hash}\""),
                None => format!("\"{:016x}\"", xxh3_64(version.identity().to_string().as_bytes())),
            };
            let keep = if hash.is_some() {
                Keep::ForGood
            } else {
                Keep::Shortly
            };
            return Ok((Fields::new(etag, keep, file.media, self.private()), version));
        }
    }
}
