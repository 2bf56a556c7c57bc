//! A folder of this machine.

use std::{
    fs::{self, File, Metadata},
    io,
    ops::Range,
    path::{Path, PathBuf},
    sync::Arc,
    time::UNIX_EPOCH,
};

use tileset::ReadAt;
use tokio::sync::Semaphore;

use super::{Answer, Found, Identity, Listed, Store, StoreError, Version};
use crate::{Error, MAX_ARCHIVES, MAX_FILES, Result};

/// Threads that wait for disks at the same time, in the whole process.
static DISK: Semaphore = Semaphore::const_new(64);

/// The archives directly in a folder, and what is served beside them.
///
/// Only regular files are served, and symbolic links only if they lead to a file in the same folder.
pub struct Folder {
    /// Canonical.
    path: PathBuf,
}

impl Folder {
    /// # Errors
    /// [`Error::Folder`] if there is no such folder, or it cannot be listed.
    pub fn new(path: impl AsRef<Path>) -> Result<Self> {
        let refuse = |source| Error::Folder {
            path: path.as_ref().to_owned(),
            source,
        };
        let canonical = path.as_ref().canonicalize().map_err(refuse)?;
        fs::read_dir(&canonical).map_err(refuse)?;
        Ok(Self { path: canonical })
    }
}

impl Store for Folder {
    fn list(&self) -> Answer<'_, Vec<Listed>> {
        let folder = self.path.clone();
        Box::pin(blocking(move || list(&folder)))
    }

    fn open<'a>(&'a self, file: &'a str) -> Answer<'a, Arc<dyn Version>> {
        let (folder, path) = (self.path.clone(), self.path.join(file));
        Box::pin(blocking(move || {
            target(&folder, &path).map_err(StoreError::Refused)?;
            let file = File::open(&path).map_err(of_file)?;
            // Of the open file: the path could lead to its successor.
            let metadata = file.metadata().map_err(of_file)?;
            let opened = Opened {
                identity: identity(&metadata),
                bytes: metadata.len(),
                file,
            };
            Ok(Arc::new(FileVersion(Arc::new(opened))) as Arc<dyn Version>)
        }))
    }
}

fn list(folder: &Path) -> std::result::Result<Vec<Listed>, StoreError> {
    let unlisted =
        |error: io::Error| StoreError::Unavailable(format!("the folder cannot be listed: {error}"));
    let (mut found, mut all) = (Found::new(), true);
    for file in fs::read_dir(folder).map_err(unlisted)? {
        let file = file.map_err(unlisted)?;
        if let Some(name) = file.file_name().to_str() {
            all &= found.add(name, file.path());
        }
    }
    if !all {
        tracing::warn!(
            "more than {MAX_ARCHIVES} archives or {MAX_FILES} other files in the folder: only the first by name are served"
        );
    }
    // Without those that went away meanwhile.
    let there = found
        .all()
        .into_iter()
        .filter(|(_, path)| fs::symlink_metadata(path).is_ok());
    let listed = there.map(|(file, path)| {
        let metadata = target(folder, &path);
        Listed {
            file,
            bytes: metadata.as_ref().map_or(0, Metadata::len),
            identity: metadata.as_ref().map(identity).map_err(Clone::clone),
        }
    });
    Ok(listed.collect())
}

/// What a path of the folder finally leads to, if that is a file directly in the folder.
fn target(folder: &Path, path: &Path) -> std::result::Result<Metadata, String> {
    let inside = path
        .canonicalize()
        .ok()
        .filter(|path| path.parent() == Some(folder));
    match inside.and_then(|path| fs::metadata(path).ok()) {
        Some(metadata) if metadata.is_file() => Ok(metadata),
        Some(_) => Err("not a file".to_owned()),
        None => Err("a symbolic link that does not lead to a file of this folder".to_owned()),
    }
}

/// Time and length, and the inode, which tells a file from its successor within the resolution of the clock.
fn identity(metadata: &Metadata) -> Identity {
    #[cfg(unix)]
    let inode = std::os::unix::fs::MetadataExt::ino(metadata);
    #[cfg(not(unix))]
    let inode = 0;
    let modified = metadata
        .modified()
        .ok()
        .and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let nanoseconds = modified.unwrap_or_default().as_nanos();
    Identity::new(format!("{nanoseconds}-{}-{inode}", metadata.len()))
}

/// An open file: it can be read to its end even when another one has taken its name.
struct FileVersion(Arc<Opened>);

struct Opened {
    file: File,
    identity: Identity,
    bytes: u64,
}

impl Version for FileVersion {
    fn identity(&self) -> &Identity {
        &self.0.identity
    }

    fn bytes(&self) -> u64 {
        self.0.bytes
    }

    fn read(&self, range: Range<u64>) -> Answer<'_, Vec<u8>> {
        let opened = Arc::clone(&self.0);
        Box::pin(blocking(move || {
            let mut bytes = vec![0; (range.end - range.start) as usize];
            let result = opened.file.read_exact_at(range.start, &mut bytes);
            // After reading: a file that is written over in place has no version that could be read.
            if identity(&opened.file.metadata().map_err(of_file)?) != opened.identity {
                return Err(StoreError::Changed);
            }
            result.map_err(of_file)?;
            Ok(bytes)
        }))
    }
}

/// Messages of the system are for clients, too, and name no path. What is not the file's own fault, such as too many
/// open files, passes.
fn of_file(error: io::Error) -> StoreError {
    use io::ErrorKind::{IsADirectory, NotFound, PermissionDenied, UnexpectedEof};
    let message = format!("the file cannot be read: {error}");
    match error.kind() {
        NotFound => StoreError::NotFound,
        IsADirectory | PermissionDenied | UnexpectedEof => StoreError::Refused(message),
        _ => StoreError::Unavailable(message),
    }
}

/// Runs something that may block on a thread where it may.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> std::result::Result<T, StoreError> + Send + 'static,
) -> std::result::Result<T, StoreError> {
    let slot = DISK.acquire().await;
    let done = tokio::task::spawn_blocking(move || {
        let _slot = slot; // Until the work is done, even if nobody waits for it any more.
        work()
    })
    .await;
    done.unwrap_or_else(|error| Err(StoreError::Refused(format!("reading has failed: {error}"))))
}
