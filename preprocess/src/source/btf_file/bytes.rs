//! A file that is read at any place from several threads, and a cursor that reads its header with suspicion.

use std::fmt::Display;
use std::fs::File;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// An open file and its length. Nothing is mapped: a file that is cut short while it is read gives an error.
#[derive(Debug)]
pub(super) struct ByteFile {
    path: PathBuf,
    file: File,
    bytes: u64,
}

impl ByteFile {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let metadata = file.metadata().map_err(Error::io(path, "open"))?;
        if !metadata.is_file() {
            return Err(Error::format(path, "is no file; give a .btf file"));
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            bytes: metadata.len(),
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn len(&self) -> u64 {
        self.bytes
    }

    /// Fills `out` with the bytes from `offset` on.
    pub(super) fn read(&self, offset: u64, out: &mut [u8]) -> Result<()> {
        let count = out.len();
        self.read_raw(offset, out).map_err(|error| {
            Error::io(&self.path, format!("read {count} bytes from byte {offset} on"))(error)
        })
    }

    /// As [`ByteFile::read`], with the system's own error.
    pub(super) fn read_raw(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        read_at(&self.file, offset, out)
    }

    pub(super) fn error(&self, detail: impl Into<String>) -> Error {
        Error::format(&self.path, detail)
    }
}

/// Fills `out` with the bytes of `file` from `offset` on, without moving its position.
pub(super) fn read_at(file: &File, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
    #[cfg(unix)]
    return std::os::unix::fs::FileExt::read_exact_at(file, out, offset);
    #[cfg(windows)]
    {
        let mut done = 0;
        while done < out.len() {
            match std::os::windows::fs::FileExt::seek_read(file, &mut out[done..], offset + done as u64)? {
                0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
                read => done += read,
            }
        }
        Ok(())
    }
}

/// Bytes that the cursor fetches at a time, and the most it hands out at once.
const WINDOW_BYTES: usize = 1 << 16;

/// Reads a header from front to back. Every field is compared with the file's length before it is read; the errors
/// say which field at which byte is missing.
#[derive(Debug)]
pub(super) struct Cursor<'a> {
    file: &'a ByteFile,
    at: u64,
    window: Vec<u8>,
    window_start: u64,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(file: &'a ByteFile) -> Self {
        Self {
            file,
            at: 0,
            window: Vec::new(),
            window_start: 0,
        }
    }

    /// The byte that is read next.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    pub(super) fn file(&self) -> &'a ByteFile {
        self.file
    }

    /// Bytes that are left.
    pub(super) fn left(&self) -> u64 {
        self.file.len() - self.at
    }

    /// Steps over `count` bytes of `what`.
    pub(super) fn skip(&mut self, what: impl Display, count: u64) -> Result<()> {
        if count > self.left() {
            return Err(self.file.error(format!(
                "is cut short or lies about a count: {what} at byte {} takes {count} bytes, but the file ends at \
                 byte {}",
                self.at,
                self.file.len()
            )));
        }
        self.at += count;
        Ok(())
    }

    /// The next `count` bytes, at most `WINDOW_BYTES`.
    pub(super) fn take(&mut self, what: impl Display, count: usize) -> Result<&[u8]> {
        debug_assert!(count <= WINDOW_BYTES, "larger fields are skipped");
        let start = self.at;
        self.skip(what, count as u64)?;
        let known = self.window_start..self.window_start + self.window.len() as u64;
        if start < known.start || self.at > known.end {
            self.window
                .resize((self.file.len() - start).min(WINDOW_BYTES as u64) as usize, 0);
            self.window_start = start;
            self.file.read(start, &mut self.window)?;
        }
        let first = (start - self.window_start) as usize;
        Ok(&self.window[first..first + count])
    }

    fn array<const N: usize>(&mut self, what: impl Display) -> Result<[u8; N]> {
        Ok(self
            .take(what, N)?
            .try_into()
            .expect("as many bytes as asked for"))
    }

    pub(super) fn u8(&mut self, what: impl Display) -> Result<u8> {
        Ok(self.array::<1>(what)?[0])
    }

    pub(super) fn u32(&mut self, what: impl Display) -> Result<u32> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub(super) fn i32(&mut self, what: impl Display) -> Result<i32> {
        Ok(i32::from_le_bytes(self.array(what)?))
    }

    pub(super) fn f32(&mut self, what: impl Display) -> Result<f32> {
        Ok(f32::from_le_bytes(self.array(what)?))
    }

    /// An error unless everything has been read.
    pub(super) fn finish(&self, last: impl Display) -> Result<()> {
        match self.left() {
            0 => Ok(()),
            left => Err(self.file.error(format!(
                "goes on for {left} bytes after {last}, which ends at byte {}: the file holds something else, or a \
                 count in its header is too small",
                self.at
            ))),
        }
    }
}
