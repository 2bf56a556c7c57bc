//! Any bytes as the record of a page, plain and as the content of a zstd frame, under geometries and steps of all
//! kinds: refused, or decoded to finite values.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tileset::{Codec, PageId, Pyramid, codec::decode_page};

fuzz_target!(|input: (u16, u16, bool, i8, &[u8])| {
    let (width, height, wrap, exponent, bytes) = input;
    let Ok(pyramid) = Pyramid::new(u32::from(width % 300), u32::from(height % 300), wrap) else {
        return;
    };
    let codec = Codec::DctDeltaZstd {
        step: 2f64.powi((exponent % 24).into()),
    };
    let Ok(frame) = zstd::bulk::compress(bytes, 1) else {
        return;
    };
    for record in [bytes, &frame] {
        let mut parent = None;
        // From the root down to one of the finest pages, each with the same bytes.
        for mip in (0..=pyramid.tail_mip()).rev() {
            let (columns, rows) = pyramid.grid(mip);
            let tile = tileset::Tile {
                mip,
                x: columns as u16 - 1,
                y: rows as u16 - 1,
            };
            match decode_page(
                codec,
                &pyramid,
                PageId { group: 0, tile },
                record,
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
