//! BTFs that can be read at any texel, mip and direction.

use tileset::Direction;

use super::Footprint;
use crate::angular::Taps;

/// A BTF that can be read at any texel, mip and sampled direction: uncompressed, or from decoded factors.
pub trait Reflectance: Sync {
    /// Width and height in texels.
    fn size(&self) -> (u32, u32);
    /// Whether it repeats.
    fn wrap(&self) -> bool;
    /// Whether the samples include the light's cosine.
    fn cosine(&self) -> bool;
    /// View directions.
    fn views(&self) -> &[Direction];
    /// Light directions.
    fn lights(&self) -> &[Direction];
    /// Linear RGB of a texel at a mip, for indices of view and light. x and y lie inside the mip.
    fn texel(&self, mip: u8, x: u32, y: u32, view: u32, light: u32) -> [f64; 3];

    /// Linear RGB of a footprint, interpolated between three views and three lights. Sources that can do it
    /// faster than texel by texel override it.
    fn interpolate(&self, footprint: &Footprint, views: &Taps, lights: &Taps) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (view, view_weight) in taps(views) {
            for (light, light_weight) in taps(lights) {
                add(
                    &mut sum,
                    view_weight * light_weight,
                    self.filter(footprint, view, light),
                );
            }
        }
        sum
    }

    /// The same for uniform light: `weights` has one weight for each light, the same in every call (see
    /// [`crate::angular::Triangulation::ambient_weights`]).
    fn ambient(&self, footprint: &Footprint, views: &Taps, weights: &[f64]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (view, view_weight) in taps(views) {
            for (light, &light_weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
                add(
                    &mut sum,
                    view_weight * light_weight,
                    self.filter(footprint, view, light as u32),
                );
            }
        }
        sum
    }

    /// Linear RGB of a footprint at sampled directions.
    fn filter(&self, footprint: &Footprint, view: u32, light: u32) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for texel in footprint.texels() {
            add(
                &mut sum,
                texel.weight,
                self.texel(texel.mip, texel.x, texel.y, view, light),
            );
        }
        sum
    }
}

/// Samples and weights, without those of weight zero.
pub(super) fn taps(taps: &Taps) -> impl Iterator<Item = (u32, f64)> {
    taps.indices
        .into_iter()
        .zip(taps.weights)
        .filter(|(_, weight)| *weight > 0.0)
}

pub(super) fn add(sum: &mut [f64; 3], weight: f64, rgb: [f64; 3]) {
    for (sum, value) in sum.iter_mut().zip(rgb) {
        *sum += weight * value;
    }
}
