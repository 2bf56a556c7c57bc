//! Gravel: stones of several rocks and many sizes, dropped one after another, large ones first, each where it comes to
//! lie lowest.

use super::{Material, bump};
use crate::synth::noise::{Noise, smoothstep};
use crate::synth::random::{Random, mix, unit};
use crate::synth::reflectance::Attributes;
use crate::synth::volume::{Row, Solid};
use glam::{Mat3, Vec3, vec3};
use std::ops::Range;

/// Number of stones and range of their mean radii, in the order in which they fall: of all sizes, pebbles, slabs, and
/// grit.
const FALLS: [[(usize, f32, f32); 4]; 4] = [
    [
        (26, 0.045, 0.062),
        (110, 0.024, 0.042),
        (330, 0.012, 0.022),
        (700, 0.005, 0.011),
    ],
    [
        (0, 0.0, 0.0),
        (420, 0.024, 0.031),
        (160, 0.012, 0.016),
        (300, 0.005, 0.009),
    ],
    [
        (60, 0.052, 0.07),
        (30, 0.03, 0.042),
        (260, 0.01, 0.016),
        (900, 0.004, 0.008),
    ],
    [
        (0, 0.0, 0.0),
        (14, 0.02, 0.03),
        (900, 0.013, 0.019),
        (1500, 0.006, 0.011),
    ],
];
/// Shares of granite, basalt, sandstone, jasper, quartz; the rest is slate.
const ROCKS: [[f32; 5]; 4] = [
    [0.30, 0.16, 0.20, 0.10, 0.10],
    [0.15, 0.0, 0.15, 0.0, 0.70],
    [0.05, 0.35, 0.0, 0.0, 0.05],
    [0.05, 0.0, 0.55, 0.40, 0.0],
];
/// Nothing lies higher than this.
const HIGHEST: f32 = 0.15;
/// Places that each stone tries.
const TRIALS: usize = 14;
/// Side of the grid of heights on which stones come to lie.
const GROUND: usize = 128;
/// Planes that break each stone.
const FACETS: usize = 7;
const SAND: u16 = 0;

/// A layer of stones.
pub(super) struct Gravel {
    stones: Vec<Stone>,
    sand: Noise,
    rock: Noise,
}

struct Stone {
    center: Vec3,
    /// The stone's own axes over its radii: a point p of the ellipsoid has |shape · (p − center)| = 1.
    shape: Mat3,
    smallest: f32,
    largest: f32,
    /// Unit normals and distances of broken faces in the stone's own space.
    facets: [(Vec3, f32); FACETS],
    rock: Rock,
    id: u32,
}

#[derive(Clone, Copy, PartialEq)]
enum Rock {
    Granite,
    Basalt,
    Sandstone,
    Jasper,
    Quartz,
    Slate,
}

impl Gravel {
    pub(super) fn new(seed: u64, pattern: u32) -> Gravel {
        let random = &mut Random::new(seed, "gravel");
        let (sand, rock) = (Noise::new(random), Noise::new(random));
        let mut ground = vec![0.0f32; GROUND * GROUND];
        let mut stones = Vec::new();
        let pattern = pattern as usize % FALLS.len();
        for (count, smallest, largest) in FALLS[pattern] {
            for _ in 0..count {
                let mut stone = Stone::new(random, smallest, largest, &ROCKS[pattern]);
                let lowest = (0..TRIALS)
                    .map(|_| vec3(random.unit(), random.unit(), 0.0))
                    .map(|place| (stone.rest(place, &ground), place))
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                let Some((height, place)) = lowest else { continue };
                stone.center = place.with_z(height);
                if height + stone.largest < HIGHEST {
                    stone.settle(&mut ground);
                    stones.push(stone);
                }
            }
        }
        Gravel { stones, sand, rock }
    }

    fn sand_height(&self, x: f32, y: f32) -> f32 {
        0.004 * self.sand.fractal(vec3(x, y, 0.0), [30, 30], 3)
    }
}

impl Stone {
    fn new(random: &mut Random, smallest: f32, largest: f32, rocks: &[f32; 5]) -> Stone {
        // Many small ones, few large ones.
        let radius = smallest + (largest - smallest) * random.unit().powi(2);
        let radii = vec3(
            random.range(0.9, 1.35),
            random.range(0.75, 1.05),
            random.range(0.5, 0.8),
        ) * radius;
        let axis = vec3(random.range(-0.5, 0.5), random.range(-0.5, 0.5), 1.0).normalize();
        let x = axis.any_orthonormal_vector();
        let (sin, cos) = (random.unit() * std::f32::consts::TAU).sin_cos();
        let x = cos * x + sin * axis.cross(x);
        let world_from_stone = Mat3::from_cols(x, axis.cross(x), axis);
        let shape = Mat3::from_diagonal(1.0 / radii) * world_from_stone.transpose();
        let facets = [(); FACETS].map(|()| {
            let normal = vec3(
                random.range(-1.0, 1.0),
                random.range(-1.0, 1.0),
                random.range(-1.0, 1.0),
            );
            (normal.normalize_or(Vec3::Z), random.range(0.62, 0.95))
        });
        const NAMED: [Rock; 5] = [
            Rock::Granite,
            Rock::Basalt,
            Rock::Sandstone,
            Rock::Jasper,
            Rock::Quartz,
        ];
        let drawn = random.unit();
        let mut upper = 0.0;
        let found = rocks.iter().position(|share| {
            upper += share;
            drawn < upper
        });
        let rock = found.map_or(Rock::Slate, |at| NAMED[at]);
        let (smallest, largest) = (radii.min_element(), radii.max_element());
        Stone {
            center: Vec3::ZERO,
            shape,
            smallest,
            largest,
            facets,
            rock,
            id: random.bits(),
        }
    }

    /// Distance to the surface, negative inside; `d` is from the centre.
    fn distance(&self, d: Vec3) -> f32 {
        let q = self.shape * d;
        let round = q.length() - 1.0;
        let mut value = round;
        for (normal, distance) in &self.facets {
            // Edges are worn round.
            let facet = normal.dot(q) - distance;
            let blend = (0.5 + (value - facet) / 0.36).clamp(0.0, 1.0);
            value = facet + (value - facet) * blend + 0.18 * blend * (1.0 - blend);
        }
        value * self.smallest
    }

    fn footprint(&self, place: Vec3) -> impl Iterator<Item = (usize, f32)> {
        let radius = 0.75 * self.largest;
        let reach = (radius * GROUND as f32).ceil() as i32;
        let (cx, cy) = ((place.x * GROUND as f32) as i32, (place.y * GROUND as f32) as i32);
        (-reach..=reach)
            .flat_map(move |j| (-reach..=reach).map(move |i| (i, j)))
            .filter_map(move |(i, j)| {
                let squared = (i * i + j * j) as f32 / (radius * GROUND as f32).max(0.5).powi(2);
                let wrap = |v: i32| v.rem_euclid(GROUND as i32) as usize;
                (squared <= 1.0).then(|| (wrap(cy + j) * GROUND + wrap(cx + i), squared))
            })
    }

    /// Height of the centre if the stone falls at `place`.
    fn rest(&self, place: Vec3, ground: &[f32]) -> f32 {
        let under =
            |(cell, squared): (usize, f32)| ground[cell] - self.smallest * (1.0 - (1.0 - squared).sqrt());
        // Stones lean into gaps, so they lie a little lower than their ellipsoids would.
        self.footprint(place).map(under).fold(-0.002, f32::max) + 0.62 * self.smallest
    }

    fn settle(&self, ground: &mut [f32]) {
        for (cell, squared) in self.footprint(self.center) {
            ground[cell] = ground[cell].max(self.center.z + 0.8 * self.smallest * (1.0 - squared).sqrt());
        }
    }
}

impl Solid for Gravel {
    fn extent(&self) -> Range<f32> {
        -0.012..HIGHEST
    }

    fn fill(&self, row: &mut Row<'_>) {
        let y = row.y;
        row.add_below(|x| (self.sand_height(x, y), SAND));
        for (n, stone) in self.stones.iter().enumerate() {
            let (dy, reach) = (row.offset(stone.center.y), stone.largest + 3.0 * row.voxel());
            if dy.abs() < reach {
                let (cx, cz) = (stone.center.x, stone.center.z);
                let part = n as u16 + 1;
                row.add(cx - reach..cx + reach, cz - reach..cz + reach, part, |x| {
                    move |z| stone.distance(vec3(x - cx, dy, z - cz))
                });
            }
        }
    }
}

impl Material for Gravel {
    fn attributes(&self, p: Vec3, normal: Vec3, part: u16) -> Attributes {
        if part == SAND {
            let grain = self.sand.derive(1).fractal(p, [110, 110], 2);
            let tone = self.sand.derive(2).fractal(p, [9, 9], 3);
            let relief = |q: Vec3| 0.003 * self.sand.derive(1).fractal(q, [110, 110], 1);
            return Attributes {
                normal: bump(p, normal, 0.002, relief),
                tangent: Vec3::X,
                diffuse: vec3(0.21, 0.155, 0.10) * (1.0 + 0.5 * grain + 0.2 * tone),
                specular: Vec3::splat(0.03),
                roughness: [0.7; 2],
            };
        }
        let stone = &self.stones[usize::from(part) - 1];
        let mut local = p - stone.center;
        local.x -= local.x.round();
        local.y -= local.y.round();
        let random = |n: u32| unit(mix(stone.id ^ mix(n)));
        let source = self.rock.derive(stone.id);
        let noise = |frequency: f32, n: u32| source.derive(n).space(local * frequency, [1 << 24, 1 << 24]);
        let layers = (stone.shape * local).z;
        let broad = noise(18.0, 0) + 0.5 * noise(40.0, 1);
        let fine = noise(110.0, 2);
        let finest = noise(230.0, 3);
        let (mut color, mut alpha) = match stone.rock {
            Rock::Granite => {
                let dark = smoothstep(0.22, 0.42, fine);
                let pale = smoothstep(0.15, 0.4, noise(85.0, 4));
                let base = vec3(0.27, 0.25, 0.235).lerp(vec3(0.34, 0.25, 0.21), random(2));
                (
                    base.lerp(vec3(0.55, 0.52, 0.48), 0.7 * pale)
                        .lerp(vec3(0.035, 0.035, 0.04), 0.85 * dark),
                    0.5,
                )
            }
            Rock::Basalt => (vec3(0.062, 0.062, 0.066) * (1.0 + 0.3 * broad + 0.5 * fine), 0.42),
            Rock::Sandstone => {
                let band = 0.5 + 0.5 * (layers * 9.0 + 1.5 * broad).sin();
                let base = vec3(0.36, 0.235, 0.13).lerp(vec3(0.47, 0.36, 0.24), band);
                (base * (1.0 + 0.25 * finest), 0.75)
            }
            Rock::Jasper => {
                let vein = 1.0 - smoothstep(0.0, 0.09, (broad + 0.2 * fine).abs());
                let base = vec3(0.235, 0.085, 0.055) * (1.0 + 0.35 * fine);
                (base.lerp(vec3(0.5, 0.42, 0.34), 0.6 * vein), 0.33)
            }
            Rock::Quartz => {
                let stain = smoothstep(0.1, 0.8, broad + 0.3 * fine);
                (
                    vec3(0.62, 0.59, 0.54).lerp(vec3(0.45, 0.31, 0.17), 0.7 * stain),
                    0.3,
                )
            }
            Rock::Slate => {
                let band = 0.5 + 0.5 * (layers * 16.0 + 2.0 * broad).sin();
                (
                    vec3(0.115, 0.135, 0.15).lerp(vec3(0.18, 0.19, 0.19), band) * (1.0 + 0.2 * fine),
                    0.45,
                )
            }
        };
        color *= 0.75 + 0.5 * random(5);
        color *= Vec3::ONE + vec3(0.16, 0.02, -0.14) * (random(6) - 0.5);
        // Dust gathers on what faces up and lies low.
        let dust = smoothstep(0.3, 1.0, normal.z) * smoothstep(0.1, 0.02, p.z + 0.02 * broad) * 0.5;
        color = color.lerp(vec3(0.25, 0.20, 0.14), dust.min(0.6));
        alpha += 0.1 * fine + 0.3 * dust;
        let relief = |q: Vec3| {
            let d = q - p + local;
            0.0022 * source.derive(7).space(d * 60.0, [1 << 24, 1 << 24])
                + 0.0011 * source.derive(8).space(d * 150.0, [1 << 24, 1 << 24])
        };
        Attributes {
            normal: bump(p, normal, 0.0015, relief),
            tangent: Vec3::X,
            diffuse: color,
            specular: Vec3::splat(0.045),
            roughness: [alpha.clamp(0.2, 1.0); 2],
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
