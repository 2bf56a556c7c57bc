//! Header, manifest and directory, checked: what every reader of an archive starts from.

use std::sync::Arc;

use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed, xxh3_128};

use super::{
    directory,
    header::{HEADER_BYTES, Header, MAX_MANIFEST_BYTES},
    order,
};
use crate::{Error, Manifest, PageId, Pyramid, Result, codec::Decoder, error::corrupt, frame};

/// Bytes at the end of every record that is stored: its checksum.
pub const CHECKSUM_BYTES: u32 = 4;

/// Directory entry of a page or column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// Offset in the archive.
    pub offset: u64,
    /// Bytes, of which the last [`CHECKSUM_BYTES`] are the checksum of the others, the contents; zero for a page that
    /// equals its up-sampled parent, which is not stored.
    pub length: u32,
    /// Pages: mean squared difference to the up-sampled parent (paper, equation 8), in squared units of
    /// reflectance. Columns: mean square of the group's eigen-textures.
    pub weight: f32,
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
    /// Content hash of the archive: XXH3-128 over header, manifest, tables and directory, and so over
    /// [`Index::contents_hash`].
    pub id: u128,
    /// Bytes of the whole archive.
    pub file_bytes: u64,
    /// XXH3-128 of the contents of all records, in the order in which they stand in the file.
    pub contents_hash: u128,
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
        let rest = &prefix[HEADER_BYTES..];
        if xxh3_64(rest) != header.index_hash {
            return Err(corrupt(
                "manifest and directory",
                HEADER_BYTES as u64,
                "their checksum does not match",
            ));
        }
        let (manifest, rest) = rest.split_at(header.manifest_bytes as usize);
        let (tables, directory) = rest.split_at(header.tables_bytes as usize);
        let directory_offset = header.prefix_bytes() - u64::from(header.directory_bytes);
        let manifest: Manifest = frame::decompress(manifest, MAX_MANIFEST_BYTES)
            .and_then(|text| serde_json::from_slice(&text).map_err(|error| error.to_string()))
            .map_err(|detail| corrupt("manifest", HEADER_BYTES as u64, detail))?;
        let decoder = Arc::new(Decoder::new(&manifest, tables)?);
        let pyramid = manifest.pyramid()?;

        let groups = manifest.groups() as usize;
        let (columns, pages) = directory::decode(directory, &pyramid, groups, header.prefix_bytes())
            .map_err(|detail| corrupt("directory", directory_offset, detail))?;
        let mut index = Index {
            manifest,
            pyramid,
            decoder,
            id: xxh3_128(prefix),
            file_bytes: header.file_bytes,
            contents_hash: header.contents_hash,
            columns,
            pages,
        };
        index
            .place_records(header.prefix_bytes())
            .map_err(|detail| corrupt("directory", directory_offset, detail))?;
        Ok(index)
    }

    /// Number of leading bytes of an archive that hold header, manifest and directory, told by the first
    /// [`HEADER_BYTES`] of it. At most [`MAX_INDEX_BYTES`](super::MAX_INDEX_BYTES), whatever the header says.
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

    /// Checks a record's bytes against its length and the checksum at their end, and gives the contents: what the decoder
    /// takes. A record of another archive, or of another version of this one, is refused, too.
    ///
    /// # Errors
    /// [`Error::Corrupt`], naming the record by `what`.
    pub fn verify<'a>(&self, what: &str, record: Record, bytes: &'a [u8]) -> Result<&'a [u8]> {
        if bytes.len() as u64 != u64::from(record.length) {
            let detail = format!("{} bytes, {} are announced", bytes.len(), record.length);
            return Err(corrupt(what, record.offset, detail));
        }
        let found = contents(bytes);
        if bytes[found.len()..] != checksum(self.id, found)[..bytes.len() - found.len()] {
            return Err(corrupt(what, record.offset, "its checksum does not match"));
        }
        Ok(found)
    }

    /// All stored records, in the order in which they stand in the file.
    pub fn stored(&self) -> Vec<Record> {
        let mut stored: Vec<Record> = self.columns.iter().chain(&self.pages).copied().collect();
        stored.retain(|record| record.length > 0);
        stored.sort_by_key(|record| record.offset);
        stored
    }

    /// Gives all records their places; the message says what records there cannot be.
    fn place_records(&mut self, prefix_bytes: u64) -> std::result::Result<(), String> {
        if let Some(group) = self.columns.iter().position(|record| record.length == 0) {
            return Err(format!("column {group} is empty, but must not be"));
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

/// What a record holds before its checksum, which is not looked at; nothing for a page that is not stored.
pub fn contents(record: &[u8]) -> &[u8] {
    &record[..record.len().saturating_sub(CHECKSUM_BYTES as usize)]
}

/// The checksum of a record of the archive `id` with these contents. By its seed it tells archives apart.
pub(super) fn checksum(id: u128, contents: &[u8]) -> [u8; CHECKSUM_BYTES as usize] {
    (xxh3_64_with_seed(contents, id as u64) as u32).to_le_bytes()
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
        let pyramid = Pyramid::new(8, 8, true).unwrap();
        let [column, page] = records;
        let directory = directory::encode(&pyramid, &[column], &[page]).unwrap();
        let mut header = Header {
            file_bytes: 0,
            manifest_bytes: manifest.len() as u32,
            tables_bytes: 0,
            directory_bytes: directory.len() as u32,
            index_hash: xxh3_64(&[&manifest[..], &directory].concat()),
            contents_hash: 0,
        };
        header.file_bytes = header.prefix_bytes() + record_bytes;
        Index::parse(&[&header.to_bytes(), &manifest[..], &directory].concat())
    }

    const COLUMN: Record = Record {
        offset: 0,
        length: 10,
        weight: 1.0,
    };
    const PAGE: Record = Record {
        offset: 10,
        length: 5,
        weight: 0.5,
    };
    const EMPTY: Record = Record {
        offset: 0,
        length: 0,
        weight: 0.0,
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
        for (records, record_bytes) in [([COLUMN, PAGE], 14), ([COLUMN, PAGE], 16), ([EMPTY, PAGE], 5)] {
            let error = parse(records, record_bytes).unwrap_err();
            assert!(
                matches!(&error, Error::Corrupt { what, .. } if what == "directory"),
                "{error}"
            );
        }
    }

    #[test]
    fn records_end_with_a_checksum_of_their_own_archive() {
        let index = parse([COLUMN, PAGE], 15).unwrap();
        let whole = [&b"x"[..], &checksum(index.id, b"x")].concat();
        assert_eq!(index.verify("page", index.pages()[0], &whole).unwrap(), b"x");
        assert_eq!(index.verify("page", EMPTY, &[]).unwrap(), b"");
        let of_another = [&b"x"[..], &checksum(index.id ^ 1, b"x")].concat();
        for wrong in [
            &of_another[..],
            &whole[..4],
            &whole[..0],
            &[&whole[..], b"x"].concat(),
        ] {
            assert!(matches!(
                index.verify("page", index.pages()[0], wrong),
                Err(Error::Corrupt { .. })
            ));
        }
    }
}
