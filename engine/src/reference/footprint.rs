//! The texels under a pixel.

use glam::DVec2;
use tileset::Pyramid;

/// A texel and its share.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Texel {
    /// Mip; 0 is the finest.
    pub mip: u8,
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
    /// Share; the shares of a footprint add up to one.
    pub weight: f64,
}

/// The up to eight texels of trilinear filtering.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    texels: [Texel; 8],
    count: usize,
}

/// Longest step from pixel to pixel, in texels, that is told from an infinite one.
const MAX_STEP: f64 = 1e9;

impl Footprint {
    /// Texels for texture coordinates `st` of a material and their derivatives by pixels.
    ///
    /// The level of detail is log2 of the longer of both steps in texels of mip 0 (Schwartz, Ruiters, Klein
    /// 2013, equation 1, with mip 0 the finest), from 0 to the coarsest mip; linear between the mips on
    /// both sides, bilinear in each. Texture coordinates wrap or are clamped to [0, 1], and texels wrap or
    /// are clamped.
    pub fn new(pyramid: &Pyramid, st: DVec2, st_dx: DVec2, st_dy: DVec2) -> Self {
        let (width, height) = pyramid.mip_size(0);
        let size = DVec2::new(width.into(), height.into());
        let coarsest = pyramid.mip_count() - 1;
        let step = (st_dx * size).length().max((st_dy * size).length());
        // `f64::max` passes over a step that is no number, but not over both: so they are asked for as well.
        let known = step < MAX_STEP && st_dx.is_finite() && st_dy.is_finite();
        let lod = if known {
            step.max(1e-9).log2().clamp(0.0, coarsest.into())
        } else {
            coarsest.into()
        };
        let blend = lod.fract();
        let mip = lod as u8;

        let mut footprint = Self {
            texels: [Texel::default(); 8],
            count: 0,
        };
        let st = if pyramid.wrap() {
            st - st.floor()
        } else {
            st.clamp(DVec2::ZERO, DVec2::ONE)
        };
        let st = if st.is_finite() { st } else { DVec2::ZERO };
        footprint.add_bilinear(pyramid, mip, st, 1.0 - blend);
        if blend > 0.0 {
            footprint.add_bilinear(pyramid, mip + 1, st, blend);
        }
        footprint
    }

    /// The texels with a share.
    pub fn texels(&self) -> &[Texel] {
        &self.texels[..self.count]
    }

    fn add_bilinear(&mut self, pyramid: &Pyramid, mip: u8, st: DVec2, share: f64) {
        let (width, height) = pyramid.mip_size(mip);
        let columns = linear(st.x, width, pyramid.wrap());
        let rows = linear(st.y, height, pyramid.wrap());
        for (y, row_weight) in rows {
            for (x, column_weight) in columns {
                let weight = share * row_weight * column_weight;
                if weight > 0.0 {
                    self.texels[self.count] = Texel { mip, x, y, weight };
                    self.count += 1;
                }
            }
        }
    }
}

/// The two texels of a side on both sides of a coordinate in [0, 1], and their shares.
fn linear(coordinate: f64, side: u32, wrap: bool) -> [(u32, f64); 2] {
    let at = coordinate * f64::from(side) - 0.5;
    let floor = at.floor();
    let texel = |index: i64| {
        let side = i64::from(side);
        (if wrap {
            index.rem_euclid(side)
        } else {
            index.clamp(0, side - 1)
        }) as u32
    };
    let first = floor as i64;
    [(texel(first), 1.0 - (at - floor)), (texel(first + 1), at - floor)]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_middle_of_a_texel_is_that_texel() {
        let pyramid = Pyramid::new(100, 50, true).unwrap();
        let st = DVec2::new(37.5 / 100.0, 12.5 / 50.0);
        let footprint = Footprint::new(&pyramid, st, DVec2::ZERO, DVec2::ZERO);
        let main = footprint
            .texels()
            .iter()
            .max_by(|a, b| a.weight.total_cmp(&b.weight))
            .unwrap();
        assert_eq!((main.mip, main.x, main.y), (0, 37, 12));
        assert!(main.weight > 1.0 - 1e-9);
    }

    #[test]
    fn the_mip_follows_the_longer_step() {
        let pyramid = Pyramid::new(256, 128, true).unwrap();
        let shares = |dx: f64, dy: f64| {
            let footprint = Footprint::new(
                &pyramid,
                DVec2::splat(0.3),
                DVec2::X * dx / 256.0,
                DVec2::Y * dy / 128.0,
            );
            let mut shares = [0.0; 9];
            footprint
                .texels()
                .iter()
                .for_each(|texel| shares[usize::from(texel.mip)] += texel.weight);
            shares
        };
        assert!((shares(4.0, 1.0)[2] - 1.0).abs() < 1e-12);
        assert!((shares(1.0, 4.0)[2] - 1.0).abs() < 1e-12);
        let between = shares(2f64.powf(1.25), 0.0);
        assert!((between[1] - 0.75).abs() < 1e-12 && (between[2] - 0.25).abs() < 1e-12);
        assert!((shares(0.01, 0.0)[0] - 1.0).abs() < 1e-12);
        for odd in [1e5, f64::INFINITY, f64::NAN] {
            assert!((shares(odd, 0.0)[8] - 1.0).abs() < 1e-12, "{odd}");
        }
    }

    #[test]
    fn edges_wrap_or_are_clamped() {
        for (wrap, beside) in [(true, 63), (false, 0)] {
            let pyramid = Pyramid::new(64, 64, wrap).unwrap();
            let footprint = Footprint::new(&pyramid, DVec2::new(0.25 / 64.0, 0.5), DVec2::ZERO, DVec2::ZERO);
            let share: f64 = footprint
                .texels()
                .iter()
                .filter(|texel| texel.x == beside)
                .map(|texel| texel.weight)
                .sum();
            assert!((share - if wrap { 0.25 } else { 1.0 }).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn shares_add_up_and_texels_exist(
            size in (1u32..300, 1u32..300), wrap: bool,
            st in (-5.0..5.0f64, -5.0..5.0f64),
            step in (-1.0..1.0f64, 0.0..1.0f64),
        ) {
            let pyramid = Pyramid::new(size.0, size.1, wrap).unwrap();
            let steps = (DVec2::new(step.0, step.1), DVec2::new(step.1, step.0) * step.1);
            let footprint = Footprint::new(&pyramid, st.into(), steps.0, steps.1);
            let sum: f64 = footprint.texels().iter().map(|texel| texel.weight).sum();
            prop_assert!((sum - 1.0).abs() < 1e-12);
            for texel in footprint.texels() {
                let (width, height) = pyramid.mip_size(texel.mip);
                prop_assert!(texel.mip < pyramid.mip_count() && texel.x < width && texel.y < height);
            }
        }
    }
}
