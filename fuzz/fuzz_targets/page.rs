//! Any bytes as the record of a page, plain and as the symbols in a zstd frame, under geometries and steps
//! of all kinds: refused, or decoded to finite values.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tileset::{BORDER_TEXELS, Codec, PageId, Pyramid, Tile, codec::decode_page};

fuzz_target!(|input: (u16, u16, bool, i8, &[u8])| {
    let (width, height, wrap, exponent, bytes) = input;
    let Ok(pyramid) = Pyramid::new(u32::from(width % 300), u32::from(height % 300), wrap) else {
        return;
    };
    let step = 2f64.powi((exponent % 24).into());
    let codec = Codec::DctDeltaZstd { step };
    for framed in [false, true] {
        let mut parent = None;
        // From the root down to one of the finest pages, each with the same bytes.
        for mip in (0..=pyramid.tail_mip()).rev() {
            let (columns, rows) = pyramid.grid(mip);
            let tile = Tile {
                mip,
                x: columns as u16 - 1,
                y: rows as u16 - 1,
            };
            let record = if framed {
                frame(&pyramid, tile, bytes)
            } else {
                bytes.to_vec()
            };
            match decode_page(
                codec,
                &pyramid,
                PageId { group: 0, tile },
                &record,
                parent.as_ref(),
            ) {
                Ok(page) => {
                    assert!(page.texels.iter().flatten().all(|value| value.is_finite()));
                    parent = Some(page);
                }
                Err(_) => break,
            }
        }
    }
});

/// A zstd frame of the bytes, with zeros for symbols that are missing.
fn frame(pyramid: &Pyramid, tile: Tile, bytes: &[u8]) -> Vec<u8> {
    let border = if tile == pyramid.root() {
        0
    } else {
        2 * BORDER_TEXELS
    };
    let (width, height) = pyramid.payload(tile);
    let blocks = (width + border).div_ceil(8) * (height + border).div_ceil(8);
    let mut symbols = bytes.to_vec();
    symbols.resize(symbols.len().max(blocks as usize * 256), 0);
    zstd::bulk::compress(&symbols, 1).unwrap_or_default()
}
