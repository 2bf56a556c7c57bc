//! The archives of a folder: found by listing it, opened once, opened again when they change.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    fs::{self, DirEntry, File, Metadata},
    io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError, RwLock},
    time::SystemTime,
};

use bytes::Bytes;
use tileset::{Archive, archive::Index};

use crate::{
    Error, Result,
    documents::{self, etag_of},
};

/// Archives of a folder that are served, the first ones by name. Each is an open file, and a process may often
/// have only 1024 of these, connections included.
pub const MAX_ARCHIVES: usize = 256;

/// The `.bsvtf` files directly in a folder.
///
/// Requests are looked up in the listing by name; no path is ever made of what a client sends. Only regular
/// files are served, and symbolic links only if they lead to a file in the same folder.
pub struct Collection {
    /// Canonical.
    folder: PathBuf,
    listing: RwLock<Arc<Listing>>,
    refreshing: Mutex<()>,
}

/// Archives by name.
pub(crate) type Listing = BTreeMap<String, Entry>;

/// A file of the folder.
#[derive(Clone)]
pub(crate) enum Entry {
    Ready(Arc<Served>),
    /// Cannot be served, and why; looked at again when it changes.
    Broken {
        stamp: Stamp,
        error: Arc<str>,
    },
}

/// An archive that is served.
pub(crate) struct Served {
    pub(crate) name: String,
    pub(crate) archive: Archive<File>,
    /// Length of header, manifest and directory.
    pub(crate) prefix_bytes: u64,
    /// The manifest document, and its ETag.
    pub(crate) manifest_json: Bytes,
    pub(crate) manifest_etag: String,
    stamp: Stamp,
}

impl Served {
    pub(crate) fn index(&self) -> &Index {
        &self.archive.index
    }

    /// The content id as it stands in addresses: 32 hexadecimal digits.
    pub(crate) fn id(&self) -> String {
        format!("{:032x}", self.index().id)
    }
}

/// What tells that a file has changed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stamp {
    modified: Option<SystemTime>,
    bytes: u64,
    /// Tells a file from its successor within the resolution of the clock; 0 where there is no such number.
    inode: u64,
}

impl Stamp {
    fn of(metadata: &Metadata) -> Self {
        #[cfg(unix)]
        let inode = std::os::unix::fs::MetadataExt::ino(metadata);
        #[cfg(not(unix))]
        let inode = 0;
        Self {
            modified: metadata.modified().ok(),
            bytes: metadata.len(),
            inode,
        }
    }
}

impl Collection {
    /// Lists a folder and opens its archives. One that is damaged is reported in the log and in the catalogue,
    /// and does not keep the others from being served.
    ///
    /// # Errors
    /// [`Error::Folder`] if the folder cannot be listed.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self> {
        let path = folder.as_ref();
        let refuse = |source| Error::Folder {
            path: path.to_owned(),
            source,
        };
        let folder = path.canonicalize().map_err(refuse)?;
        let collection = Self {
            folder,
            listing: RwLock::default(),
            refreshing: Mutex::new(()),
        };
        collection.refresh().map_err(refuse)?;
        Ok(collection)
    }

    /// Names of the archives that can be served, in order.
    pub fn names(&self) -> Vec<String> {
        let listing = self.listing();
        listing
            .iter()
            .filter(|(_, entry)| matches!(entry, Entry::Ready(_)))
            .map(|(name, _)| name.clone())
            .collect()
    }

    /// Archives as they were listed last.
    pub(crate) fn listing(&self) -> Arc<Listing> {
        Arc::clone(&self.listing.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Lists the folder again, opens what is new or has changed, and puts the new listing in the place of the
    /// old one at once. Blocks; requests that hold an archive of the old listing keep it.
    pub(crate) fn refresh(&self) -> io::Result<Arc<Listing>> {
        let _one_at_a_time = self.refreshing.lock().unwrap_or_else(PoisonError::into_inner);
        let old = self.listing();
        let mut files = BTreeMap::new();
        for file in fs::read_dir(&self.folder)? {
            let file = file?;
            let Some(name) = archive_name(&file.file_name()) else {
                continue;
            };
            files.insert(name, file);
            if files.len() > MAX_ARCHIVES {
                files.pop_last();
                tracing::warn!(
                    "more than {MAX_ARCHIVES} archives in the folder: only the first by name are served"
                );
            }
        }
        let mut listing = Listing::new();
        for (name, file) in files {
            if let Some(entry) = self.entry(&name, &file, old.get(&name)) {
                listing.insert(name, entry);
            }
        }
        let listing = Arc::new(listing);
        *self.listing.write().unwrap_or_else(PoisonError::into_inner) = Arc::clone(&listing);
        Ok(listing)
    }

    /// The old entry of a file if it has not changed, else a new one; `None` if the file went away meanwhile.
    fn entry(&self, name: &str, file: &DirEntry, old: Option<&Entry>) -> Option<Entry> {
        let path = file.path();
        let metadata = fs::metadata(&path).ok();
        let stamp = match &metadata {
            Some(metadata) => Stamp::of(metadata),
            None if fs::symlink_metadata(&path).is_err() => return None,
            None => Stamp {
                modified: None,
                bytes: 0,
                inode: 0,
            }, // A link that leads nowhere.
        };
        let inside = self.leads_inside(&path);
        let result = match metadata {
            Some(metadata) if inside && metadata.is_file() => {
                if let Some(old @ Entry::Ready(served)) = old
                    && served.stamp == stamp
                {
                    return Some(old.clone());
                }
                if let Some(old @ Entry::Broken { stamp: seen, .. }) = old
                    && *seen == stamp
                {
                    return Some(old.clone());
                }
                Served::open(name, &path)
            }
            Some(_) if inside => Err("not a file".to_owned()),
            _ => Err("a symbolic link that does not lead to a file of this folder".to_owned()),
        };
        Some(match result {
            Ok(served) => {
                tracing::info!(archive = name, id = served.id(), bytes = stamp.bytes, "serving");
                Entry::Ready(Arc::new(served))
            }
            Err(error) => {
                if !matches!(old, Some(Entry::Broken { error: known, .. }) if **known == *error) {
                    tracing::warn!(archive = name, error, "not serving");
                }
                Entry::Broken {
                    stamp,
                    error: error.into(),
                }
            }
        })
    }

    /// Whether what a path finally leads to lies directly in the folder.
    fn leads_inside(&self, path: &Path) -> bool {
        path.canonicalize()
            .is_ok_and(|path| path.parent() == Some(&self.folder))
    }
}

impl Served {
    /// Opens an archive. Errors are for clients as well, so they name no path of this machine.
    fn open(name: &str, path: &Path) -> std::result::Result<Self, String> {
        let file = File::open(path).map_err(|error| format!("cannot be opened: {error}"))?;
        // Of the open file: a stamp taken from the path could be that of its successor.
        let stamp = Stamp::of(
            &file
                .metadata()
                .map_err(|error| format!("cannot be opened: {error}"))?,
        );
        let archive = Archive::open(file).map_err(|error| error.to_string())?;
        let prefix_bytes = archive.prefix().map_err(|error| error.to_string())?.len() as u64;
        let manifest_json = documents::manifest(name, &archive.index, prefix_bytes);
        let manifest_etag = etag_of(&manifest_json);
        Ok(Self {
            name: name.to_owned(),
            archive,
            prefix_bytes,
            manifest_json,
            manifest_etag,
            stamp,
        })
    }
}

/// The name under which a file of the folder is served; `None` for other files, for hidden ones, and for names
/// that addresses cannot carry or that would be taken for the file of another archive.
fn archive_name(file: &OsStr) -> Option<String> {
    let name = file.to_str()?.strip_suffix(".bsvtf")?;
    let refused = name.is_empty() || name.starts_with('.') || name.ends_with(".bsvtf");
    (!refused && !name.contains(char::is_control)).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files() {
        for (file, name) in [
            ("cloth.bsvtf", Some("cloth")),
            ("wool 2.bsvtf", Some("wool 2")),
            ("größe.bsvtf", Some("größe")),
            ("cloth.BSVTF", None),
            ("cloth.bsvtf.part", None),
            ("cloth.bsvtf.bsvtf", None),
            (".bsvtf", None),
            (".hidden.bsvtf", None),
            ("new\nline.bsvtf", None),
        ] {
            assert_eq!(archive_name(OsStr::new(file)).as_deref(), name, "{file:?}");
        }
    }
}
