//! Header, manifest and directory, checked: what every reader of an archive starts from.

use std::sync::Arc;

use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

use super::{
    directory,
    header::{HEADER_BYTES, Header, MAX_MANIFEST_BYTES},
    order,
};
use crate::{
    Error, Manifest, PageId, Pyramid, Result,
    codec::{Decoder, MAX_COLUMN_BYTES, MAX_PAGE_BYTES},
    error::corrupt,
    frame,
};

/// Directory entry of a page or column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// Offset in the archive.
    pub offset: u64,
    /// Bytes; zero for a page that equals its up-sampled parent, which is not stored.
    pub length: u32,
    /// Pages: mean squared difference to the up-sampled parent (paper, equation 8), in squared units of
    /// reflectance. Columns: mean square of the group's eigen-textures.
    pub weight: f32,
    /// The lower half of the XXH3-64 of the record's bytes. Enough to find damage, and to tell versions of a record
    /// apart at one address; for all contents of the world there is [`Index::id`].
    pub hash: u32,
}

/// What every reader of an archive starts from: manifest and directory, checked.
#[derive(Clone, Debug)]
pub struct Index {
    /// Manifest.
    pub manifest: Manifest,
    /// Geometry of the pages.
    pub pyramid: Pyramid,
    /// Decodes the records.
    pub decoder: Arc<Decoder>,
    /// Content hash of the archive: XXH3-128 over header, manifest, tables and directory, and so over the hashes of
    /// all records.
    pub id: u128,
    /// Bytes of the whole archive.
    pub file_bytes: u64,
    columns: Vec<Record>,
    pages: Vec<Record>,
}

/// Archives with the same first bytes are the same, by the hashes in them.
impl PartialEq for Index {
    fn eq(&self, other: &Self) -> bool {
        self.id == other.id
    }
}

impl Index {
    /// Parses the first bytes of an archive: header, manifest, tables and directory, as a server sends them in one
    /// piece. Allocation is bounded by the length of `prefix` and the limits of the crate.
    ///
    /// # Errors
    /// [`Error::Corrupt`] for damaged, missing or superfluous bytes, [`Error::UnsupportedVersion`],
    /// [`Error::OverLimit`], and [`Error::Invalid`] for a manifest that [`Manifest::validate`] refuses.
    pub fn parse(prefix: &[u8]) -> Result<Index> {
        let header = Header::parse(prefix)?;
        if prefix.len() as u64 != header.prefix_bytes() {
            let detail = format!("{} bytes, {} are announced", prefix.len(), header.prefix_bytes());
            return Err(corrupt(
                "header, manifest and directory",
                prefix.len() as u64,
                detail,
            ));
        }
        let described = header.manifest_bytes as usize + header.tables_bytes as usize;
        let (described, directory) = prefix[HEADER_BYTES..].split_at(described);
        let (manifest, tables) = described.split_at(header.manifest_bytes as usize);
        let directory_offset = header.prefix_bytes() - header.directory_bytes;
        for (what, bytes, offset, hash) in [
            ("manifest", described, HEADER_BYTES as u64, header.manifest_hash),
            ("directory", directory, directory_offset, header.directory_hash),
        ] {
            if xxh3_64(bytes) != hash {
                return Err(corrupt(what, offset, "its checksum does not match"));
            }
        }
        let manifest: Manifest = frame::decompress(manifest, MAX_MANIFEST_BYTES)
            .and_then(|text| serde_json::from_slice(&text).map_err(|error| error.to_string()))
            .map_err(|detail| corrupt("manifest", HEADER_BYTES as u64, detail))?;
        let decoder = Arc::new(Decoder::new(&manifest, tables)?);
        let pyramid = manifest.pyramid()?;

        let groups = manifest.groups() as usize;
        let count = groups + manifest.page_count()? as usize;
        let mut columns = directory::decode(directory, count, header.prefix_bytes())
            .map_err(|detail| corrupt("directory", directory_offset, detail))?;
        let pages = columns.split_off(groups);
        let mut index = Index {
            manifest,
            pyramid,
            decoder,
            id: xxh3_128(prefix),
            file_bytes: header.file_bytes,
            columns,
            pages,
        };
        index
            .place_records(header.prefix_bytes())
            .map_err(|detail| corrupt("directory", directory_offset, detail))?;
        Ok(index)
    }

    /// Number of leading bytes of an archive that hold header, manifest and directory, told by the first
    /// [`HEADER_BYTES`] of it. At most about 100 MB, whatever the header says.
    ///
    /// # Errors
    /// As [`Index::parse`], of the header.
    pub fn prefix_bytes(header: &[u8]) -> Result<u64> {
        Ok(Header::parse(header)?.prefix_bytes())
    }

    /// The directory entry of a page.
    ///
    /// # Errors
    /// [`Error::NotFound`] if the archive has no such group or tile.
    pub fn page(&self, page: PageId) -> Result<Record> {
        let groups = self.manifest.groups();
        let tile = self
            .pyramid
            .tile_index(page.tile)
            .filter(|_| u32::from(page.group) < groups);
        match tile {
            Some(tile) => {
                Ok(self.pages[usize::from(page.group) * self.pyramid.tile_count() as usize + tile as usize])
            }
            None => Err(Error::NotFound {
                what: page.to_string(),
                detail: format!(
                    "it has {groups} groups of {}x{} texels, mips 0 to {}",
                    self.manifest.width,
                    self.manifest.height,
                    self.pyramid.tail_mip()
                ),
            }),
        }
    }

    /// The directory entry of a group's eigen-ABRDF column.
    ///
    /// # Errors
    /// [`Error::NotFound`] if the archive has no such group.
    pub fn column(&self, group: u16) -> Result<Record> {
        self.columns
            .get(usize::from(group))
            .copied()
            .ok_or_else(|| Error::NotFound {
                what: column_name(group),
                detail: format!("it has {} groups", self.columns.len()),
            })
    }

    /// Entries of all columns, by group.
    pub fn columns(&self) -> &[Record] {
        &self.columns
    }

    /// Entries of all pages: group by group, within a group by [`Pyramid::tile_index`].
    pub fn pages(&self) -> &[Record] {
        &self.pages
    }

    /// Checks a record's bytes against length and hash.
    ///
    /// # Errors
    /// [`Error::Corrupt`], naming the record by `what`.
    pub fn verify(&self, what: &str, record: Record, bytes: &[u8]) -> Result<()> {
        if bytes.len() as u64 != u64::from(record.length) {
            let detail = format!("{} bytes, {} are announced", bytes.len(), record.length);
            return Err(corrupt(what, record.offset, detail));
        }
        if record_hash(bytes) != record.hash {
            return Err(corrupt(what, record.offset, "its checksum does not match"));
        }
        Ok(())
    }

    /// Gives all records their places; the message says what records there cannot be.
    fn place_records(&mut self, prefix_bytes: u64) -> std::result::Result<(), String> {
        let columns = self.columns.iter().map(|record| ("column", record));
        let pages = self.pages.iter().map(|record| ("page", record));
        for (i, (what, record)) in columns.enumerate().chain(pages.enumerate()) {
            let Record {
                length, weight, hash, ..
            } = *record;
            if !(weight.is_finite() && weight >= 0.0) {
                return Err(format!("{what} {i} weighs {weight}"));
            }
            let limit = if what == "column" {
                MAX_COLUMN_BYTES
            } else {
                MAX_PAGE_BYTES
            };
            if length > limit {
                return Err(format!("{what} {i} cannot have {length} bytes"));
            }
            if length == 0 && (what == "column" || hash != 0) {
                return Err(format!("{what} {i} is empty, but must not be or has a checksum"));
            }
        }
        let (_, end) = order::place(&self.pyramid, &mut self.columns, &mut self.pages, prefix_bytes);
        if end != self.file_bytes {
            return Err(format!(
                "the last record ends at {end}, the file at {}",
                self.file_bytes
            ));
        }
        Ok(())
    }
}

/// The lower half of the XXH3-64 of a record's bytes; zero for a page that is not stored.
pub(super) fn record_hash(bytes: &[u8]) -> u32 {
    if bytes.is_empty() {
        0
    } else {
        xxh3_64(bytes) as u32
    }
}

/// How messages name a column.
pub(super) fn column_name(group: u16) -> String {
    format!("column of group {group}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Codec, Direction, Factorization, Ledger};

    /// A prefix whose checksums are right and whose directory is as given: one column, one page, no records.
    fn parse(records: [Record; 2], record_bytes: u64) -> Result<Index> {
        let direction = Direction { theta: 0.0, phi: 0.0 };
        let manifest = Manifest {
            name: String::new(),
            generator: String::new(),
            width: 8,
            height: 8,
            wrap: true,
            cosine: false,
            views: vec![direction],
            lights: vec![direction],
            components: 1,
            factorization: Factorization::Fmf,
            codec: Codec::DctDeltaZstd { step: 0.1 },
            texture_scale: 1.0,
            mean_rgb: [0.0; 3],
            singular_values: vec![1.0],
            errors: Ledger::default(),
        };
        let manifest = frame::compress(&serde_json::to_vec(&manifest).unwrap()).unwrap();
        let directory = directory::encode(records.iter()).unwrap();
        let mut header = Header {
            file_bytes: 0,
            manifest_bytes: manifest.len() as u64,
            tables_bytes: 0,
            directory_bytes: directory.len() as u64,
            manifest_hash: xxh3_64(&manifest),
            directory_hash: xxh3_64(&directory),
        };
        header.file_bytes = header.prefix_bytes() + record_bytes;
        Index::parse(&[&header.to_bytes(), &manifest[..], &directory].concat())
    }

    const COLUMN: Record = Record {
        offset: 0,
        length: 10,
        weight: 1.0,
        hash: 1,
    };
    const PAGE: Record = Record {
        offset: 10,
        length: 5,
        weight: 0.5,
        hash: 2,
    };
    const EMPTY: Record = Record {
        offset: 0,
        length: 0,
        weight: 0.0,
        hash: 0,
    };

    #[test]
    fn sound_directories_are_accepted() {
        let index = parse([COLUMN, PAGE], 15).unwrap();
        assert_eq!(index.columns()[0].length, 10);
        let start = index.file_bytes - 15;
        assert_eq!(
            index.pages(),
            [Record {
                offset: start + 10,
                ..PAGE
            }]
        );
        assert!(parse([COLUMN, EMPTY], 10).is_ok());
    }

    #[test]
    fn records_that_cannot_be_are_refused() {
        for (records, record_bytes) in [
            ([COLUMN, PAGE], 14),
            ([COLUMN, PAGE], 16),
            ([EMPTY, PAGE], 15),
            (
                [
                    COLUMN,
                    Record {
                        length: u32::MAX,
                        ..PAGE
                    },
                ],
                15,
            ),
            (
                [
                    COLUMN,
                    Record {
                        length: MAX_PAGE_BYTES + 1,
                        ..PAGE
                    },
                ],
                11 + u64::from(MAX_PAGE_BYTES),
            ),
            (
                [
                    COLUMN,
                    Record {
                        weight: f32::NAN,
                        ..PAGE
                    },
                ],
                15,
            ),
            ([COLUMN, Record { weight: -1.0, ..PAGE }], 15),
            ([COLUMN, Record { hash: 1, ..EMPTY }], 10),
        ] {
            let error = parse(records, record_bytes).unwrap_err();
            assert!(
                matches!(&error, Error::Corrupt { what, .. } if what == "directory"),
                "{error}"
            );
        }
    }
}
