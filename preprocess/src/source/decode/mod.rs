//! One image file as linear RGB planes.
//!
//! - [`header`]: size of an image, without decoding it.
//! - [`decode`]: its samples.
//!
//! The encoding is told by the first bytes, never by the name. Before anything is allocated for an image, the size in
//! its header is compared with what is expected and with the length of the file: no file of a given length can hold
//! more than a bounded number of samples.
//!
//! Embedded colour profiles and gamma chunks are not read; see [`Color`] for what is assumed instead. Alpha is left
//! out. Grey becomes three equal channels.

mod color;
mod exr;
mod raster;
pub(in crate::source) mod spectrum;

pub use color::Color;

/// Largest encoded image.
pub(super) const MAX_ENCODED_BYTES: u64 = 1 << 30;
/// Largest decoded image, in the samples of its file.
const MAX_DECODED_BYTES: u64 = 4 << 30;
/// A decoded size that no header needs to justify.
const ALWAYS_DECODED_BYTES: u64 = 16 << 20;
/// Deflate, which PNG and EXR use, yields at most 1032 bytes for one (Deutsch: RFC 1951, 258 bytes for two bits);
/// JPEG and RLE yield less.
const MAX_EXPANSION: u64 = 1100;

/// How an image is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Jpeg,
    Png,
    Hdr,
    Exr,
}

impl Encoding {
    /// From the first bytes of a file.
    fn of(bytes: &[u8]) -> Option<Self> {
        [
            (&b"\xff\xd8\xff"[..], Self::Jpeg),
            (b"\x89PNG\r\n\x1a\n", Self::Png),
            (b"#?RADIANCE", Self::Hdr),
            (b"#?RGBE", Self::Hdr),
            (b"\x76\x2f\x31\x01", Self::Exr),
        ]
        .into_iter()
        .find_map(|(magic, encoding)| bytes.starts_with(magic).then_some(encoding))
    }

    /// For people.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "JPEG",
            Self::Png => "PNG",
            Self::Hdr => "Radiance HDR",
            Self::Exr => "OpenEXR",
        }
    }
}

/// Whether a file that begins so is an image that is read.
pub(super) fn is_image(bytes: &[u8]) -> bool {
    Encoding::of(bytes).is_some()
}

/// How the numbers in a set of images are to be read.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Reading {
    /// What the user said, for all images.
    pub(super) color: Option<Color>,
    /// Whether the channels R, G, B of EXR images without chromaticities hold X, Y, Z, as in the UTIA database.
    pub(super) exr_rgb_is_xyz: bool,
}

/// What an image says about itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    /// Width and height.
    pub(super) size: (u32, u32),
    /// Bytes of its samples when decoded.
    pub(super) decoded_bytes: u64,
}

/// Reads the header. `bytes` may be only the beginning of the file, if that is long enough.
///
/// # Errors
/// What is wrong with it.
pub(super) fn header(bytes: &[u8]) -> Result<Header, String> {
    let Some(encoding) = Encoding::of(bytes) else {
        let first = &bytes[..bytes.len().min(8)];
        return Err(format!(
            "begins with bytes {first:02x?}, expected a JPEG, PNG, Radiance HDR or OpenEXR image"
        ));
    };
    let (size, texel_bytes) = guarded(encoding, || match encoding {
        Encoding::Exr => exr::size(bytes),
        _ => raster::size(encoding, bytes),
    })?;
    if size.0 == 0 || size.1 == 0 {
        return Err(format!("is an image of {}x{} texels", size.0, size.1));
    }
    let decoded_bytes = (u64::from(size.0) * u64::from(size.1)).saturating_mul(texel_bytes);
    Ok(Header {
        encoding,
        size,
        decoded_bytes,
    })
}

/// Decodes an image to linear RGB, `[rgb][y][x]`.
///
/// # Errors
/// What is wrong with it: not of the expected width and height, damaged, cut short, or larger than its file can be.
///
/// # Panics
/// If `out` has not the length of the expected size.
pub(super) fn decode(
    bytes: &[u8],
    expected: (u32, u32),
    reading: Reading,
    out: &mut [f32],
) -> Result<(), String> {
    assert_eq!(out.len(), 3 * expected.0 as usize * expected.1 as usize);
    let header = header(bytes)?;
    header.check(expected)?;
    header.check_length(bytes.len() as u64)?;
    guarded(header.encoding, || match header.encoding {
        Encoding::Exr => exr::decode(bytes, expected, reading, out),
        encoding => raster::decode(encoding, bytes, reading.color.unwrap_or(encoding.color()), out),
    })
}

impl Header {
    /// Compares the size with that of the other images.
    pub(super) fn check(&self, expected: (u32, u32)) -> Result<(), String> {
        if self.size == expected {
            return Ok(());
        }
        let ((width, height), (expected_width, expected_height)) = (self.size, expected);
        Err(format!(
            "has {width}x{height} texels, expected {expected_width}x{expected_height} as the first image has"
        ))
    }

    /// Whether a file of this length can hold what the header promises.
    pub(super) fn check_length(&self, file_bytes: u64) -> Result<(), String> {
        let possible = file_bytes.saturating_mul(MAX_EXPANSION);
        if self.decoded_bytes > MAX_DECODED_BYTES.min(possible.max(ALWAYS_DECODED_BYTES)) {
            return Err(format!(
                "its header promises {}x{} texels of {} bytes in all, which {file_bytes} bytes of {} cannot hold",
                self.size.0,
                self.size.1,
                self.decoded_bytes,
                self.encoding.name()
            ));
        }
        Ok(())
    }
}

impl Encoding {
    /// What the numbers of an image mean unless told otherwise.
    fn color(self) -> Color {
        match self {
            Self::Jpeg | Self::Png => Color::Srgb,
            Self::Hdr | Self::Exr => Color::Linear,
        }
    }
}

/// A defect of a decoder is an error of the image that shows it, not the end of a run of hours.
fn guarded<T>(encoding: Encoding, work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    // Unwind safety: what is half written is thrown away with the error.
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(format!(
            "the {} decoder failed on it: it is damaged",
            encoding.name()
        ))
    })
}
