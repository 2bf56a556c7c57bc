//! Pictures to files: PNG for eyes, EXR for numbers.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use engine::metrics::Picture;
use image::{ExtendedColorType, ImageBuffer, ImageEncoder, ImageFormat, Rgb, codecs::png::PngEncoder};

use crate::file;

/// Writes bytes of sRGB, three or four a pixel, as PNG without alpha.
pub(crate) fn write_png(path: &Path, (width, height): (u32, u32), pixels: &[u8]) -> Result<()> {
    let count = width as usize * height as usize;
    let rgb: Vec<u8> = match pixels.len() / count.max(1) {
        4 => pixels
            .chunks_exact(4)
            .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect(),
        _ => pixels.to_vec(),
    };
    ensure!(
        rgb.len() == count * 3,
        "{} bytes are no picture of {width}x{height} pixels",
        pixels.len()
    );
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new(&mut bytes);
    encoder
        .write_image(&rgb, width, height, ExtendedColorType::Rgb8)
        .with_context(|| format!("cannot encode {}", path.display()))?;
    file::write(path, &bytes)
}

/// Writes linear radiance as EXR of f32.
pub(crate) fn write_exr(path: &Path, picture: &Picture) -> Result<()> {
    let values: Vec<f32> = picture.pixels.iter().flatten().copied().collect();
    let image: ImageBuffer<Rgb<f32>, Vec<f32>> = ImageBuffer::from_raw(picture.width, picture.height, values)
        .context("the picture has not as many pixels as its size says")?;
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::OpenExr)
        .with_context(|| format!("cannot encode {}", path.display()))?;
    file::write(path, bytes.get_ref())
}

/// Writes what a screen shows of linear radiance.
pub(crate) fn write_shown(path: &Path, picture: &Picture, exposure_stops: f32) -> Result<()> {
    write_png(
        path,
        (picture.width, picture.height),
        picture.to_srgb8(exposure_stops).as_flattened(),
    )
}

/// The colours of a map from 0 (black) over violet and orange to 1 (pale yellow), after matplotlib's "inferno".
pub(crate) fn heat(value: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 6] = [
        [0.0, 0.0, 4.0],
        [66.0, 10.0, 104.0],
        [147.0, 38.0, 103.0],
        [221.0, 81.0, 58.0],
        [252.0, 165.0, 10.0],
        [252.0, 255.0, 164.0],
    ];
    let position = value.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let from = (position as usize).min(STOPS.len() - 2);
    let share = position - from as f64;
    std::array::from_fn(|channel| {
        (STOPS[from][channel] * (1.0 - share) + STOPS[from + 1][channel] * share).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_pictures_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let pixels = vec![[0.0f32, 0.5, 2.0], [1e-4, 60000.0, 0.25]];
        let picture = Picture {
            width: 2,
            height: 1,
            pixels: pixels.clone(),
        };
        write_exr(&folder.path().join("a.exr"), &picture).unwrap();
        let read = image::open(folder.path().join("a.exr")).unwrap().to_rgb32f();
        assert_eq!(read.pixels().map(|pixel| pixel.0).collect::<Vec<_>>(), pixels);
        write_png(
            &folder.path().join("a.png"),
            (2, 1),
            &[1, 2, 3, 255, 4, 5, 6, 255],
        )
        .unwrap();
        let read = image::open(folder.path().join("a.png")).unwrap().to_rgb8();
        assert_eq!(read.as_raw(), &[1, 2, 3, 4, 5, 6]);
        assert!(write_png(&folder.path().join("b.png"), (2, 2), &[0; 5]).is_err());
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            2,
            "nothing temporary is left"
        );
    }

    #[test]
    fn heat_rises_in_brightness() {
        let brightness = |value: f64| heat(value).iter().map(|channel| u32::from(*channel)).sum::<u32>();
        for step in 0..20 {
            assert!(brightness(f64::from(step) / 20.0) < brightness(f64::from(step + 1) / 20.0));
        }
        assert_eq!(heat(f64::NAN.max(0.0)), heat(0.0));
    }
}
