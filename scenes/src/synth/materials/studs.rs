//! Studs: brass mushrooms whose caps overhang their stems, and small steel beads between them, on dark felt; wide
//! rivets, tall pins, or steel with brass beads instead. No height field describes them.

use super::{Material, bump};
use crate::synth::noise::{Noise, smoothstep};
use crate::synth::random::Random;
use crate::synth::reflectance::Attributes;
use crate::synth::volume::{Row, Solid};
use glam::{Vec2, Vec3, vec2, vec3};
use std::ops::Range;

/// Studs along a side of the patch; even, because every second row is moved by half a pitch.
const ROWS: usize = 4;
const FELT: u16 = 0;

/// Radius, height of the rim, height of the cap above it, and radius of the stem.
struct Shape([f32; 4]);

/// Studs and beads of each pattern, and whether the studs are of brass and the beads of steel.
const SHAPES: [(Shape, Shape, bool); 4] = [
    (
        Shape([0.096, 0.034, 0.044, 0.05]),
        Shape([0.024, 0.016, 0.021, 0.018]),
        true,
    ),
    (
        Shape([0.108, 0.012, 0.022, 0.08]),
        Shape([0.015, 0.008, 0.012, 0.011]),
        false,
    ),
    (
        Shape([0.042, 0.042, 0.038, 0.018]),
        Shape([0.034, 0.03, 0.03, 0.016]),
        true,
    ),
    (
        Shape([0.07, 0.02, 0.058, 0.04]),
        Shape([0.04, 0.014, 0.03, 0.028]),
        false,
    ),
];

/// Metal studs on felt.
pub(super) struct Studs {
    felt: Noise,
    metal: Noise,
    studs: Vec<Stud>,
}

/// A surface of revolution around an axis near z.
struct Stud {
    center: Vec2,
    radius: f32,
    /// Height of the rim, where the cap is widest.
    rim: f32,
    /// Height of the cap above its rim.
    dome: f32,
    stem: f32,
    lean: Vec2,
    brass: bool,
}

impl Studs {
    pub(super) fn new(seed: u64, pattern: u32) -> Studs {
        let (Shape(stud), Shape(bead), brass) = &SHAPES[pattern as usize % SHAPES.len()];
        let random = &mut Random::new(seed, "studs");
        let (felt, metal) = (Noise::new(random), Noise::new(random));
        let pitch = 1.0 / ROWS as f32;
        let mut studs = Vec::new();
        for n in 0..ROWS * ROWS {
            let (i, j) = (n % ROWS, n / ROWS);
            let shift = 0.5 * (j % 2) as f32;
            let mut scatter =
                |amount: f32| vec2(random.range(-amount, amount), random.range(-amount, amount));
            let place = vec2(i as f32 + 0.5 + shift, j as f32 + 0.5) * pitch;
            studs.push(Stud {
                center: place + scatter(0.004),
                radius: stud[0],
                rim: stud[1],
                dome: stud[2],
                stem: stud[3],
                lean: scatter(0.05),
                brass: *brass,
            });
            studs.push(Stud {
                center: place + vec2(0.5 * pitch, 0.0) + scatter(0.004),
                radius: bead[0],
                rim: bead[1],
                dome: bead[2],
                stem: bead[3],
                lean: scatter(0.08),
                brass: !*brass,
            });
        }
        Studs { felt, metal, studs }
    }

    fn felt_height(&self, p: Vec3) -> f32 {
        0.006 * self.felt.fractal(p, [12, 12], 3) + 0.004 * self.felt.derive(7).fractal(p, [60, 60], 2)
    }
}

impl Stud {
    /// Negative inside.
    fn distance(&self, d: Vec2, z: f32) -> f32 {
        let d = d - self.lean * (z - self.rim);
        let across = d.length();
        let up = z - self.rim;
        // The cap: the upper half of an ellipsoid, the lower half much flatter, so that its rim is round.
        let height = if up > 0.0 { self.dome } else { 0.16 * self.radius };
        let cap = ((across / self.radius).powi(2) + (up / height).powi(2)).sqrt() - 1.0;
        let cap = cap * height.min(self.radius);
        if up > 0.0 {
            cap
        } else {
            cap.min((across - self.stem).max(up))
        }
    }
}

impl Solid for Studs {
    fn extent(&self) -> Range<f32> {
        -0.015..0.09
    }

    fn fill(&self, row: &mut Row<'_>) {
        let y = row.y;
        row.add_below(|x| (self.felt_height(vec3(x, y, 0.0)), FELT));
        for (n, stud) in self.studs.iter().enumerate() {
            let (dy, reach) = (row.offset(stud.center.y), 1.15 * stud.radius);
            if dy.abs() < reach {
                let (cx, top) = (stud.center.x, stud.rim + stud.dome + 0.01);
                let part = n as u16 + 1;
                row.add(cx - reach..cx + reach, -0.015..top, part, |x| {
                    move |z| stud.distance(vec2(x - cx, dy), z)
                });
            }
        }
    }
}

impl Material for Studs {
    fn attributes(&self, p: Vec3, normal: Vec3, part: u16) -> Attributes {
        if part == FELT {
            let fibres = |q: Vec3| 0.0035 * self.felt.derive(1).fractal(q, [110, 110], 2);
            let shade = self.felt.derive(2).fractal(p, [40, 40], 3);
            let lint = smoothstep(0.55, 0.8, self.felt.derive(3).fractal(p, [70, 70], 2));
            let color = vec3(0.085, 0.010, 0.014) * (1.0 + 0.6 * shade);
            return Attributes {
                normal: bump(p, normal, 0.002, fibres),
                tangent: Vec3::X,
                diffuse: color.lerp(vec3(0.3, 0.16, 0.15), 0.6 * lint),
                specular: Vec3::splat(0.02),
                roughness: [0.85; 2],
            };
        }
        let stud = &self.studs[usize::from(part - 1)];
        let source = self.metal.derive(u32::from(part));
        let center = stud.center;
        let d = p.truncate() - center;
        let d = vec3(d.x - d.x.round(), d.y - d.y.round(), p.z);
        // Turned on a lathe: fine rings around the axis, then dents and dirt.
        let ring = |q: Vec3| (q.truncate() - center - (q.truncate() - center).round()).length();
        let relief = |q: Vec3| {
            0.00016 * source.space(vec3(ring(q) * 900.0, 0.5, 0.5), [4096, 4096])
                + 0.0012 * source.derive(1).fractal(q, [20, 20], 2)
        };
        let tarnish = smoothstep(
            0.05,
            0.75,
            source.derive(2).fractal(p, [14, 14], 4) + 0.25 * (1.0 - normal.z),
        );
        let dirt = smoothstep(stud.rim + 0.012, stud.rim - 0.004, p.z);
        let bright = if stud.brass {
            vec3(0.94, 0.66, 0.30)
        } else {
            vec3(0.63, 0.61, 0.58)
        };
        let dull = if stud.brass {
            vec3(0.40, 0.21, 0.075)
        } else {
            vec3(0.30, 0.27, 0.24)
        };
        let alpha = 0.085 + 0.16 * tarnish + 0.25 * dirt;
        Attributes {
            normal: bump(p, normal, 0.0012, relief),
            tangent: vec3(-d.y, d.x, 0.0),
            diffuse: vec3(0.05, 0.035, 0.02) * (tarnish + dirt),
            specular: bright.lerp(dull, (0.7 * tarnish + 0.5 * dirt).min(1.0)),
            roughness: [alpha, 1.5 * alpha],
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
