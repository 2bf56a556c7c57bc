//! A page's border before its neighbours are there.
//!
//! Where the picture ends the border is exact: it repeats the edge. Elsewhere the neighbours' texels belong there,
//! which a decoder of one page does not have: the parent's stand in for them, up-sampled linearly. The page cache
//! replaces them as neighbours arrive.

use std::ops::Range;

use half::f16;

use super::dispatch::{self, Eight, Processor};
use crate::codec::tail;
use crate::{BORDER_TEXELS, PAGE_TEXELS, Page, Pyramid, SLOT_TEXELS, Tile};

/// Fills the border of a page whose payload is there; for the root the rest of the tail.
pub(super) fn fill(pyramid: &Pyramid, tile: Tile, page: &mut Page, parent: Option<&Page>) {
    let (Some(parent), Some(place)) = (parent, pyramid.parent(tile)) else {
        return tail::assemble(pyramid, page);
    };
    let (columns, rows) = axes(pyramid, tile, place);
    dispatch::run(UpSample {
        page,
        parent,
        columns: &columns,
        rows: &rows,
    });
    if [&columns, &rows].iter().any(|axis| axis.ends != [false; 2]) {
        repeat_edges(page, &columns, &rows);
    }
}

/// Along x and along y, whether the picture ends before and behind a tile's payload.
pub(super) fn ends(pyramid: &Pyramid, tile: Tile) -> [[bool; 2]; 2] {
    let (size, mip) = (pyramid.payload(tile), pyramid.mip_size(tile.mip));
    [(tile.x, size.0, mip.0), (tile.y, size.1, mip.1)]
        .map(|(page, length, mip_length)| ends_along(pyramid.wrap(), page, length, mip_length))
}

/// Whether the picture ends before and behind a payload along one axis.
fn ends_along(wrap: bool, page: u16, length: u32, mip_length: u32) -> [bool; 2] {
    let first = u32::from(page) * PAGE_TEXELS;
    [!wrap && first == 0, !wrap && first + length == mip_length]
}

/// Both directions of a tile's slot, and where they lie in that of its parent.
fn axes(pyramid: &Pyramid, tile: Tile, parent: Tile) -> (Axis, Axis) {
    let (width, height) = pyramid.payload(tile);
    let mip = pyramid.mip_size(tile.mip);
    let origin = pyramid.payload_origin(parent, parent.mip);
    (
        Axis::new(pyramid.wrap(), tile.x, width, mip.0, origin.0),
        Axis::new(pyramid.wrap(), tile.y, height, mip.1, origin.1),
    )
}

/// Fills the border from the parent.
struct UpSample<'a> {
    page: &'a mut Page,
    parent: &'a Page,
    columns: &'a Axis,
    rows: &'a Axis,
}

impl dispatch::Work for UpSample<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, processor: impl Processor) {
        let (x, y) = (self.columns.payload(), self.rows.payload());
        let (across, down) = (x.end + BORDER_TEXELS, y.end + BORDER_TEXELS);
        for (x, y) in [
            (0..across, 0..y.start),
            (0..across, y.end..down),
            (0..x.start, y.clone()),
            (x.end..across, y.clone()),
        ] {
            up_sample(
                processor,
                self.page,
                self.parent,
                (self.columns, x),
                (self.rows, y),
            );
        }
    }
}

/// Fills a rectangle of the slot, one side of the border, from the parent: first along x, two texels at a time, then
/// along y.
#[inline(always)]
fn up_sample<P: Processor>(
    processor: P,
    page: &mut Page,
    parent: &Page,
    (columns, x): (&Axis, Range<u32>),
    (rows, y): (&Axis, Range<u32>),
) {
    for first in (x.start / 2 * 2..x.end).step_by(2) {
        let (left, ..) = columns.taps(first);
        let (mut row, ..) = rows.taps(y.start);
        let mut above = two_along_x(processor, parent, left, row);
        let mut below = two_along_x(processor, parent, left, row + 1);
        for y in y.clone() {
            let (upper, lower, along) = rows.taps(y);
            if upper != row {
                // The next one.
                (row, above) = (upper, below);
                below = two_along_x(processor, parent, left, lower);
            }
            let halves = (above + (below - above) * along).halves();
            let texels: [[f16; 4]; 2] = bytemuck::cast(halves);
            let at = (y * SLOT_TEXELS + first) as usize;
            match page.texels[at..].first_chunk_mut() {
                Some(to) if first >= x.start && first + 1 < x.end => *to = texels,
                _ if first >= x.start => page.texels[at] = texels[0],
                _ => page.texels[at + 1] = texels[1],
            }
        }
    }
}

/// A texel at an even position and the next one, between `left`, the one behind it and the one behind that, in a row of
/// the parent.
#[inline(always)]
fn two_along_x<P: Processor>(processor: P, parent: &Page, left: u32, row: u32) -> P::Eight {
    let at = (row * SLOT_TEXELS + left) as usize;
    let left = two_texels(processor, parent, at);
    let right = two_texels(processor, parent, at + 1);
    // How far even and odd positions lie behind a texel of the parent.
    let along = processor.eight([0.75, 0.75, 0.75, 0.75, 0.25, 0.25, 0.25, 0.25]);
    left + (right - left) * along
}

#[inline(always)]
fn two_texels<P: Processor>(processor: P, page: &Page, at: usize) -> P::Eight {
    let texels: &[[f16; 4]; 2] = page.texels[at..].first_chunk().expect("pages are one slot");
    processor.eight_halves(bytemuck::cast(*texels))
}

/// Repeats the edge where the picture ends.
fn repeat_edges(page: &mut Page, columns: &Axis, rows: &Axis) {
    let at = |x: u32, y: u32| (y * SLOT_TEXELS + x) as usize;
    let (payload_x, payload_y) = (columns.payload(), rows.payload());
    let (known_x, known_y) = (columns.known(), rows.known());
    for y in payload_y.clone() {
        let (first, last) = (
            page.texels[at(payload_x.start, y)],
            page.texels[at(payload_x.end - 1, y)],
        );
        page.texels[at(known_x.start, y)..at(payload_x.start, y)].fill(first);
        page.texels[at(payload_x.end, y)..at(known_x.end, y)].fill(last);
    }
    for y in (known_y.start..payload_y.start).chain(payload_y.end..known_y.end) {
        let edge = y.clamp(payload_y.start, payload_y.end - 1);
        page.texels.copy_within(
            at(known_x.start, edge)..at(known_x.end, edge),
            at(known_x.start, y),
        );
    }
}

/// One direction of a slot.
struct Axis {
    /// Texels of the payload.
    length: u32,
    /// Whether the picture ends before and behind the payload.
    ends: [bool; 2],
    /// In quarters of the parent's texels: where in its slot the centre of the child's first border texel lies.
    start: u32,
}

impl Axis {
    fn new(wrap: bool, page: u16, length: u32, mip_length: u32, parent_origin: u32) -> Self {
        let half = u32::from(page % 2) * PAGE_TEXELS / 2;
        Self {
            length,
            ends: ends_along(wrap, page, length, mip_length),
            // Three quarters more than a whole number, so that even positions lie ¾ behind a texel and odd ones ¼. Texel i
            // of the payload has its centre at (i + ½)/2, that is -½ in texels of the parent from centre to centre.
            start: 4 * (parent_origin + half) - 2 * BORDER_TEXELS - 1,
        }
    }

    /// Positions of the payload in the slot.
    fn payload(&self) -> Range<u32> {
        BORDER_TEXELS..BORDER_TEXELS + self.length
    }

    /// Positions that are exact: the payload, and the border where the picture ends.
    fn known(&self) -> Range<u32> {
        let border = self.ends.map(|ends| if ends { BORDER_TEXELS } else { 0 });
        BORDER_TEXELS - border[0]..BORDER_TEXELS + self.length + border[1]
    }

    /// The two texels of the parent's slot around `position`, and how far it lies between them.
    fn taps(&self, position: u32) -> (u32, u32, f32) {
        let quarters = self.start + 2 * position;
        let left = quarters / 4;
        (left, left + 1, (quarters % 4) as f32 * 0.25)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SLOT_AREA;

    /// The definition, texel by texel.
    fn texel(page: &Page, parent: &Page, axes: [&Axis; 2], position: [u32; 2]) -> [f32; 4] {
        let at = |page: &Page, [x, y]: [u32; 2]| page.texels[(y * SLOT_TEXELS + x) as usize].map(f16::to_f32);
        let known = |i: usize| axes[i].known().contains(&position[i]);
        if known(0) && known(1) {
            let payload = axes.map(Axis::payload);
            let edge = |i: usize| position[i].clamp(payload[i].start, payload[i].end - 1);
            return at(page, [edge(0), edge(1)]);
        }
        let [(left, right, along_x), (upper, lower, along_y)] =
            [0, 1].map(|i: usize| axes[i].taps(position[i]));
        let mix =
            |a: [f32; 4], b: [f32; 4], along: f32| std::array::from_fn(|c| a[c] + (b[c] - a[c]) * along);
        let above = mix(at(parent, [left, upper]), at(parent, [right, upper]), along_x);
        let below = mix(at(parent, [left, lower]), at(parent, [right, lower]), along_x);
        mix(above, below, along_y).map(|value| f16::from_f32(value).to_f32())
    }

    #[test]
    fn borders_are_the_parent_up_sampled_or_the_edge() {
        let noise = |seed: u32| Page {
            texels: (0..SLOT_AREA as u32)
                .map(|i| {
                    [1, 2, 3, 4].map(|c| {
                        f16::from_f32(
                            (((i + seed) * 4 + c).wrapping_mul(2_654_435_761) >> 20) as f32 / 4096.0,
                        )
                    })
                })
                .collect(),
        };
        for (width, height, wrap) in [
            (128, 128, true),
            (128, 128, false),
            (200, 70, false),
            (129, 97, true),
            (65, 300, false),
        ] {
            let pyramid = Pyramid::new(width, height, wrap).unwrap();
            for tile in pyramid.tiles().filter(|&tile| tile != pyramid.root()) {
                let (parent, before) = (noise(1), noise(77));
                let mut page = before.clone();
                fill(&pyramid, tile, &mut page, Some(&parent));
                let (columns, rows) = axes(&pyramid, tile, pyramid.parent(tile).unwrap());
                for y in 0..SLOT_TEXELS {
                    for x in 0..SLOT_TEXELS {
                        let filled =
                            x < columns.length + 2 * BORDER_TEXELS && y < rows.length + 2 * BORDER_TEXELS;
                        let found = page.texels[(y * SLOT_TEXELS + x) as usize].map(f16::to_f32);
                        let wanted = if filled {
                            texel(&before, &parent, [&columns, &rows], [x, y])
                        } else {
                            before.texels[(y * SLOT_TEXELS + x) as usize].map(f16::to_f32)
                        };
                        assert_eq!(found, wanted, "{width}x{height} {tile:?} {x} {y}");
                    }
                }
            }
        }
    }
}
