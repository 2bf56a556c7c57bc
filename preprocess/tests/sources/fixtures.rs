//! Image sets for the tests, written byte by byte where that is what is tested.
#![allow(dead_code, reason = "each test program uses a part")]

use std::io::{Cursor, Write};
use std::path::Path;

use image::{DynamicImage, ImageFormat, Rgb, Rgb32FImage, RgbImage};

/// Directions in whole degrees.
pub(crate) const VIEWS: [[u32; 2]; 3] = [[0, 0], [30, 0], [30, 180]];
pub(crate) const LIGHTS: [[u32; 2]; 4] = [[0, 0], [45, 0], [45, 120], [45, 240]];

/// The grey of a picture, different for each pair.
pub(crate) fn grey(view: usize, light: usize) -> u8 {
    (20 * view + 40 * light + 10) as u8
}

/// A picture of 8 bits: red is the grey, green and blue vary over it.
pub(crate) fn picture(view: usize, light: usize, width: u32, height: u32) -> DynamicImage {
    let grey = grey(view, light);
    DynamicImage::ImageRgb8(RgbImage::from_fn(width, height, |x, y| {
        Rgb([grey, (10 * x) as u8, (10 * y) as u8])
    }))
}

/// A picture of floats.
pub(crate) fn float_picture(view: usize, light: usize, width: u32, height: u32) -> DynamicImage {
    DynamicImage::ImageRgb32F(Rgb32FImage::from_fn(width, height, |x, y| {
        Rgb([
            view as f32 + 0.25 * light as f32,
            0.5 * x as f32,
            8.0 * y as f32 + 0.5,
        ])
    }))
}

pub(crate) fn encode(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub(crate) fn png(view: usize, light: usize) -> Vec<u8> {
    encode(&picture(view, light, 5, 3), ImageFormat::Png)
}

/// Names and contents of a whole set, as UTIA names them.
pub(crate) fn utia() -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for (v, [tv, pv]) in VIEWS.into_iter().enumerate() {
        for (l, [tl, pl]) in LIGHTS.into_iter().enumerate() {
            let name = format!("tv{tv:03}_pv{pv:03}/tl{tl:03}_pl{pl:03}_tv{tv:03}_pv{pv:03}.png");
            files.push((name, png(v, l)));
        }
    }
    files
}

/// Writes files below a folder.
pub(crate) fn write_files(folder: &Path, files: &[(String, Vec<u8>)]) {
    for (name, content) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }
}

/// A zip (PKWARE: APPNOTE.TXT 6.3, sections 4.3.7, 4.3.12 and 4.3.16): local headers and data, directory, its end.
/// Every second entry is deflated.
pub(crate) fn zip(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (index, (name, content)) in files.iter().enumerate() {
        let offset = bytes.len() as u32;
        let deflate = index % 2 == 1;
        let data = if deflate {
            let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        } else {
            content.clone()
        };
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let mut shared = Vec::new();
        for half in [20u16, 0x800, if deflate { 8 } else { 0 }, 0, 0x21] {
            shared.extend(half.to_le_bytes()); // version, flags (UTF-8), method, time, date
        }
        for word in [crc.sum(), data.len() as u32, content.len() as u32] {
            shared.extend(word.to_le_bytes());
        }
        shared.extend((name.len() as u16).to_le_bytes());
        shared.extend(0u16.to_le_bytes()); // extra field
        bytes.extend(b"PK\x03\x04");
        bytes.extend(&shared);
        bytes.extend(name.as_bytes());
        bytes.extend(data);
        directory.extend(b"PK\x01\x02");
        directory.extend(20u16.to_le_bytes()); // made by
        directory.extend(shared);
        directory.extend([0; 10]); // comment, disk, attributes
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let offset = bytes.len() as u32;
    bytes.extend(&directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    for half in [files.len() as u16; 2] {
        bytes.extend(half.to_le_bytes());
    }
    bytes.extend((directory.len() as u32).to_le_bytes());
    bytes.extend(offset.to_le_bytes());
    bytes.extend(0u16.to_le_bytes());
    bytes
}

/// An uncompressed OpenEXR image of half floats, 2 x 2, byte by byte (OpenEXR: File Layout). `channels` in alphabetical
/// order, each with its four samples.
pub(crate) fn exr(channels: &[(&str, [f32; 4])], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend(name.as_bytes());
        bytes.push(0);
        bytes.extend(kind.as_bytes());
        bytes.push(0);
        bytes.extend((value.len() as u32).to_le_bytes());
        bytes.extend(value);
    };
    let mut list = Vec::new();
    for (name, _) in channels {
        list.extend(name.as_bytes());
        list.push(0);
        for word in [1u32, 0, 1, 1] {
            list.extend(word.to_le_bytes()); // half; linearity and reserved; sampling
        }
    }
    list.push(0);
    let window: Vec<u8> = [0, 0, width - 1, height - 1]
        .iter()
        .flat_map(|side| side.to_le_bytes())
        .collect();
    attribute("channels", "chlist", &list);
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1f32.to_le_bytes());
    bytes.push(0);
    let line_bytes = 2 * 2 * channels.len() as u32;
    let first = bytes.len() as u64 + 2 * 8;
    for line in 0..2u64 {
        bytes.extend((first + line * (8 + u64::from(line_bytes))).to_le_bytes());
    }
    for line in 0..2usize {
        bytes.extend((line as u32).to_le_bytes());
        bytes.extend(line_bytes.to_le_bytes());
        for (_, samples) in channels {
            for sample in &samples[2 * line..2 * line + 2] {
                bytes.extend(half::f16::from_f32(*sample).to_le_bytes());
            }
        }
    }
    bytes
}
