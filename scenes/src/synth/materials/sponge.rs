//! A sponge: a block with holes of all sizes, many of which open into each other under the surface.

use super::{Material, bump};
use crate::synth::noise::{Noise, smoothstep};
use crate::synth::random::Random;
use crate::synth::reflectance::Attributes;
use crate::synth::volume::{Row, Solid};
use glam::{Mat3, Vec3, vec3};
use std::ops::Range;

/// Number of holes and range of their radii: of all sizes, only small, only large, and of one size.
const HOLES: [[(usize, f32, f32); 4]; 4] = [
    [
        (90, 0.028, 0.052),
        (700, 0.013, 0.027),
        (3500, 0.006, 0.012),
        (3500, 0.0035, 0.0055),
    ],
    [
        (0, 0.0, 0.0),
        (260, 0.012, 0.018),
        (5200, 0.006, 0.011),
        (2600, 0.004, 0.006),
    ],
    [
        (150, 0.045, 0.07),
        (90, 0.02, 0.04),
        (500, 0.004, 0.008),
        (0, 0.0, 0.0),
    ],
    [
        (0, 0.0, 0.0),
        (1500, 0.019, 0.023),
        (0, 0.0, 0.0),
        (900, 0.004, 0.006),
    ],
];
/// Depth of the deepest hole's centre.
const DEPTH: f32 = 0.11;
const BLOCK: u16 = 0;

/// A porous block.
pub(super) struct Sponge {
    holes: Vec<Hole>,
    surface: Noise,
    color: Noise,
}

/// An ellipsoid of air.
struct Hole {
    center: Vec3,
    /// |shape · (p − center)| = 1 on the surface.
    shape: Mat3,
    smallest: f32,
    largest: f32,
}

impl Sponge {
    pub(super) fn new(seed: u64, pattern: u32) -> Sponge {
        let random = &mut Random::new(seed, "sponge");
        let (surface, color) = (Noise::new(random), Noise::new(random));
        let mut holes = Vec::new();
        for (count, smallest, largest) in HOLES[pattern as usize % HOLES.len()] {
            for _ in 0..count {
                let radius = smallest + (largest - smallest) * random.unit().powi(2);
                let mut stretch = || radius * random.range(0.72, 1.3);
                let radii = vec3(stretch(), stretch(), stretch());
                let axis = vec3(
                    random.range(-1.0, 1.0),
                    random.range(-1.0, 1.0),
                    random.range(-1.0, 1.0),
                );
                let z = axis.normalize_or(Vec3::Z);
                let x = z.any_orthonormal_vector();
                let shape = Mat3::from_diagonal(1.0 / radii) * Mat3::from_cols(x, z.cross(x), z).transpose();
                let deepest = -DEPTH + radius;
                // Half of the holes break through the surface.
                let highest = 0.35 * radius;
                let lowest = if random.unit() < 0.5 {
                    -0.8 * radius
                } else {
                    deepest
                };
                let depth = random.range(lowest, highest);
                let center = vec3(random.unit(), random.unit(), depth);
                holes.push(Hole {
                    center,
                    shape,
                    smallest: radii.min_element(),
                    largest: radii.max_element(),
                });
            }
        }
        Sponge {
            holes,
            surface,
            color,
        }
    }
}

impl Solid for Sponge {
    fn extent(&self) -> Range<f32> {
        -DEPTH - 0.012..0.03
    }

    fn fill(&self, row: &mut Row<'_>) {
        let y = row.y;
        row.add_below(|x| (0.014 * self.surface.fractal(vec3(x, y, 0.0), [5, 5], 4), BLOCK));
        for hole in &self.holes {
            let (dy, reach) = (row.offset(hole.center.y), hole.largest + 3.0 * row.voxel());
            if dy.abs() < reach {
                let (cx, cz) = (hole.center.x, hole.center.z);
                row.remove(cx - reach..cx + reach, cz - reach..cz + reach, BLOCK, |x| {
                    move |z| ((hole.shape * vec3(x - cx, dy, z - cz)).length() - 1.0) * hole.smallest
                });
            }
        }
    }
}

impl Material for Sponge {
    fn attributes(&self, p: Vec3, normal: Vec3, _part: u16) -> Attributes {
        let tone = self.color.fractal(p, [4, 4], 4);
        let mottle = self.color.derive(1).fractal(p, [40, 40], 3);
        let deep = smoothstep(0.005, -0.06, p.z);
        let color = vec3(0.70, 0.47, 0.165).lerp(vec3(0.60, 0.35, 0.10), (0.4 + 0.7 * tone).clamp(0.0, 1.0));
        let color = color.lerp(vec3(0.40, 0.17, 0.035), 0.8 * deep);
        let relief = |q: Vec3| 0.0022 * self.surface.derive(9).fractal(q, [120, 120], 2);
        Attributes {
            normal: bump(p, normal, 0.0018, relief),
            tangent: Vec3::X,
            diffuse: color * (1.0 + 0.16 * mottle),
            specular: Vec3::splat(0.03),
            roughness: [0.62 + 0.15 * mottle; 2],
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
