//! Files that are whole or not there: written under a temporary name, renamed when complete.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// A file that gets its name when it is complete; dropped before that, it leaves nothing behind.
pub(crate) struct AtomicFile {
    path: PathBuf,
    temporary: PathBuf,
    /// `None` once committed.
    writer: Option<BufWriter<File>>,
}

impl AtomicFile {
    /// Creates the temporary file beside `path`: a rename is atomic only within one file system.
    pub(crate) fn create(path: &Path) -> Result<Self> {
        let Some(name) = path.file_name() else {
            return Err(Error::Invalid {
                what: "name of the output file",
                found: path.display().to_string(),
                expected: "a path that ends in a file name",
            });
        };
        let mut temporary_name = std::ffi::OsString::from(".");
        temporary_name.push(name);
        temporary_name.push(format!(".{}.part", std::process::id()));
        let temporary = path.with_file_name(temporary_name);
        let file = File::create(&temporary).map_err(Error::io(&temporary, "create"))?;
        Ok(Self {
            path: path.to_owned(),
            temporary,
            writer: Some(BufWriter::with_capacity(1 << 20, file)),
        })
    }

    /// Appends bytes.
    pub(crate) fn write_all(&mut self, bytes: &[u8]) -> Result<()> {
        self.writer()
            .write_all(bytes)
            .map_err(Error::io(&self.temporary, "write"))
    }

    /// For code that writes to any `Write`.
    pub(crate) fn writer(&mut self) -> &mut BufWriter<File> {
        self.writer
            .as_mut()
            .expect("the writer is taken only by commit, which consumes self")
    }

    /// Makes the file durable and gives it its name, replacing what had it before.
    pub(crate) fn commit(mut self) -> Result<()> {
        let writer = self.writer.take().expect("the writer is taken only here");
        let renamed = (|| {
            let file = writer.into_inner().map_err(std::io::IntoInnerError::into_error)?;
            file.sync_all()?;
            drop(file); // Windows renames no open files
            std::fs::rename(&self.temporary, &self.path)
        })();
        renamed.map_err(|source| {
            let _ = std::fs::remove_file(&self.temporary);
            Error::Io {
                path: self.path.clone(),
                action: "complete".into(),
                source,
            }
        })
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            drop(writer.into_parts()); // without flushing what is thrown away
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_only_when_committed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);

        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        assert!(!path.exists());
        file.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn errors_name_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let error = AtomicFile::create(&folder.path().join("missing/out.bin"))
            .err()
            .unwrap();
        assert!(error.to_string().contains("missing"), "{error}");
        assert!(AtomicFile::create(Path::new("/")).is_err());
    }
}
