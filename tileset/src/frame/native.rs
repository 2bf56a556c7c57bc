//! zstd, by its own library.

use std::cell::RefCell;

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::find_frame_compressed_size;

use crate::{Error, Result};

/// Close to the best that zstd can; records are small and coded once.
const LEVEL: i32 = 19;

/// What a frame begins with (RFC 8878, section 3.1.1); zstd takes frames to be skipped as well.
const MAGIC: [u8; 4] = 0xFD2F_B528_u32.to_le_bytes();

thread_local! {
    static COMPRESSOR: RefCell<Option<Compressor<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<Decompressor<'static>>> = const { RefCell::new(None) };
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
    if !frame.starts_with(&MAGIC) {
        return Err("zstd: the bytes do not begin as a frame does".to_owned());
    }
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
