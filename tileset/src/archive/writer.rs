//! From records to a file.

use xxhash_rust::xxh3::{Xxh3, xxh3_64, xxh3_128};

use super::{
    Record, directory,
    header::Header,
    index::{CHECKSUM_BYTES, checksum, column_name},
    order::{self, Item},
};
use crate::{
    Error, Manifest, PageId, Pyramid, Result,
    codec::{Decoder, MAX_COLUMN_BYTES, MAX_PAGE_BYTES},
    frame,
};

/// Collects records and writes an archive in streaming order.
#[derive(Debug)]
pub struct ArchiveWriter {
    manifest: Manifest,
    tables: Vec<u8>,
    pyramid: Pyramid,
    tiles: usize,
    columns: Vec<Option<Pending>>,
    pages: Vec<Option<Pending>>,
}

/// A record that waits for its place.
#[derive(Debug)]
struct Pending {
    bytes: Vec<u8>,
    weight: f64,
}

impl ArchiveWriter {
    /// An archive with this manifest and no records yet, of a codec without tables.
    ///
    /// # Errors
    /// As [`Decoder::new`].
    pub fn new(manifest: Manifest) -> Result<Self> {
        Self::with_tables(manifest, Vec::new())
    }

    /// An archive with this manifest, these tables of its codec, and no records yet.
    ///
    /// # Errors
    /// As [`Decoder::new`].
    pub fn with_tables(manifest: Manifest, tables: Vec<u8>) -> Result<Self> {
        Decoder::new(&manifest, &tables)?;
        let pyramid = manifest.pyramid()?;
        let mut columns = Vec::new();
        columns.resize_with(manifest.groups() as usize, || None);
        let mut pages = Vec::new();
        pages.resize_with(manifest.page_count()? as usize, || None);
        Ok(Self {
            manifest,
            tables,
            pyramid,
            tiles: pyramid.tile_count() as usize,
            columns,
            pages,
        })
    }

    /// Adds a page's record, its contents without the checksum. Every page must be added once.
    ///
    /// # Errors
    /// [`Error::NotFound`] if the manifest has no such page; [`Error::Invalid`] if it is there already, or
    /// too long, or `weight` is not a finite number from zero up.
    pub fn add_page(&mut self, page: PageId, bytes: Vec<u8>, weight: f64) -> Result<()> {
        let place = self.page_place(page);
        let pending = place.and_then(|place| self.pages.get_mut(place));
        add(
            page.to_string(),
            pending,
            Pending { bytes, weight },
            MAX_PAGE_BYTES,
        )
    }

    /// Adds a column's record; `weight` is the mean square of the group's eigen-textures.
    ///
    /// # Errors
    /// As [`ArchiveWriter::add_page`].
    pub fn add_column(&mut self, group: u16, bytes: Vec<u8>, weight: f64) -> Result<()> {
        let what = column_name(group);
        if bytes.is_empty() {
            return Err(Error::Invalid {
                what,
                detail: "its record must not be empty".into(),
            });
        }
        add(
            what,
            self.columns.get_mut(usize::from(group)),
            Pending { bytes, weight },
            MAX_COLUMN_BYTES,
        )
    }

    /// Orders the records so that a prefix of the file is already a picture, and writes all of it; returns
    /// the number of bytes.
    ///
    /// A column comes before its group's pages, a page before its children; among what is allowed the next
    /// record is the one with the largest predicted reduction of squared error per byte.
    ///
    /// # Errors
    /// [`Error::Invalid`] if a page or column was not added, [`Error::OverLimit`] for a manifest that is too
    /// long, [`Error::Io`].
    pub fn write(self, out: &mut dyn std::io::Write) -> Result<u64> {
        self.check_complete()?;
        let manifest = serde_json::to_vec(&self.manifest).map_err(|error| Error::Invalid {
            what: "manifest".into(),
            detail: error.to_string(),
        })?;
        let manifest = frame::compress(&manifest)?;
        let mut columns: Vec<Record> = self.columns.iter().map(unplaced).collect();
        let mut pages: Vec<Record> = self.pages.iter().map(unplaced).collect();
        let (order, record_bytes) = order::place(&self.pyramid, &mut columns, &mut pages, 0);
        let directory = directory::encode(&self.pyramid, &columns, &pages)?;
        let rest = [&manifest[..], &self.tables, &directory].concat();
        let mut contents_hash = Xxh3::new();
        for &item in &order {
            contents_hash.update(self.contents(item));
        }
        let mut header = Header {
            file_bytes: 0,
            manifest_bytes: manifest.len() as u32,
            tables_bytes: self.tables.len() as u32,
            directory_bytes: directory.len() as u32,
            index_hash: xxh3_64(&rest),
            contents_hash: contents_hash.digest128(),
        };
        header.file_bytes = header.prefix_bytes() + record_bytes;

        let prefix = [&header.to_bytes()[..], &rest].concat();
        let id = xxh3_128(&prefix);
        let mut write = |bytes: &[u8]| {
            out.write_all(bytes).map_err(|source| Error::Io {
                what: "writing the archive".into(),
                source,
            })
        };
        write(&prefix)?;
        for contents in order.iter().map(|&item| self.contents(item)) {
            write(contents)?;
            write(&checksum(id, contents))?;
        }
        Ok(header.file_bytes)
    }

    /// Where a page's record is kept.
    fn page_place(&self, page: PageId) -> Option<usize> {
        let tile = self.pyramid.tile_index(page.tile)? as usize;
        Some(usize::from(page.group) * self.tiles + tile)
    }

    fn check_complete(&self) -> Result<()> {
        let missing = |what: String| Error::Invalid {
            what,
            detail: "it was not added to the archive".into(),
        };
        if let Some(group) = self.columns.iter().position(Option::is_none) {
            return Err(missing(column_name(group as u16)));
        }
        if let Some(place) = self.pages.iter().position(Option::is_none) {
            let tile = self
                .pyramid
                .tile_at((place % self.tiles) as u32)
                .unwrap_or(self.pyramid.root());
            return Err(missing(
                PageId {
                    group: (place / self.tiles) as u16,
                    tile,
                }
                .to_string(),
            ));
        }
        Ok(())
    }

    fn contents(&self, item: Item) -> &[u8] {
        let pending = match item {
            Item::Column(group) => self.columns[usize::from(group)].as_ref(),
            Item::Page(page) => self.page_place(page).and_then(|place| self.pages[place].as_ref()),
        };
        pending.map_or(&[], |pending| &pending.bytes)
    }
}

/// Puts a record into its place, once.
fn add(what: String, place: Option<&mut Option<Pending>>, pending: Pending, limit: u32) -> Result<()> {
    let Some(place) = place else {
        return Err(Error::NotFound {
            what,
            detail: "its manifest describes fewer groups or tiles".into(),
        });
    };
    let length = pending.bytes.len() as u64;
    if length > limit.into() {
        return Err(Error::OverLimit {
            what: "bytes of a record",
            found: length,
            limit: limit.into(),
        });
    }
    // Not a number compares false, so it is refused too.
    if !(0.0..=f32::MAX.into()).contains(&pending.weight) {
        let detail = format!("its weight {} is negative or no number", pending.weight);
        return Err(Error::Invalid { what, detail });
    }
    if place.is_some() {
        return Err(Error::Invalid {
            what,
            detail: "it was added twice".into(),
        });
    }
    *place = Some(pending);
    Ok(())
}

/// The directory entry without its offset.
fn unplaced(pending: &Option<Pending>) -> Record {
    let (contents, weight) = pending
        .as_ref()
        .map_or((0, 0.0), |pending| (pending.bytes.len() as u32, pending.weight));
    Record {
        offset: 0,
        length: if contents > 0 {
            contents + CHECKSUM_BYTES
        } else {
            0
        },
        weight: directory::stored_weight(weight as f32),
    }
}
