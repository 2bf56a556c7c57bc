//! The packed tail: from the payload of its finest mip to borders and all coarser mips.

use super::{MipImage, page::Page, region::address};
use crate::codec::region::HALF_MAX;
use crate::{BORDER_TEXELS, PAGE_TEXELS, Pyramid, SLOT_TEXELS};
use half::f16;

const _: () = assert!(
    crate::TAIL_TEXELS + 2 * BORDER_TEXELS <= PAGE_TEXELS,
    "the tail fits into its slot"
);

/// Fills in what the finest mip's payload determines. Each mip is the box filter of the half floats of the
/// next finer one, so that a decoder gets the same bits as the encoder.
pub(super) fn assemble(pyramid: &Pyramid, page: &mut Page) {
    let root = pyramid.root();
    let (width, height) = pyramid.mip_size(root.mip);
    let origin = pyramid.payload_origin(root, root.mip);
    let mut texels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for x in 0..width {
            texels.push(page.texels[slot_index(origin.0 + x, origin.1 + y)].map(f16::to_f32));
        }
    }
    let mut mip = MipImage {
        width,
        height,
        texels,
    };
    for level in root.mip..pyramid.mip_count() {
        if level > root.mip {
            mip = mip.downsample();
            for texel in &mut mip.texels {
                // What swings beyond the largest half float stays one.
                *texel = texel.map(|value| f16::from_f32(value.clamp(-HALF_MAX, HALF_MAX)).to_f32());
            }
        }
        place(pyramid, level, &mip, page);
    }
}

/// Puts a mip with its border into its place.
fn place(pyramid: &Pyramid, level: u8, mip: &MipImage, page: &mut Page) {
    let origin = pyramid.payload_origin(pyramid.root(), level);
    let corner = (origin.0 - BORDER_TEXELS, origin.1 - BORDER_TEXELS);
    let border = i64::from(BORDER_TEXELS);
    for y in 0..mip.height + 2 * BORDER_TEXELS {
        let row = address(i64::from(y) - border, mip.height, pyramid.wrap()) * mip.width as usize;
        for x in 0..mip.width + 2 * BORDER_TEXELS {
            let column = address(i64::from(x) - border, mip.width, pyramid.wrap());
            page.texels[slot_index(corner.0 + x, corner.1 + y)] = mip.texels[row + column].map(f16::from_f32);
        }
    }
}

fn slot_index(x: u32, y: u32) -> usize {
    (y * SLOT_TEXELS + x) as usize
}
