//! Records of one archive to pages and columns, whichever codec it has.

use super::columns::{ColumnTables, column_step};
use super::page::check_step;
use super::pyramid_dct::{self, Coefficients, PageTables};
use super::symbols::MAX_LEVEL;
use super::{Column, Page, column, page};
use crate::{Codec, Error, Manifest, PageId, Pyramid, Result, error::corrupt};

/// Largest accepted tables: what all pages and columns of an archive share.
pub const MAX_TABLES_BYTES: u64 = 4 << 20;

/// Decodes the records of one archive.
#[derive(Clone, Debug)]
pub struct Decoder {
    codec: Codec,
    pyramid: Pyramid,
    column_texels: usize,
    tables: Option<Tables>,
}

/// What the records of [`Codec::PyramidDct`] share.
#[derive(Clone, Debug)]
struct Tables {
    pages: PageTables,
    columns: ColumnTables,
    column_steps: Vec<f64>,
}

impl Decoder {
    /// What decodes the records of the archive with this manifest and these tables; see [`tables_bytes`].
    ///
    /// # Errors
    /// As [`Manifest::validate`]; [`Error::Corrupt`] for tables that are not those of such an archive.
    pub fn new(manifest: &Manifest, tables: &[u8]) -> Result<Self> {
        manifest.validate()?;
        let pyramid = manifest.pyramid()?;
        let tables = match manifest.codec {
            Codec::DctDeltaZstd { .. } if tables.is_empty() => None,
            Codec::DctDeltaZstd { .. } => {
                let detail = format!("{} bytes, but its codec has none", tables.len());
                return Err(corrupt("tables", 0, detail));
            }
            Codec::PyramidDct { .. } => {
                let parts = tables
                    .split_first_chunk()
                    .and_then(|(length, rest)| rest.split_at_checked(u32::from_le_bytes(*length) as usize));
                let Some((pages, columns)) = parts else {
                    return Err(corrupt(
                        "tables",
                        0,
                        format!("they end after {} bytes", tables.len()),
                    ));
                };
                Some(Tables {
                    pages: PageTables::from_bytes(pages, &pyramid, manifest.groups())?,
                    columns: ColumnTables::from_bytes(columns, &manifest.views, &manifest.lights)?,
                    column_steps: column_steps(manifest),
                })
            }
        };
        Ok(Self {
            codec: manifest.codec,
            pyramid,
            column_texels: manifest.column_texels(),
            tables,
        })
    }

    /// Decodes a page; `bytes` is empty for a page that equals its up-sampled parent. `parent` is `None` exactly for
    /// the root. Never panics and allocates no more than a few slots, whatever the bytes.
    ///
    /// With [`Codec::PyramidDct`] the border is exact only where the picture ends; elsewhere the parent stands in for
    /// the neighbours, whose payloads belong there.
    ///
    /// # Errors
    /// [`Error::Corrupt`] if the bytes are no record of this page, [`Error::NotFound`] if the pyramid has no such
    /// tile, [`Error::Invalid`] for a parent that is missing, unwanted, or no slot.
    pub fn page(&self, id: PageId, bytes: &[u8], parent: Option<&Page>) -> Result<Page> {
        let mut page = Page { texels: Vec::new() };
        self.page_into(id, bytes, parent, &mut page)?;
        Ok(page)
    }

    /// As [`Decoder::page`], in place of a page that is no longer needed: memory that has been used before is faster
    /// than what the system has yet to map. What the page holds does not matter; after an error it is anything.
    ///
    /// # Errors
    /// As [`Decoder::page`].
    pub fn page_into(&self, id: PageId, bytes: &[u8], parent: Option<&Page>, page: &mut Page) -> Result<()> {
        match &self.tables {
            None => *page = page::decode_page(self.codec, &self.pyramid, id, bytes, parent)?,
            Some(tables) => {
                let step = self.codec.step();
                pyramid_dct::decode_into(step, &self.pyramid, id, bytes, parent, &tables.pages, page)?;
            }
        }
        Ok(())
    }

    /// Whether [`Decoder::coefficients`] has those of a page: of any but the root, with [`Codec::PyramidDct`].
    pub fn has_coefficients(&self, id: PageId) -> bool {
        self.tables.is_some() && id.tile != self.pyramid.root()
    }

    /// Entropy decodes a page, which takes no parent; `bytes` is empty for a page that equals its up-sampled parent.
    /// Never panics and allocates no more than 4 · [`Coefficients::MAX_WORDS`] bytes and what the vector grows by,
    /// whatever the bytes.
    ///
    /// # Errors
    /// [`Error::Corrupt`] exactly where [`Decoder::page`] says so, [`Error::NotFound`] if the pyramid has no such tile,
    /// [`Error::Invalid`] where [there are none](Decoder::has_coefficients).
    pub fn coefficients(&self, id: PageId, bytes: &[u8]) -> Result<Coefficients> {
        let Some(tables) = &self.tables else {
            return Err(Error::Invalid {
                what: format!("codec {:?}", self.codec),
                detail: "its pages are decoded to texels only".into(),
            });
        };
        pyramid_dct::coefficients(self.codec.step(), &self.pyramid, id, bytes, &tables.pages)
    }

    /// Decodes the column of a group; allocation is bounded by the size of a column.
    ///
    /// # Errors
    /// [`Error::Corrupt`] if the bytes are no record of a column of this size.
    pub fn column(&self, group: u16, bytes: &[u8]) -> Result<Column> {
        match &self.tables {
            None => column::decode(self.column_texels, group, bytes),
            Some(tables) => tables.columns.decode(group, &tables.column_steps, bytes),
        }
    }
}

/// The quantizer steps of all eigen-ABRDFs of an archive with [`Codec::PyramidDct`], in units of U': they follow from
/// that of the pages, see [`column_step`], but are never too fine to be counted in. A component has unit root mean
/// square, so no coefficient of it is larger than √rows, which at the finest step is half of the largest level.
pub fn column_steps(manifest: &Manifest) -> Vec<f64> {
    let page_step = manifest.codec.step() * manifest.texture_scale;
    let finest = (manifest.column_texels() as f64).sqrt() / f64::from(MAX_LEVEL / 2);
    let texels = u64::from(manifest.width) * u64::from(manifest.height);
    manifest
        .singular_values
        .iter()
        .map(|&value| column_step(page_step, value, manifest.column_texels(), texels).max(finest))
        .collect()
}

/// The section of an archive that holds the tables of [`Codec::PyramidDct`]: the length of those of pages as a
/// little-endian u32, those of pages, those of columns.
///
/// # Errors
/// [`Error::Io`] if there is no memory for the compressor, [`Error::OverLimit`] for tables too large.
pub fn tables_bytes(pages: &PageTables, columns: &ColumnTables) -> Result<Vec<u8>> {
    let (pages, columns) = (pages.to_bytes()?, columns.to_bytes()?);
    let bytes = [&(pages.len() as u32).to_le_bytes(), &pages[..], &columns[..]].concat();
    if bytes.len() as u64 > MAX_TABLES_BYTES {
        return Err(Error::OverLimit {
            what: "bytes of the tables",
            found: bytes.len() as u64,
            limit: MAX_TABLES_BYTES,
        });
    }
    Ok(bytes)
}

/// Checks a codec's parameters.
///
/// # Errors
/// [`Error::Invalid`].
pub(crate) fn check(codec: Codec) -> Result<()> {
    check_step(codec.step()).map(|_| ())
}
