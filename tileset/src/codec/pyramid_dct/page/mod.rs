//! Whole pages: blocks, parents, steps.

mod coefficients;
mod decode;
mod encode;
mod source;

use std::sync::LazyLock;

use super::scan::Scan;
use super::transform::SIDE;
use crate::{Error, PAGE_TEXELS, Pyramid, Result, Tile};

pub use coefficients::Coefficients;
pub(in crate::codec) use coefficients::coefficients;
pub(in crate::codec) use decode::decode_into;
pub use encode::{CodedPage, code_group, count_group};

/// The blocks of a page, row by row.
struct Blocks {
    width: usize,
    height: usize,
    root: bool,
}

/// A block: place in the payload, size, and what the parent gives.
#[derive(Clone, Copy)]
struct Place {
    x: usize,
    y: usize,
    size: (usize, usize),
    /// Columns and rows of coefficients that come from the parent.
    low: (usize, usize),
}

impl Blocks {
    fn new(pyramid: &Pyramid, tile: Tile) -> Self {
        let (width, height) = pyramid.payload(tile);
        Self {
            width: width as usize,
            height: height as usize,
            root: tile == pyramid.root(),
        }
    }

    /// Upper left corners of the blocks.
    fn corners(&self) -> impl Iterator<Item = (usize, usize)> {
        let (across, down) = (self.width.div_ceil(SIDE), self.height.div_ceil(SIDE));
        (0..across * down).map(move |i| (i % across * SIDE, i / across * SIDE))
    }

    /// The block at a corner.
    #[inline(always)]
    fn place(&self, (x, y): (usize, usize)) -> Place {
        let size = (SIDE.min(self.width - x), SIDE.min(self.height - y));
        let low = if self.root {
            (0, 0)
        } else {
            (size.0.div_ceil(2), size.1.div_ceil(2))
        };
        Place { x, y, size, low }
    }
}

/// The order of a block's coefficients: made once for full blocks, into `spare` for others.
fn scan_of<'a>(place: &Place, spare: &'a mut Option<Scan>) -> &'a Scan {
    static FULL: LazyLock<[Scan; 2]> =
        LazyLock::new(|| [(0, 0), (SIDE / 2, SIDE / 2)].map(|low| Scan::new((SIDE, SIDE), low)));
    match (place.size, place.low) {
        ((SIDE, SIDE), (0, 0)) => &FULL[0],
        ((SIDE, SIDE), _) => &FULL[1],
        (size, low) => spare.insert(Scan::new(size, low)),
    }
}

/// The step at a mip, in units of its texels: there a coefficient of the same error stands for 4^mip times as many of
/// the finest.
fn step_at(step: f32, mip: u8) -> f32 {
    step / (1u64 << mip.min(32)) as f32
}

/// Where in its parent's slot the first texel under a page lies; `None` for the root.
///
/// # Errors
/// [`Error::NotFound`] for a tile outside the pyramid.
fn parent_origin(pyramid: &Pyramid, tile: Tile) -> Result<Option<(usize, usize)>> {
    if !pyramid.contains(tile) {
        return Err(Error::NotFound {
            what: format!("page mip {} x {} y {}", tile.mip, tile.x, tile.y),
            detail: format!("the coarsest page is in mip {}", pyramid.tail_mip()),
        });
    }
    Ok(pyramid.parent(tile).map(|parent| {
        let origin = pyramid.payload_origin(parent, parent.mip);
        let half = |position: u16| usize::from(position % 2) * PAGE_TEXELS as usize / 2;
        (origin.0 as usize + half(tile.x), origin.1 as usize + half(tile.y))
    }))
}

/// What a coefficient of a parent's block of `low` is in a block of `size`: the square root of their areas' ratio.
fn low_scale(size: (usize, usize), low: (usize, usize)) -> f32 {
    ((size.0 * size.1) as f32 / (low.0 * low.1) as f32).sqrt()
}

#[cfg(test)]
mod tests;
