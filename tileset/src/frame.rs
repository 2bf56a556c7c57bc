//! zstd, one frame a record, with the decoded size bounded beforehand; and byte planes, which help it.

use std::cell::RefCell;

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::find_frame_compressed_size;

use crate::{Error, Result};

/// Close to the best that zstd can; records are small and coded once.
const LEVEL: i32 = 19;

thread_local! {
    static COMPRESSOR: RefCell<Option<Compressor<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<Decompressor<'static>>> = const { RefCell::new(None) };
}

/// Largest size of a frame that holds `raw` bytes: zstd stores what it cannot shrink.
pub(crate) const fn bound(raw: usize) -> usize {
    raw + raw / 128 + 512
}

/// Entries of `size` bytes each, rearranged: the first byte of all entries, then the second of all, and so
/// on. Bytes of one meaning are alike, so zstd does better. On eigen-ABRDFs it saves 2 % against the plain
/// order and also beats differences between neighbouring directions, on a directory 11 %.
pub(crate) fn to_planes(entries: &[u8], size: usize) -> Vec<u8> {
    (0..size)
        .flat_map(|byte| entries.iter().skip(byte).step_by(size).copied())
        .collect()
}

/// The inverse of [`to_planes`].
pub(crate) fn from_planes(planes: &[u8], size: usize) -> Vec<u8> {
    to_planes(planes, planes.len() / size)
}

/// One zstd frame that holds `raw`.
///
/// # Errors
/// [`Error::Io`] if there is no memory for the compressor.
pub(crate) fn compress(raw: &[u8]) -> Result<Vec<u8>> {
    let io = |source| Error::Io {
        what: format!("compressing {} bytes", raw.len()),
        source,
    };
    COMPRESSOR.with_borrow_mut(|slot| {
        let compressor = match slot {
            Some(compressor) => compressor,
            None => slot.insert(Compressor::new(LEVEL).map_err(io)?),
        };
        compressor.compress(raw).map_err(io)
    })
}

/// The content of `frame`, which must be one whole zstd frame of at most `limit` bytes; the message says why
/// it is not.
pub(crate) fn decompress(frame: &[u8], limit: usize) -> std::result::Result<Vec<u8>, String> {
    // zstd would go on with further frames and skip unknown ones.
    match find_frame_compressed_size(frame) {
        Ok(length) if length == frame.len() => {}
        Ok(length) => {
            return Err(format!(
                "{} bytes follow the zstd frame of {length}",
                frame.len() - length
            ));
        }
        Err(code) => return Err(format!("zstd: {}", zstd::zstd_safe::get_error_name(code))),
    }
    let error = |error: std::io::Error| format!("zstd: {error}, where at most {limit} bytes are expected");
    DECOMPRESSOR.with_borrow_mut(|slot| {
        let decompressor = match slot {
            Some(decompressor) => decompressor,
            None => slot.insert(Decompressor::new().map_err(error)?),
        };
        decompressor.decompress(frame, limit).map_err(error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_the_bytes_of_one_kind() {
        let planes = to_planes(b"a1xb2yc3z", 3);
        assert_eq!(planes, b"abc123xyz");
        assert_eq!(from_planes(&planes, 3), b"a1xb2yc3z");
        assert!(from_planes(&[], 3).is_empty());
    }

    #[test]
    fn frames_must_be_whole_single_and_small_enough() {
        let frame = compress(&[7; 1000]).unwrap();
        assert_eq!(decompress(&frame, 1000).unwrap(), [7; 1000]);
        assert!(decompress(&frame, 999).is_err());
        for length in 0..frame.len() {
            assert!(decompress(&frame[..length], 1000).is_err());
        }
        for more in [&b"x"[..], &frame, b"\x50\x2a\x4d\x18\x00\x00\x00\x00"] {
            assert!(decompress(&[&frame, more].concat(), 10_000).is_err());
        }
        // A frame that claims the largest size is not believed.
        let bomb = compress(&vec![0; 1 << 24]).unwrap();
        assert!(decompress(&bomb, 100).is_err());
    }

    #[test]
    fn noise_stays_within_the_bound() {
        let mut state = 1u64;
        for length in [0, 1, 100, 100_000] {
            let noise: Vec<u8> = std::iter::repeat_with(|| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            })
            .take(length)
            .collect();
            assert!(compress(&noise).unwrap().len() <= bound(length));
        }
    }
}
