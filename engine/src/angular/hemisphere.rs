//! The hemisphere of lights as a square map that texture units interpolate.
//!
//! Source: Schwartz, Ruiters, Weinmann, Klein: WebGL-based Streaming and Presentation Framework for Bidirectional Texture
//! Functions, 2011, section 3: for each view a full hemisphere of lights in parabolic coordinates, so that the hardware
//! interpolates between lights, and the shader between views only.
//!
//! The paper resamples every BTF to maps of 32 × 32 texels before it is compressed. Here archives keep what was
//! sampled: a decoded column is resampled when it enters the cache, to maps as large as the number of lights asks for.
//!
//! A texel holds what the triangulation interpolates at its centre; where that lies outside the hull of the samples,
//! the value of the hull's closest point, as everywhere else. Maps never include the light's cosine: outside the hull
//! samples that do are to be scaled by cosθ / cosθ_hull, so that reflectance without the cosine is constant there.

use half::{f16, slice::HalfFloatSliceExt};

use super::{Triangulation, cosine_from_parabolic};

/// Texels of a row of maps, and largest side of one: maps of one column fill whole rows. Wide enough for the largest map,
/// and so narrow that the last row of maps, which is rarely full, costs little.
pub const ROW_TEXELS: u32 = 256;
/// Smallest side: from here on no light's four texels touch the corners of the map, where the ambient light lies.
const MIN_SIDE: u32 = 8;
/// Texels along the mean distance between lights that are spread evenly over the disc.
const TEXELS_A_LIGHT: f64 = 2.0;
/// How far inside the outermost texels' centres the horizon lies, in texels: neither rounding nor weights of eight bits
/// reach the next map. `MAP_INSET` in `hemisphere.wgsl`.
const INSET: f64 = 1.0 / 64.0;
/// Largest half float.
const LARGEST: f32 = 65504.0;

/// From samples by light to maps of the light hemisphere.
#[derive(Clone, Debug)]
pub struct Hemisphere {
    side: u32,
    lights: usize,
    /// For each texel, row by row from y = −1, the samples that it mixes; with the cosine taken out of them.
    texels: Vec<([u32; 3], [f32; 3])>,
}

/// Side of the maps for so many lights, in texels: `TEXELS_A_LIGHT` for each of them along an axis of the disc, and as
/// many more as there is room for in a row of maps.
pub fn map_side(lights: usize) -> u32 {
    let distance = (std::f64::consts::PI / lights.max(1) as f64).sqrt();
    let wanted = (1.0 + TEXELS_A_LIGHT * 2.0 / distance).ceil();
    let wanted = (wanted as u32).clamp(MIN_SIDE, ROW_TEXELS);
    ROW_TEXELS / (ROW_TEXELS / wanted)
}

/// Texels of the maps of a column: whole rows of [`ROW_TEXELS`].
pub fn map_texels(views: usize, side: u32) -> u64 {
    let rows = (views as u64).div_ceil((ROW_TEXELS / side).into()) * 3 * u64::from(side);
    rows * u64::from(ROW_TEXELS)
}

/// Where a point in parabolic coordinates lies in a map along one axis, in texels from its edge.
fn texel_from_parabolic(side: u32, at: f64) -> f64 {
    f64::from(side) / 2.0 + at * radius(side)
}

/// Texels from the centre of a map to the horizon.
fn radius(side: u32) -> f64 {
    (f64::from(side) - 1.0) / 2.0 - INSET
}

impl Hemisphere {
    /// Maps of a [side](map_side) that suits the lights. `cosine` says whether samples include the light's cosine.
    pub fn new(lights: &Triangulation, cosine: bool) -> Self {
        Self::with_side(lights, cosine, map_side(lights.points.len()))
    }

    /// Maps of any side of at least two texels.
    pub fn with_side(lights: &Triangulation, cosine: bool, side: u32) -> Self {
        let side = side.clamp(2, ROW_TEXELS);
        let centre = |at: u32| (f64::from(at) + 0.5 - f64::from(side) / 2.0) / radius(side);
        // Samples that include the cosine tell nothing so close to the horizon, and dividing by less would make that
        // nothing large: reflectance falls to zero there within a texel.
        let least = cosine_from_parabolic([1.0 - 1.0 / radius(side), 0.0]).max(0.0);
        let texel = |at: u32| {
            let taps = lights.taps_at([centre(at % side), centre(at / side)]);
            let scale = if cosine { 1.0 / taps.cosine.max(least) } else { 1.0 };
            (taps.indices, taps.weights.map(|weight| (weight * scale) as f32))
        };
        Self {
            side,
            lights: lights.points.len(),
            texels: (0..side * side).map(texel).collect(),
        }
    }

    /// Texels along an edge of a map.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// What shaders read for a light, to measure against the triangulation: the texels around a point in parabolic
    /// coordinates, bilinear, of samples by light. Without the cosine.
    pub fn interpolate(&self, point: [f64; 2], samples: &[f64]) -> f64 {
        let [(x, across), (y, down)] = point.map(|at| {
            let at = (texel_from_parabolic(self.side, at) - 0.5).clamp(0.0, f64::from(self.side - 1));
            let first = (at as u32).min(self.side - 2);
            (first, at - f64::from(first))
        });
        let texel = |x: u32, y: u32| {
            let (indices, weights) = self.texels[(y * self.side + x) as usize];
            let taps = indices.into_iter().zip(weights);
            taps.map(|(light, weight)| samples[light as usize] * f64::from(weight))
                .sum::<f64>()
        };
        let row = |y| texel(x, y) * (1.0 - across) + texel(x + 1, y) * across;
        row(y) * (1.0 - down) + row(y + 1) * down
    }

    /// The maps of a column `[view][light, then ambient][rgb]` of four components each, as the column cache holds them:
    /// rows of [`ROW_TEXELS`] texels; in these, view by view, the maps of red, green and blue below each other. The ambient
    /// light lies in the first texel of each map, which no light reaches.
    pub fn maps(&self, column: &[[f16; 4]]) -> Vec<[f16; 4]> {
        let side = self.side as usize;
        let across = (ROW_TEXELS / self.side) as usize;
        let view_quads = (self.lights + 1) * 3;
        let views = column.len() / view_quads;
        let mut maps = vec![[f16::ZERO; 4]; map_texels(views, self.side) as usize];
        let mut samples = vec![[0f32; 4]; view_quads];
        let mut line = vec![[0f32; 4]; side];
        for (view, quads) in column.chunks_exact(view_quads).enumerate() {
            let halves: &[f16] = bytemuck::cast_slice(quads);
            halves.convert_to_f32_slice(bytemuck::cast_slice_mut(&mut samples));
            let left = view % across * side;
            for rgb in 0..3 {
                let top = (view / across * 3 + rgb) * side;
                for (y, texels) in self.texels.chunks_exact(side).enumerate() {
                    for (texel, (indices, weights)) in line.iter_mut().zip(texels) {
                        let [a, b, c] = indices.map(|light| samples[light as usize * 3 + rgb]);
                        // Dividing by a small cosine can leave what half floats hold.
                        *texel = std::array::from_fn(|i| {
                            (a[i] * weights[0] + b[i] * weights[1] + c[i] * weights[2])
                                .clamp(-LARGEST, LARGEST)
                        });
                    }
                    if y == 0 {
                        line[0] = samples[self.lights * 3 + rgb];
                    }
                    let start = (top + y) * ROW_TEXELS as usize + left;
                    let halves: &mut [f16] = bytemuck::cast_slice_mut(&mut maps[start..start + side]);
                    halves.convert_from_f32_slice(bytemuck::cast_slice(&line));
                }
            }
        }
        maps
    }
}
