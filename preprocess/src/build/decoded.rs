//! A mip of a group, put together from decoded pages.

use half::f16;
use half::slice::HalfFloatSliceExt;
use tileset::{PAGE_TEXELS, Page, Pyramid, SLOT_TEXELS, Tile};

/// One group's eigen-textures at one mip as a decoder sees them, `[y][x][component of the group]`, scaled as stored.
pub(crate) struct DecodedMip {
    mip: u8,
    pub(crate) texels: Vec<[f16; 4]>,
}

impl DecodedMip {
    /// Of zeros.
    pub(crate) fn new(pyramid: &Pyramid, mip: u8) -> Self {
        let (width, height) = pyramid.mip_size(mip);
        Self {
            mip,
            texels: vec![[f16::ZERO; 4]; width as usize * height as usize],
        }
    }

    /// Copies the payload of a page of this mip; other pages change nothing.
    pub(crate) fn put(&mut self, pyramid: &Pyramid, tile: Tile, page: &Page) {
        if tile.mip != self.mip {
            return;
        }
        let stride = pyramid.mip_size(self.mip).0 as usize;
        let (width, height) = pyramid.payload(tile);
        let (left, top) = pyramid.payload_origin(tile, self.mip);
        let (x, y) = (u32::from(tile.x) * PAGE_TEXELS, u32::from(tile.y) * PAGE_TEXELS);
        for row in 0..height {
            let from = ((top + row) * SLOT_TEXELS + left) as usize;
            let to = (y + row) as usize * stride + x as usize;
            let width = width as usize;
            self.texels[to..to + width].copy_from_slice(&page.texels[from..from + width]);
        }
    }

    /// What is lost where pages of this mip are missing and the next coarser mip, filtered bilinearly as renderers do, stands in for
    /// them; `[tile y][tile x]`.
    ///
    /// Source: Schwartz, Ruiters, Klein, 2013, equation 8.
    pub(crate) fn lost_without(&self, coarser: &Self, pyramid: &Pyramid) -> Vec<Loss> {
        let (width, height) = pyramid.mip_size(self.mip);
        let (coarse_width, coarse_height) = pyramid.mip_size(coarser.mip);
        let (columns, rows) = pyramid.grid(self.mip);
        let across = taps(width, coarse_width, pyramid.wrap());
        let down = taps(height, coarse_height, pyramid.wrap());
        let mut losses = vec![Loss::default(); (columns * rows) as usize];
        let mut lines = [0; 2].map(|_| Line::new(width, coarse_width));
        let mut fine = vec![[0f32; 4]; width as usize];
        let texels = self.texels.chunks_exact(width as usize);
        for ((y, texels), tap) in texels.enumerate().zip(&down) {
            // The upper line of a tap is often the lower one of the tap before.
            if lines[1].row == Some(tap.texels[0]) {
                lines.swap(0, 1);
            }
            for (line, row) in lines.iter_mut().zip(tap.texels) {
                line.fill(row, coarser, &across);
            }
            convert(texels, &mut fine);
            let [upper, lower] = &lines;
            let losses = &mut losses[(y / PAGE_TEXELS as usize) * columns as usize..];
            let pages = fine.chunks(PAGE_TEXELS as usize);
            let drawn = upper.texels.chunks(PAGE_TEXELS as usize);
            let drawn = drawn.zip(lower.texels.chunks(PAGE_TEXELS as usize));
            for ((loss, fine), (upper, lower)) in losses.iter_mut().zip(pages).zip(drawn) {
                let (mut sum, mut largest) = (0f32, 0f32);
                for ((fine, upper), lower) in fine.iter().zip(upper).zip(lower) {
                    let square = |c: usize| {
                        let difference = fine[c] - (upper[c] + (lower[c] - upper[c]) * tap.fraction);
                        difference * difference
                    };
                    let squares = (square(0) + square(1)) + (square(2) + square(3));
                    sum += squares;
                    largest = largest.max(squares);
                }
                loss.mean += f64::from(sum);
                loss.largest = loss.largest.max(f64::from(largest));
            }
        }
        for (i, loss) in (0..).zip(&mut losses) {
            let (x, y) = ((i % columns) as u16, (i / columns) as u16);
            let (width, height) = pyramid.payload(Tile { mip: self.mip, x, y });
            loss.mean /= f64::from(width * height);
        }
        losses
    }
}

/// Squared differences of a page to what is drawn without it, summed over the components.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Loss {
    /// Mean over the payload.
    pub(crate) mean: f64,
    /// Of the texel that is off most.
    pub(crate) largest: f64,
}

/// Two neighbours of the coarser mip, and how far from the first to the second a texel lies.
struct Tap {
    texels: [usize; 2],
    fraction: f32,
}

/// For each of `fine` texels: its centre (x + ½)·coarse/fine − ½ among those of `coarse`.
fn taps(fine: u32, coarse: u32, wrap: bool) -> Vec<Tap> {
    let (fine, coarse) = (i64::from(fine), i64::from(coarse));
    let inside = |texel: i64| match wrap {
        true => texel.rem_euclid(coarse) as usize,
        false => texel.clamp(0, coarse - 1) as usize,
    };
    let tap = |x: i64| {
        let numerator = (2 * x + 1) * coarse - fine;
        let first = numerator.div_euclid(2 * fine);
        Tap {
            texels: [inside(first), inside(first + 1)],
            fraction: numerator.rem_euclid(2 * fine) as f32 / (2 * fine) as f32,
        }
    };
    (0..fine).map(tap).collect()
}

/// A line of the coarser mip, as wide as the finer.
struct Line {
    row: Option<usize>,
    coarse: Vec<[f32; 4]>,
    texels: Vec<[f32; 4]>,
}

impl Line {
    fn new(width: u32, coarse_width: u32) -> Self {
        Self {
            row: None,
            coarse: vec![[0.0; 4]; coarse_width as usize],
            texels: vec![[0.0; 4]; width as usize],
        }
    }

    fn fill(&mut self, row: usize, coarser: &DecodedMip, across: &[Tap]) {
        if self.row.replace(row) == Some(row) {
            return;
        }
        let width = self.coarse.len();
        convert(&coarser.texels[row * width..][..width], &mut self.coarse);
        for (texel, tap) in self.texels.iter_mut().zip(across) {
            let [left, right] = tap.texels.map(|x| self.coarse[x]);
            *texel = std::array::from_fn(|c| left[c] + (right[c] - left[c]) * tap.fraction);
        }
    }
}

fn convert(from: &[[f16; 4]], to: &mut [[f32; 4]]) {
    from.as_flattened().convert_to_f32_slice(to.as_flattened_mut());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What stands in for a texel, as a picture of the coarser mip would be read at its place.
    fn drawn(coarser: &DecodedMip, size: (u32, u32), wrap: bool, s: f64, t: f64, c: usize) -> f64 {
        let (width, height) = (f64::from(size.0), f64::from(size.1));
        let (x, y) = (s * width - 0.5, t * height - 0.5);
        let at = |x: f64, y: f64| {
            let inside = |i: f64, n: f64| {
                if wrap {
                    i.rem_euclid(n)
                } else {
                    i.clamp(0.0, n - 1.0)
                }
            };
            let index = inside(y, height) as usize * size.0 as usize + inside(x, width) as usize;
            f64::from(coarser.texels[index][c].to_f32())
        };
        let (left, top) = (x.floor(), y.floor());
        let (a, b) = (x - left, y - top);
        let row = |y: f64| at(left, y) * (1.0 - a) + at(left + 1.0, y) * a;
        row(top) * (1.0 - b) + row(top + 1.0) * b
    }

    #[test]
    fn a_page_is_missed_by_its_difference_to_the_filtered_parent() {
        for (width, height, wrap) in [(131, 70, true), (64, 130, false), (65, 33, true)] {
            let pyramid = Pyramid::new(width, height, wrap).unwrap();
            let mut state = 1u32;
            let mut noise = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f16::from_f32((state >> 8) as f32 / (1 << 24) as f32 - 0.5)
            };
            let [fine, coarse] = [0, 1].map(|mip| {
                let mut mip = DecodedMip::new(&pyramid, mip);
                mip.texels.as_flattened_mut().fill_with(&mut noise);
                mip
            });
            let found = fine.lost_without(&coarse, &pyramid);
            let mut wanted = vec![(0.0, 0.0, 0f64); found.len()];
            let columns = pyramid.grid(0).0;
            for (i, texel) in (0..).zip(&fine.texels) {
                let (x, y) = (i % width, i / width);
                let (s, t) = (
                    (f64::from(x) + 0.5) / f64::from(width),
                    (f64::from(y) + 0.5) / f64::from(height),
                );
                let (sum, count, largest) =
                    &mut wanted[(y / PAGE_TEXELS * columns + x / PAGE_TEXELS) as usize];
                let squares = texel.iter().enumerate().map(|(c, value)| {
                    let drawn = drawn(&coarse, pyramid.mip_size(1), wrap, s, t, c);
                    (f64::from(value.to_f32()) - drawn).powi(2)
                });
                let squares: f64 = squares.sum();
                *sum += squares;
                *count += 1.0;
                *largest = largest.max(squares);
            }
            for (found, (sum, count, largest)) in found.iter().zip(wanted) {
                assert!(
                    (found.mean * count / sum - 1.0).abs() < 1e-5,
                    "{found:?} {sum} {count}"
                );
                assert!(
                    (found.largest / largest - 1.0).abs() < 1e-5,
                    "{found:?} {largest}"
                );
            }
        }
    }
}
