//! Arrays of f32 back from the `.npy` files that [`preprocess::npy::write_npy_f32`] writes.
//!
//! Only these: version 1.0, little-endian f32, C order. Anything else is named and refused.

use std::path::Path;

use crate::{Error, Result};

/// Magic and version 1.0 of a `.npy` file; then follows a u16 with the length of the dictionary.
const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

/// Reads the array at `path`, which must have this shape.
///
/// # Errors
/// [`Error::Io`]; [`Error::Kept`] for another type, order, shape or length.
pub(crate) fn read_f32(path: &Path, shape: &[usize]) -> Result<Vec<f32>> {
    // Memory: as much as the file has bytes, and again as samples.
    let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
    parse(&bytes, shape).map_err(|detail| Error::Kept {
        path: path.to_owned(),
        detail,
    })
}

fn parse(bytes: &[u8], shape: &[usize]) -> std::result::Result<Vec<f32>, String> {
    let length = bytes
        .strip_prefix(MAGIC)
        .and_then(|rest| rest.first_chunk::<2>())
        .ok_or("does not begin like a .npy file of version 1.0")?;
    let begin = MAGIC.len() + 2;
    let end = begin + usize::from(u16::from_le_bytes(*length));
    let header = bytes.get(begin..end).ok_or("ends inside its header")?;
    let header = String::from_utf8_lossy(header);
    let axes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    for wanted in [
        "'descr': '<f4'".to_owned(),
        "'fortran_order': False".to_owned(),
        format!("'shape': ({})", axes.join(", ")),
    ] {
        if !header.contains(&wanted) {
            return Err(format!("has the header {}, expected {wanted}", header.trim_end()));
        }
    }
    let (samples, rest) = bytes[end..].as_chunks::<4>();
    let expected = shape.iter().product::<usize>();
    if samples.len() != expected || !rest.is_empty() {
        let found = bytes.len() - end;
        return Err(format!("holds {found} bytes of samples, expected {expected} x 4"));
    }
    Ok(samples.iter().map(|&sample| f32::from_le_bytes(sample)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_and_anything_else_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let samples: Vec<f32> = (0..24).map(|i| i as f32 * 0.1 - 1.0).collect();
        preprocess::npy::write_npy_f32(&path, &[2, 3, 4], &samples).unwrap();
        assert_eq!(read_f32(&path, &[2, 3, 4]).unwrap(), samples);

        let bytes = std::fs::read(&path).unwrap();
        let refusals = [
            ("shape", parse(&bytes, &[2, 4, 3])),
            ("95 bytes", parse(&bytes[..bytes.len() - 1], &[2, 3, 4])),
            ("ends inside", parse(&bytes[..20], &[2, 3, 4])),
            ("version 1.0", parse(b"no array", &[2, 3, 4])),
        ];
        for (named, refusal) in refusals {
            let detail = refusal.unwrap_err();
            assert!(detail.contains(named), "{detail} should name {named}");
        }
    }
}
