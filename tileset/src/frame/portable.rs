//! zstd's decoder in Rust (`ruzstd`), for browsers.
//!
//! Checksums inside of frames, which our archives never have, are not looked at: records have hashes of their own.

use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

#[cfg(target_arch = "wasm32")]
use crate::Result;

/// Most bytes that a frame may ask a decoder to look back, beyond what it may decode to: those that every decoder is to allow
/// (RFC 8878, section 3.1.1.1.2).
const WINDOW_BYTES: u64 = 8 << 20;

/// One zstd frame that holds `raw`, not as small as it could be: nobody writes archives in a browser.
///
/// # Errors
/// None.
#[cfg(target_arch = "wasm32")]
pub(crate) fn compress(raw: &[u8]) -> Result<Vec<u8>> {
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};
    Ok(compress_to_vec(raw, CompressionLevel::Fastest))
}

/// The content of `frame`, which must be one whole zstd frame of at most `limit` bytes; the message says why
/// it is not.
pub(crate) fn decompress(frame: &[u8], limit: usize) -> std::result::Result<Vec<u8>, String> {
    let mut rest = frame;
    let mut decoder = FrameDecoder::new();
    decoder.set_max_window_size(WINDOW_BYTES.max(limit as u64));
    let too_long = || format!("zstd: the frame holds more than the {limit} bytes that are expected");
    let error = |error| format!("zstd: {error}, where at most {limit} bytes are expected");
    decoder.init(&mut rest).map_err(error)?;
    let declared = decoder.content_size();
    if declared > limit as u64 {
        return Err(too_long());
    }
    let mut content = Vec::with_capacity(declared as usize);
    while !decoder.is_finished() {
        decoder
            .decode_blocks(&mut rest, BlockDecodingStrategy::UptoBlocks(1))
            .map_err(error)?;
        // A block decodes to 128 KiB at most.
        if content.len() + decoder.can_collect() > limit {
            return Err(too_long());
        }
        content.extend(decoder.collect().unwrap_or_default());
    }
    if declared != 0 && declared != content.len() as u64 {
        return Err(format!(
            "zstd: the frame holds {} bytes and says that it holds {declared}",
            content.len()
        ));
    }
    if !rest.is_empty() {
        return Err(format!(
            "{} bytes follow the zstd frame of {}",
            rest.len(),
            frame.len() - rest.len()
        ));
    }
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::super::native;
    use super::*;

    /// What both decoders make of a frame.
    fn both(frame: &[u8], limit: usize) -> Option<Vec<u8>> {
        let (ours, theirs) = (decompress(frame, limit), native::decompress(frame, limit));
        assert_eq!(ours.is_ok(), theirs.is_ok(), "{ours:?} {theirs:?}");
        if let (Ok(ours), Ok(theirs)) = (&ours, &theirs) {
            assert!(ours == theirs);
        }
        ours.ok()
    }

    /// Contents of many kinds: runs, text, noise, noise of few symbols.
    fn contents() -> impl Iterator<Item = Vec<u8>> {
        let mut state = 7u64;
        let noise: Vec<u8> = std::iter::repeat_with(|| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 56) as u8
        })
        .take(300_000)
        .collect();
        [0, 1, 3, 100, 5_000, 131_072, 131_073, 300_000]
            .into_iter()
            .flat_map(move |length| {
                let text = b"columns and roots open groups; ".iter().cycle();
                [
                    vec![7; length],
                    text.take(length).copied().collect(),
                    noise[..length].to_vec(),
                    noise[..length]
                        .iter()
                        .map(|byte| (byte & byte >> 3) & 15)
                        .collect(),
                ]
            })
    }

    #[test]
    fn decodes_as_zstd_does() {
        for content in contents() {
            for level in [1, 3, 19] {
                let frame = zstd::bulk::compress(&content, level).unwrap();
                assert!(both(&frame, content.len()).as_ref() == Some(&content));
                if !content.is_empty() {
                    assert_eq!(both(&frame, content.len() - 1), None);
                }
            }
            // Streams do not say how long they are.
            let frame = zstd::stream::encode_all(&content[..], 19).unwrap();
            assert!(both(&frame, content.len()).as_ref() == Some(&content));
        }
    }

    #[test]
    fn refuses_what_zstd_refuses() {
        let content: Vec<u8> = (0..3000u32).flat_map(|n| (n * n % 1009).to_le_bytes()).collect();
        let frame = native::compress(&content).unwrap();
        for length in 0..frame.len() {
            assert_eq!(both(&frame[..length], content.len()), None, "{length}");
        }
        for more in [&b"x"[..], &frame, b"\x50\x2a\x4d\x18\x00\x00\x00\x00"] {
            assert_eq!(both(&[&frame, more].concat(), 100_000), None);
        }
        assert_eq!(both(b"\x50\x2a\x4d\x18\x00\x00\x00\x00", 10), None);
    }

    #[test]
    fn damage_ends_in_an_error_or_within_the_limit() {
        let content: Vec<u8> = (0..500u32).flat_map(|n| (n * n % 1009).to_le_bytes()).collect();
        let frame = native::compress(&content).unwrap();
        for at in 0..frame.len() {
            for bit in 0..8 {
                let mut bad = frame.clone();
                bad[at] ^= 1 << bit;
                if let Ok(decoded) = decompress(&bad, content.len()) {
                    assert!(decoded.len() <= content.len());
                }
            }
        }
    }
}
