//! The first 64 bytes.

use xxhash_rust::xxh3::xxh3_64;

use super::directory::MAX_DIRECTORY_BYTES;
use crate::{Error, Result, codec::MAX_TABLES_BYTES, error::corrupt, frame};

/// Length of the fixed header.
pub const HEADER_BYTES: usize = 64;

/// First bytes of every archive. The first is no text, and the last two are changed by whatever converts
/// line ends.
pub(super) const MAGIC: [u8; 8] = *b"\x89BSVTF\r\n";
/// The version that is written and read. Those before were never released.
pub(super) const VERSION: u32 = 6;
/// Largest accepted text of a manifest: twice what the largest valid one can need.
pub(super) const MAX_MANIFEST_BYTES: usize = 1 << 20;

/// Largest index: header, manifest, tables and directory, as they stand in the file.
pub const MAX_INDEX_BYTES: u64 = HEADER_BYTES as u64
    + frame::bound(MAX_MANIFEST_BYTES) as u64
    + MAX_TABLES_BYTES
    + MAX_DIRECTORY_BYTES as u64;

/// The header's members; all integers are little-endian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Header {
    /// Bytes of the whole archive.
    pub file_bytes: u64,
    /// Bytes of the manifest, a zstd frame, which follows the header.
    pub manifest_bytes: u32,
    /// Bytes of the codec's tables, which follow the manifest.
    pub tables_bytes: u32,
    /// Bytes of the directory, which follows the tables.
    pub directory_bytes: u32,
    /// XXH3-64 of manifest, tables and directory.
    pub index_hash: u64,
    /// XXH3-128 of the contents of all records, in the order in which they stand.
    pub contents_hash: u128,
}

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self> {
        let failed = |offset, detail: String| Err(corrupt("header", offset, detail));
        let known = bytes.len().min(MAGIC.len());
        if bytes[..known] != MAGIC[..known] {
            return failed(0, "the first bytes are not those of an archive".into());
        }
        let Some(bytes) = bytes.first_chunk::<HEADER_BYTES>() else {
            return failed(
                bytes.len() as u64,
                format!("it ends here, {HEADER_BYTES} bytes are needed"),
            );
        };
        let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        // The version comes first: a newer one may mean anything by the rest, except by its checksum.
        let (version, hash) = (u32_at(8), u64_at(56));
        if hash != xxh3_64(&bytes[..56]) {
            return failed(56, "its checksum does not match".into());
        }
        if version != VERSION {
            return Err(Error::UnsupportedVersion {
                found: version,
                supported: VERSION,
            });
        }
        let header = Header {
            tables_bytes: u32_at(12),
            file_bytes: u64_at(16),
            manifest_bytes: u32_at(24),
            directory_bytes: u32_at(28),
            index_hash: u64_at(32),
            contents_hash: u128::from(u64_at(40)) | u128::from(u64_at(48)) << 64,
        };
        for (what, found, limit) in [
            (
                "bytes of the manifest",
                header.manifest_bytes,
                frame::bound(MAX_MANIFEST_BYTES) as u64,
            ),
            ("bytes of the tables", header.tables_bytes, MAX_TABLES_BYTES),
            (
                "bytes of the directory",
                header.directory_bytes,
                MAX_DIRECTORY_BYTES.into(),
            ),
        ] {
            let found = u64::from(found);
            if found > limit {
                return Err(Error::OverLimit { what, found, limit });
            }
        }
        if header.file_bytes < header.prefix_bytes() {
            let detail = format!(
                "a file of {} bytes cannot hold {}",
                header.file_bytes,
                header.prefix_bytes()
            );
            return failed(16, detail);
        }
        Ok(header)
    }

    pub(super) fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&VERSION.to_le_bytes());
        for (at, value) in [
            (12, self.tables_bytes),
            (24, self.manifest_bytes),
            (28, self.directory_bytes),
        ] {
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        bytes[16..24].copy_from_slice(&self.file_bytes.to_le_bytes());
        bytes[32..40].copy_from_slice(&self.index_hash.to_le_bytes());
        bytes[40..56].copy_from_slice(&self.contents_hash.to_le_bytes());
        let hash = xxh3_64(&bytes[..56]);
        bytes[56..].copy_from_slice(&hash.to_le_bytes());
        bytes
    }

    /// Bytes of header, manifest, tables and directory.
    pub(super) fn prefix_bytes(&self) -> u64 {
        let parts = [self.manifest_bytes, self.tables_bytes, self.directory_bytes];
        HEADER_BYTES as u64 + parts.map(u64::from).iter().sum::<u64>()
    }
}
