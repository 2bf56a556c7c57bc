//! The directory: where each record lies, what it weighs, and its checksum.

use super::Record;
use crate::{GROUP_COMPONENTS, MAX_COMPONENTS, Result, frame, manifest::MAX_PAGES};

/// Bytes of one entry.
const ENTRY_BYTES: usize = 24;
/// Largest accepted directory as it is stored.
pub(super) const MAX_DIRECTORY_BYTES: u64 =
    frame::bound((MAX_PAGES as usize + MAX_COMPONENTS as usize / GROUP_COMPONENTS) * ENTRY_BYTES) as u64;

/// All columns, then all pages, as a zstd frame of the byte planes of entries of 24 bytes. Offsets count
/// from the end of the directory, whose length is not known before.
pub(super) fn encode<'a>(records: impl Iterator<Item = &'a Record>) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for record in records {
        bytes.extend(record.offset.to_le_bytes());
        bytes.extend(record.length.to_le_bytes());
        bytes.extend(record.weight.to_le_bytes());
        bytes.extend(record.hash.to_le_bytes());
    }
    frame::compress(&frame::to_planes(&bytes, ENTRY_BYTES))
}

/// The inverse of [`encode`] for a directory of `count` entries; offsets count from `origin`.
pub(super) fn decode(stored: &[u8], count: usize, origin: u64) -> std::result::Result<Vec<Record>, String> {
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
    let u64_at = |entry: &[u8], at: usize| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i]));
    let record = |entry: &[u8; ENTRY_BYTES]| Record {
        // What overflows lies outside the file, and is refused there.
        offset: u64_at(entry, 0).saturating_add(origin),
        length: u32_at(entry, 8),
        weight: f32::from_bits(u32_at(entry, 12)),
        hash: u64_at(entry, 16),
    };
    Ok(bytes.as_chunks::<ENTRY_BYTES>().0.iter().map(record).collect())
}
