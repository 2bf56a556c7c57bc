//! Eigen-ABRDF columns, packed without loss.

use half::f16;

use crate::{Error, Manifest, Result, error::corrupt, frame, manifest::MAX_COLUMN_TEXELS};

/// Bytes of a texel: four half floats.
const TEXEL_BYTES: usize = 8;
/// Most bytes of a column's record.
pub const MAX_COLUMN_BYTES: u32 = frame::bound(MAX_COLUMN_TEXELS as usize * TEXEL_BYTES) as u32;

/// A decoded eigen-ABRDF column of one group, `[view][light][rgb][component of the group]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// views × lights × 3 texels of four components.
    pub texels: Vec<[f16; 4]>,
}

/// Codes a column.
///
/// # Errors
/// [`Error::Invalid`] for a value that is infinite or not a number, or a column of no or too many texels.
pub fn encode_column(column: &Column) -> Result<Vec<u8>> {
    let count = column.texels.len();
    if count == 0 || count > MAX_COLUMN_TEXELS as usize || !count.is_multiple_of(3) {
        return Err(Error::Invalid {
            what: format!("column of {count} texels"),
            detail: format!("views × lights × 3 texels are needed, at most {MAX_COLUMN_TEXELS}"),
        });
    }
    if let Some(bad) = column.texels.iter().flatten().find(|value| !value.is_finite()) {
        return Err(Error::Invalid {
            what: "value of an eigen-ABRDF".into(),
            detail: format!("{bad} is no finite half float"),
        });
    }
    let bytes: Vec<u8> = column
        .texels
        .iter()
        .flatten()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    frame::compress(&frame::to_planes(&bytes, TEXEL_BYTES))
}

/// Decodes a column of `manifest.column_texels()` texels; allocation is bounded by that.
///
/// # Errors
/// [`Error::Corrupt`] if the bytes are no record of a column of this size.
pub fn decode_column(manifest: &Manifest, group: u16, bytes: &[u8]) -> Result<Column> {
    decode(manifest.column_texels(), group, bytes)
}

/// Decodes a column of `count` texels.
pub(super) fn decode(count: usize, group: u16, bytes: &[u8]) -> Result<Column> {
    if count > MAX_COLUMN_TEXELS as usize {
        return Err(Error::OverLimit {
            what: "texels of a column",
            found: count as u64,
            limit: MAX_COLUMN_TEXELS.into(),
        });
    }
    let failed = |detail| corrupt(format!("column of group {group}"), 0, detail);
    let planes = frame::decompress(bytes, count * TEXEL_BYTES).map_err(failed)?;
    if planes.len() != count * TEXEL_BYTES {
        return Err(failed(format!(
            "{} bytes, {} expected",
            planes.len(),
            count * TEXEL_BYTES
        )));
    }
    let bytes = frame::from_planes(&planes, TEXEL_BYTES);
    let texels: Vec<[f16; 4]> = bytes
        .as_chunks::<TEXEL_BYTES>()
        .0
        .iter()
        .map(|texel| std::array::from_fn(|c| f16::from_le_bytes([texel[2 * c], texel[2 * c + 1]])))
        .collect();
    if texels.iter().flatten().any(|value| !value.is_finite()) {
        return Err(failed("a value is infinite or not a number".into()));
    }
    Ok(Column { texels })
}
