//! One mip of a group's eigen-textures before coding, and the filter that makes the next coarser one.

use super::pyramid_dct::transform::{self, AREA, SIDE};
use super::texel::Texel;

/// One group's eigen-textures at one mip, `[y][x][component]`, scaled, before coding.
#[derive(Clone, Debug, PartialEq)]
pub struct MipImage {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// width × height texels.
    pub texels: Vec<[f32; 4]>,
}

impl MipImage {
    /// The next coarser mip: sides halved and rounded up, by way of the DCT.
    ///
    /// Each block of 16×16 texels keeps the lower half of its frequencies in both directions and becomes 8×8: the
    /// picture without what the coarser grid cannot show. Means of blocks are kept to the rounding of f32. Texels
    /// lie where those of a box filter would; only where a side is odd the last block, of n texels, is stretched to
    /// (n + 1)/2, which moves its texels by up to half of one.
    ///
    /// Source: Dugad and Ahuja, "A fast scheme for image size change in the compressed domain", 2001.
    ///
    /// # Panics
    /// If `texels` does not hold width × height texels.
    pub fn downsample(&self) -> MipImage {
        let (width, height) = (self.width as usize, self.height as usize);
        assert_eq!(self.texels.len(), width * height, "texels of the mip");
        let (to_width, to_height) = (width.div_ceil(2), height.div_ceil(2));
        let mut texels = vec![[0f32; 4]; to_width * to_height];
        for top in (0..height).step_by(SIDE) {
            for left in (0..width).step_by(SIDE) {
                let (wide, high) = (SIDE.min(width - left), SIDE.min(height - top));
                let mut block = [Texel::default(); AREA];
                for y in 0..high {
                    let from = &self.texels[(top + y) * width + left..][..wide];
                    for (to, from) in block[y * SIDE..].iter_mut().zip(from) {
                        *to = Texel(*from);
                    }
                }
                transform::forward(&mut block, (wide, high));
                let (to_wide, to_high) = (wide.div_ceil(2), high.div_ceil(2));
                transform::inverse(&mut block, (to_wide, to_high), SIDE);
                let scale = ((to_wide * to_high) as f32 / (wide * high) as f32).sqrt();
                for y in 0..to_high {
                    let to = &mut texels[(top / 2 + y) * to_width + left / 2..][..to_wide];
                    for (to, from) in to.iter_mut().zip(&block[y * SIDE..]) {
                        *to = (*from * scale).0;
                    }
                }
            }
        }
        MipImage {
            width: to_width as u32,
            height: to_height as u32,
            texels,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, value: impl Fn(f64, f64) -> f64) -> MipImage {
        let mut texels = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let s = (f64::from(x) + 0.5) / f64::from(width);
                let t = (f64::from(y) + 0.5) / f64::from(height);
                texels.push([value(s, t) as f32, 1.0, -2.0, 0.0]);
            }
        }
        MipImage {
            width,
            height,
            texels,
        }
    }

    #[test]
    fn smooth_pictures_stay_where_they_are() {
        // Even sides all the way to 1×1, and sides with odd halves.
        for (width, height, tolerance) in [(64, 32, 0.02), (48, 80, 0.02), (346, 335, 0.05), (17, 5, 0.3)] {
            let value = |s: f64, t: f64| (2.0 * s).sin() + t * t;
            let coarse = image(width, height, value).downsample();
            let wanted = image(width.div_ceil(2), height.div_ceil(2), value);
            assert_eq!((coarse.width, coarse.height), (wanted.width, wanted.height));
            for (found, wanted) in coarse.texels.iter().zip(&wanted.texels) {
                assert!(
                    (found[0] - wanted[0]).abs() < tolerance,
                    "{width}x{height} {found:?} {wanted:?}"
                );
                assert!((found[1] - 1.0).abs() < 1e-5 && (found[2] + 2.0).abs() < 1e-5 && found[3] == 0.0);
            }
        }
    }

    #[test]
    fn means_are_kept() {
        let fine = image(64, 48, |s, t| ((s * 91.0).sin() * (t * 57.0).cos()).abs());
        let mean = |mip: &MipImage| {
            mip.texels.iter().map(|texel| f64::from(texel[0])).sum::<f64>() / mip.texels.len() as f64
        };
        let coarse = fine.downsample();
        assert!((mean(&fine) - mean(&coarse)).abs() < 1e-6);
    }

    #[test]
    fn what_the_coarser_grid_cannot_show_is_left_out() {
        // Frequencies above the half of a block's: whole and half waves that two texels of the coarser grid cannot tell.
        let wave =
            |k: usize, i: u32| (std::f64::consts::PI * (f64::from(i) + 0.5) * k as f64 / SIDE as f64).cos();
        for k in SIDE / 2..SIDE {
            let mut fine = image(32, 32, |_, _| 0.0);
            for (i, texel) in (0..).zip(&mut fine.texels) {
                let (x, y) = (i % 32, i / 32);
                *texel = [wave(k, x), wave(k, y), wave(k, x) * wave(2, y), 0.0].map(|value| value as f32);
            }
            let coarse = fine.downsample();
            assert!(
                coarse
                    .texels
                    .as_flattened()
                    .iter()
                    .all(|value| value.abs() < 1e-6),
                "{k}"
            );
        }
    }
}
