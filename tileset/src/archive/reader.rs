//! An index and the bytes behind it.

use xxhash_rust::xxh3::Xxh3;

use super::{
    HEADER_BYTES, Index, ReadAt, Record,
    index::{column_name, contents},
};
use crate::{Error, PageId, Result, error::corrupt};

/// An archive that is being read.
#[derive(Clone, Debug)]
pub struct Archive<R> {
    /// Manifest and directory.
    pub index: Index,
    /// The bytes.
    pub reader: R,
}

impl<R: ReadAt> Archive<R> {
    /// Reads and checks header, manifest and directory.
    ///
    /// # Errors
    /// As [`Index::parse`]; [`Error::Corrupt`] if there are more or fewer bytes than the header says;
    /// [`Error::Io`].
    pub fn open(reader: R) -> Result<Self> {
        let length = reader.len().map_err(|source| Error::Io {
            what: "length of the archive".into(),
            source,
        })?;
        let header = read(&reader, "header", 0, length.min(HEADER_BYTES as u64))?;
        let prefix_bytes = Index::prefix_bytes(&header)?;
        if prefix_bytes > length {
            let detail = format!("it ends here, header, manifest and directory have {prefix_bytes} bytes");
            return Err(corrupt("archive", length, detail));
        }
        let index = Index::parse(&read(&reader, "header, manifest and directory", 0, prefix_bytes)?)?;
        if index.file_bytes != length {
            let detail = format!("it ends here, its header announces {} bytes", index.file_bytes);
            return Err(corrupt("archive", length, detail));
        }
        Ok(Self { index, reader })
    }

    /// Header, manifest and directory as they stand in the file: what [`Index::parse`] takes.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn prefix(&self) -> Result<Vec<u8>> {
        let header = read(&self.reader, "header", 0, HEADER_BYTES as u64)?;
        read(
            &self.reader,
            "header, manifest and directory",
            0,
            Index::prefix_bytes(&header)?,
        )
    }

    /// The contents of a page's record, checked; empty if the page equals its up-sampled parent.
    ///
    /// # Errors
    /// [`Error::NotFound`] if the archive has no such page, [`Error::Corrupt`] if its checksum does not
    /// match, [`Error::Io`].
    pub fn read_page(&self, page: PageId) -> Result<Vec<u8>> {
        self.page_record(page).map(without_checksum)
    }

    /// The contents of a column's record, checked.
    ///
    /// # Errors
    /// As [`Archive::read_page`].
    pub fn read_column(&self, group: u16) -> Result<Vec<u8>> {
        self.column_record(group).map(without_checksum)
    }

    /// A page's record as it is stored and as it travels, with its checksum.
    ///
    /// # Errors
    /// As [`Archive::read_page`].
    pub fn page_record(&self, page: PageId) -> Result<Vec<u8>> {
        let record = self.index.page(page)?;
        self.read_record(&page.to_string(), record)
    }

    /// A column's record as it is stored and as it travels, with its checksum.
    ///
    /// # Errors
    /// As [`Archive::read_page`].
    pub fn column_record(&self, group: u16) -> Result<Vec<u8>> {
        let record = self.index.column(group)?;
        self.read_record(&column_name(group), record)
    }

    /// Reads all of the archive and checks every record, and all of them against [`Index::contents_hash`]: that finds
    /// what 32 bits at each record may let through.
    ///
    /// # Errors
    /// [`Error::Corrupt`], [`Error::Io`].
    pub fn check(&self) -> Result<()> {
        let mut hash = Xxh3::new();
        for record in self.index.stored() {
            let bytes = self.read_record("record", record)?;
            hash.update(contents(&bytes));
        }
        if hash.digest128() != self.index.contents_hash {
            return Err(corrupt(
                "records",
                0,
                "the checksum of all of them together does not match",
            ));
        }
        Ok(())
    }

    fn read_record(&self, what: &str, record: Record) -> Result<Vec<u8>> {
        let bytes = read(&self.reader, what, record.offset, record.length.into())?;
        self.index.verify(what, record, &bytes)?;
        Ok(bytes)
    }
}

fn without_checksum(mut record: Vec<u8>) -> Vec<u8> {
    record.truncate(contents(&record).len());
    record
}

/// `length` bytes, which the caller has compared with a limit.
fn read(reader: &impl ReadAt, what: &str, offset: u64, length: u64) -> Result<Vec<u8>> {
    let mut bytes = vec![0; length as usize];
    reader
        .read_exact_at(offset, &mut bytes)
        .map_err(|source| Error::Io {
            what: format!("reading {length} bytes of {what} at {offset}"),
            source,
        })?;
    Ok(bytes)
}
