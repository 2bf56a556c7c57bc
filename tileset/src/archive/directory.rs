//! The directory: how long each record is, what it weighs, and its checksum. Where it lies follows from these.

use super::Record;
use crate::{GROUP_COMPONENTS, MAX_COMPONENTS, Result, frame, manifest::MAX_PAGES};

/// Bytes of one entry.
const ENTRY_BYTES: usize = 10;
/// Largest accepted directory as it is stored.
pub(super) const MAX_DIRECTORY_BYTES: u64 =
    frame::bound((MAX_PAGES as usize + MAX_COMPONENTS as usize / GROUP_COMPONENTS) * ENTRY_BYTES) as u64;

/// A weight as the directory has it: the upper half of an f32, which is within 0.4 %.
pub(super) fn stored_weight(weight: f32) -> f32 {
    let half = weight.to_bits().saturating_add(1 << 15) >> 16;
    // Not up to infinity.
    f32::from_bits(half.min(f32::MAX.to_bits() >> 16) << 16)
}

/// All columns, then all pages, as a zstd frame of the byte planes of entries of 10 bytes. Weights are those of
/// [`stored_weight`].
pub(super) fn encode<'a>(records: impl Iterator<Item = &'a Record>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for record in records {
        bytes.extend(record.length.to_le_bytes());
        bytes.extend(((record.weight.to_bits() >> 16) as u16).to_le_bytes());
        bytes.extend(record.hash.to_le_bytes());
    }
    frame::compress(&frame::to_planes(&bytes, ENTRY_BYTES))
}

/// The inverse of [`encode`] for a directory of `count` entries, all of which get this offset.
pub(super) fn decode(stored: &[u8], count: usize, offset: u64) -> std::result::Result<Vec<Record>, String> {
    let planes = frame::decompress(stored, count * ENTRY_BYTES)?;
    if planes.len() != count * ENTRY_BYTES {
        return Err(format!(
            "it has {} bytes, {} are expected",
            planes.len(),
            count * ENTRY_BYTES
        ));
    }
    let bytes = frame::from_planes(&planes, ENTRY_BYTES);
    let u32_at = |entry: &[u8], at: usize| u32::from_le_bytes(std::array::from_fn(|i| entry[at + i]));
    let record = |entry: &[u8; ENTRY_BYTES]| Record {
        offset,
        length: u32_at(entry, 0),
        weight: f32::from_bits(u32::from(u16::from_le_bytes([entry[4], entry[5]])) << 16),
        hash: u32_at(entry, 6),
    };
    Ok(bytes.as_chunks::<ENTRY_BYTES>().0.iter().map(record).collect())
}
