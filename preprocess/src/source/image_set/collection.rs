//! A set of named files: a folder and what is below it, or a zip.
//!
//! Names are paths below the root with `/` between their parts. Files are read whole, from several threads at once.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use zip::{CompressionMethod, ZipArchive};

use super::super::decode::MAX_ENCODED_BYTES;
use crate::{Error, Result};

/// Files of a set at most: a hundred times those of a measurement.
const MAX_FILES: usize = 1 << 20;
/// Folders below each other at most.
const MAX_DEPTH: usize = 16;

/// A set of named files.
#[derive(Debug)]
pub(super) struct Collection {
    /// The folder or the zip.
    path: PathBuf,
    files: Vec<Named>,
    store: Store,
}

/// A file of a set.
#[derive(Clone, Debug)]
pub(super) struct Named {
    pub(super) name: String,
    /// Bytes on the disk.
    pub(super) stored_bytes: u64,
}

#[derive(Debug)]
enum Store {
    /// Paths of the files.
    Folder(Vec<PathBuf>),
    /// The zip, and the index in it of each file. The clones that threads make share its directory.
    Zip(ZipArchive<SharedFile>, Vec<usize>),
}

impl Collection {
    /// All files below a folder, sorted by name; hidden ones are left out.
    pub(super) fn folder(root: &Path) -> Result<Self> {
        let mut found = Vec::new();
        walk(root, "", 0, &mut found)?;
        found.sort_by(|(a, _), (b, _)| a.name.cmp(&b.name));
        let (files, paths) = found.into_iter().unzip();
        Ok(Self {
            path: root.to_owned(),
            files,
            store: Store::Folder(paths),
        })
    }

    /// All files of a zip, sorted by name; hidden ones are left out. Only its directory is read.
    pub(super) fn zip(path: &Path) -> Result<Self> {
        let file = SharedFile::open(path).map_err(Error::io(path, "open"))?;
        let bytes = file.length;
        let archive = ZipArchive::new(file).map_err(|error| {
            let detail = format!(
                "no directory of a zip at the end of its {bytes} bytes ({error}): the file is cut short or no zip; \
                 fetch it again"
            );
            Error::format(path, detail)
        })?;
        if archive.len() > MAX_FILES {
            let detail = format!("holds {} files, accepted are {MAX_FILES}", archive.len());
            return Err(Error::format(path, detail));
        }
        let mut found = Vec::new();
        for index in 0..archive.len() {
            let bad = |error| Error::format(path, format!("entry {index} of the zip: {error}"));
            let entry = archive.by_index_data(index).map_err(bad)?;
            let name = entry.name().map_err(bad)?.replace('\\', "/");
            let hidden = name.split('/').any(is_hidden);
            if entry.is_dir() || hidden {
                continue;
            }
            let what = format!("{name} at byte {} of the zip", entry.header_start());
            if entry.encrypted() {
                return Err(Error::format(
                    path,
                    format!("{what} is encrypted: unpack it first"),
                ));
            }
            let method = entry.compression();
            if !matches!(method, CompressionMethod::Stored | CompressionMethod::Deflated) {
                let detail =
                    format!("{what} is compressed by {method}, expected stored or deflated: unpack it");
                return Err(Error::format(path, detail));
            }
            let end = entry.header_start().saturating_add(entry.compressed_size());
            if end > bytes {
                let detail = format!("{what} ends beyond the {bytes} bytes of the file: fetch it again");
                return Err(Error::format(path, detail));
            }
            let stored_bytes = entry.compressed_size();
            found.push((Named { name, stored_bytes }, index));
        }
        found.sort_by(|(a, _), (b, _)| a.name.cmp(&b.name));
        let (files, indices) = found.into_iter().unzip();
        Ok(Self {
            path: path.to_owned(),
            files,
            store: Store::Zip(archive, indices),
        })
    }

    /// The folder or the zip.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Its files.
    pub(super) fn files(&self) -> &[Named] {
        &self.files
    }

    /// "folder" or "zip".
    pub(super) fn kind(&self) -> &'static str {
        match self.store {
            Store::Folder(_) => "folder",
            Store::Zip(..) => "zip",
        }
    }

    /// For an error of a file: which one, and what is wrong.
    pub(super) fn error(&self, file: usize, detail: impl std::fmt::Display) -> Error {
        Error::format(&self.path, format!("{}: {detail}", self.files[file].name))
    }

    /// The file, whole.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] where it is damaged or unreasonably large.
    pub(super) fn read(&self, file: usize) -> Result<Vec<u8>> {
        let bytes = self.read_first(file, MAX_ENCODED_BYTES + 1)?;
        if bytes.len() as u64 > MAX_ENCODED_BYTES {
            return Err(self.error(file, format!("is larger than {MAX_ENCODED_BYTES} bytes")));
        }
        Ok(bytes)
    }

    /// The first bytes of the file, at most so many.
    ///
    /// # Errors
    /// As [`Collection::read`].
    pub(super) fn read_first(&self, file: usize, limit: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        match &self.store {
            Store::Folder(paths) => {
                let path = &paths[file];
                let opened = File::open(path).map_err(Error::io(path, "open"))?;
                opened
                    .take(limit)
                    .read_to_end(&mut bytes)
                    .map_err(Error::io(path, "read"))?;
            }
            Store::Zip(archive, indices) => {
                let mut archive = archive.clone();
                let entry = archive.by_index(indices[file]);
                let entry = entry.map_err(|error| self.error(file, error))?;
                let offset = entry.header_start();
                let promised = entry.size();
                // The sizes in a zip are not to be trusted: what comes out decides.
                let read = entry.take(limit).read_to_end(&mut bytes);
                let at = |detail: String| self.error(file, format!("at byte {offset} of the zip: {detail}"));
                read.map_err(|error| at(error.to_string()))?;
                if (bytes.len() as u64) < limit && bytes.len() as u64 != promised {
                    let detail = format!("holds {} bytes, the directory says {promised}", bytes.len());
                    return Err(at(detail));
                }
            }
        }
        Ok(bytes)
    }
}

/// The part of a name behind its last dot.
pub(super) fn extension(name: &str) -> &str {
    name.rsplit_once('.').map_or("", |(_, extension)| extension)
}

/// Whether a name ends in one of these extensions, in upper or lower case.
pub(super) fn has_extension(name: &str, extensions: &[&str]) -> bool {
    let own = extension(name);
    extensions
        .iter()
        .any(|extension| own.eq_ignore_ascii_case(extension))
}

/// Those that systems put into folders and zips of their own accord: `.DS_Store`, `__MACOSX/._name.jpg`.
fn is_hidden(part: &str) -> bool {
    part.starts_with('.') || part == "__MACOSX"
}

/// Adds the files of a folder and of those below it. Links to folders are not followed, those to files are.
fn walk(folder: &Path, prefix: &str, depth: usize, found: &mut Vec<(Named, PathBuf)>) -> Result<()> {
    if depth > MAX_DEPTH {
        return Err(Error::format(
            folder,
            format!("lies more than {MAX_DEPTH} folders deep"),
        ));
    }
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder, "list"))? {
        let entry = entry.map_err(Error::io(folder, "list"))?;
        let (path, part) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if is_hidden(&part) {
            continue;
        }
        let name = format!("{prefix}{part}");
        let kind = entry.file_type().map_err(Error::io(&path, "look at"))?;
        if kind.is_dir() {
            walk(&path, &format!("{name}/"), depth + 1, found)?;
            continue;
        }
        let Ok(metadata) = std::fs::metadata(&path) else {
            continue; // a link to nowhere; where it should be an image, that image is missing
        };
        if metadata.is_file() {
            let stored_bytes = metadata.len();
            found.push((Named { name, stored_bytes }, path));
        }
        if found.len() > MAX_FILES {
            return Err(Error::format(
                folder,
                format!("more than {MAX_FILES} files: give the folder of one BTF"),
            ));
        }
    }
    Ok(())
}

/// A file that many readers share, each with a position of its own.
#[derive(Clone, Debug)]
struct SharedFile {
    file: Arc<File>,
    length: u64,
    position: u64,
}

impl SharedFile {
    fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok(Self {
            file: Arc::new(file),
            length,
            position: 0,
        })
    }
}

impl Read for SharedFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        #[cfg(unix)]
        let read = std::os::unix::fs::FileExt::read_at(&*self.file, buffer, self.position)?;
        #[cfg(windows)]
        let read = std::os::windows::fs::FileExt::seek_read(&*self.file, buffer, self.position)?;
        self.position += read as u64;
        Ok(read)
    }
}

impl Seek for SharedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(distance) => self.length.checked_add_signed(distance),
            SeekFrom::Current(distance) => self.position.checked_add_signed(distance),
        };
        self.position = position.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.position)
    }
}
