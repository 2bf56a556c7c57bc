//! JPEG, PNG and Radiance HDR.

use std::io::Cursor;

use image::{ColorType, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::color::{LINEAR_FROM_SRGB8, LINEAR_FROM_SRGB16, linear_from_srgb, rgb_from_xyz};
use super::{Color, Encoding, MAX_DECODED_BYTES};

/// Width and height, and the bytes of a decoded texel.
pub(super) fn size(encoding: Encoding, bytes: &[u8]) -> Result<((u32, u32), u64), String> {
    let decoder = decoder(encoding, bytes)?;
    Ok((
        decoder.dimensions(),
        u64::from(decoder.color_type().bytes_per_pixel()),
    ))
}

/// Decodes to `[rgb][y][x]`; the caller has checked the size.
pub(super) fn decode(encoding: Encoding, bytes: &[u8], color: Color, out: &mut [f32]) -> Result<(), String> {
    if encoding == Encoding::Jpeg {
        check_end_of_jpeg(bytes)?;
    }
    let decoder = decoder(encoding, bytes)?;
    let kind = decoder.color_type();
    let channels = usize::from(kind.channel_count());
    let count = out.len() / 3 * channels;
    let srgb = color == Color::Srgb;
    match kind {
        ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => {
            let samples = samples::<u8>(decoder, count)?;
            match srgb {
                true => planes(&samples, channels, out, |value| {
                    LINEAR_FROM_SRGB8[usize::from(value)]
                }),
                false => planes(&samples, channels, out, |value| f32::from(value) / 255.0),
            }
        }
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            let samples = samples::<u16>(decoder, count)?;
            let table = &*LINEAR_FROM_SRGB16;
            match srgb {
                true => planes(&samples, channels, out, |value| table[usize::from(value)]),
                false => planes(&samples, channels, out, |value| f32::from(value) / 65535.0),
            }
        }
        ColorType::Rgb32F | ColorType::Rgba32F => {
            let samples = samples::<f32>(decoder, count)?;
            match srgb {
                true => planes(&samples, channels, out, |value| {
                    linear_from_srgb(value.into()) as f32
                }),
                false => planes(&samples, channels, out, |value| value),
            }
        }
        other => {
            return Err(format!(
                "has texels of type {other:?}, expected grey or RGB of 8, 16 or 32 bits"
            ));
        }
    }
    if color == Color::Xyz {
        rgb_from_xyz(out);
    }
    Ok(())
}

fn decoder<'a>(encoding: Encoding, bytes: &'a [u8]) -> Result<impl ImageDecoder + 'a, String> {
    let format = match encoding {
        Encoding::Jpeg => ImageFormat::Jpeg,
        Encoding::Png => ImageFormat::Png,
        Encoding::Hdr => ImageFormat::Hdr,
        Encoding::Exr => ImageFormat::OpenExr,
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODED_BYTES);
    reader.limits(limits);
    reader.into_decoder().map_err(|error| error.to_string())
}

/// The samples of all texels as the file has them, channels interleaved.
fn samples<T: bytemuck::Pod>(decoder: impl ImageDecoder, count: usize) -> Result<Vec<T>, String> {
    let mut samples = vec![T::zeroed(); count];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut samples);
    debug_assert_eq!(bytes.len() as u64, decoder.total_bytes());
    decoder.read_image(bytes).map_err(|error| error.to_string())?;
    Ok(samples)
}

/// Interleaved channels to planes of red, green and blue.
fn planes<T: Copy>(samples: &[T], channels: usize, out: &mut [f32], linear: impl Fn(T) -> f32) {
    let texels = out.len() / 3;
    let (red, rest) = out.split_at_mut(texels);
    let (green, blue) = rest.split_at_mut(texels);
    let planes = red.iter_mut().zip(green).zip(blue);
    for (texel, ((red, green), blue)) in samples.chunks_exact(channels).zip(planes) {
        let [r, g, b] = if channels < 3 { [0; 3] } else { [0, 1, 2] };
        (*red, *green, *blue) = (linear(texel[r]), linear(texel[g]), linear(texel[b]));
    }
}

/// The decoder fills what is missing at the end of a JPEG with grey. The marker of the end cannot occur in the data of
/// a scan, so that a file that was cut short has none after its last scan begins.
fn check_end_of_jpeg(bytes: &[u8]) -> Result<(), String> {
    let last = |code: u8| bytes.windows(2).rposition(|pair| pair == [0xff, code]);
    match (last(0xda), last(0xd9)) {
        (Some(scan), Some(end)) if end > scan => Ok(()),
        _ => Err(format!(
            "is cut short: its {} bytes have no end-of-image marker",
            bytes.len()
        )),
    }
}
