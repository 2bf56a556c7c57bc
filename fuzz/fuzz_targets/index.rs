//! Any bytes as a whole archive, as they are and with all checksums of the prefix made right, so that the
//! fuzzer reaches what lies behind them: refused, or every record can be asked for.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tileset::{Archive, Index, PageId};
use xxhash_rust::xxh3::xxh3_64;

fuzz_target!(|bytes: &[u8]| {
    read(bytes);
    if let Some(bytes) = with_checksums(bytes) {
        read(&bytes);
    }
});

fn read(bytes: &[u8]) {
    let _ = Index::parse(bytes);
    if let Ok(archive) = Archive::open(bytes) {
        for group in 0..archive.index.manifest.groups() as u16 {
            let _ = archive.read_column(group);
            for tile in archive.index.pyramid.tiles().take(1000) {
                let _ = archive.read_page(PageId { group, tile });
            }
        }
    }
}

/// The archive with the checksums of its prefix as they must be, and with its true length.
fn with_checksums(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = bytes.to_vec();
    let mut rest = 0usize;
    for at in [12, 24, 28] {
        let length = u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?);
        rest = rest.checked_add(length as usize)?;
    }
    let index_hash = xxh3_64(bytes.get(64..)?.get(..rest)?);
    for (at, value) in [(16, bytes.len() as u64), (32, index_hash)] {
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    let header_hash = xxh3_64(&bytes[..56]);
    bytes[56..64].copy_from_slice(&header_hash.to_le_bytes());
    Some(bytes)
}
