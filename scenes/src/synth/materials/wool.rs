//! Knitted wool: rows of loops that hang in each other (stockinette), of three-ply yarn with stray fibres; marled, striped,
//! undyed, and in two colours.
//!
//! The centre line of a row of loops is Leaf's curve: x runs ahead and back like sin 2t, y swings like cos t, and z like
//! cos 2t, so that legs lie in front and heads behind (Leaf, Glaskin, The geometry of a plain knitted loop, 1955).

use super::{Material, bump};
use crate::synth::noise::{Noise, smoothstep};
use crate::synth::random::{Random, mix, unit};
use crate::synth::reflectance::Attributes;
use crate::synth::strands::{Strands, stray_fibre};
use crate::synth::volume::{Row, Solid};
use glam::{Vec3, vec2, vec3};
use std::f32::consts::TAU;
use std::ops::Range;

/// Loops along x, and rows of loops along y.
const LOOPS: usize = 8;
const ROWS: usize = 10;
const WIDTH: f32 = 1.0 / LOOPS as f32;
const HEIGHT: f32 = 1.0 / ROWS as f32;
/// How far a loop leans out sideways, reaches up and down, and swings in depth.
const LEAN: f32 = 0.15 * WIDTH;
const REACH: f32 = 0.84 * HEIGHT;
const DEPTH: f32 = 0.15 * WIDTH;
/// Radius of the yarn, of a ply, and of the circle on which the plies' centres lie.
const YARN: f32 = 0.215 * WIDTH;
const PLY: f32 = 0.62 * YARN;
const PLY_CIRCLE: f32 = 0.42 * YARN;
const PLIES: usize = 3;
/// Turns of the plies over one loop.
const TURNS: usize = 2;
/// Straight pieces per loop.
const PIECES: usize = 40;
const STRAY_FIBRES: usize = 480;
const FLOOR: u16 = 0;
const LOWEST: f32 = -0.055;

const PETROL: Vec3 = vec3(0.055, 0.20, 0.215);
const NATURAL: Vec3 = vec3(0.50, 0.43, 0.32);

/// Colour of the yarn at a place of a row: marled petrol, broad stripes, undyed, lozenges.
fn yarn_colour(pattern: u32, row: usize, x: f32) -> Vec3 {
    let column = (x * LOOPS as f32) as usize % LOOPS;
    match pattern {
        1 if row % 5 < 2 => NATURAL,
        2 => NATURAL,
        3 if (row + column).is_multiple_of(4) || (row + LOOPS * 3 - column).is_multiple_of(4) => NATURAL,
        _ => PETROL,
    }
}

/// Knitted wool.
pub(super) struct Wool {
    pattern: u32,
    strands: Strands,
    plies: usize,
    fibre: Noise,
    dye: Noise,
}

impl Wool {
    pub(super) fn new(seed: u64, voxel: f32, pattern: u32) -> Wool {
        let random = &mut Random::new(seed, "wool");
        let (fibre, dye, path) = (Noise::new(random), Noise::new(random), Noise::new(random));
        let mut strands = Strands::default();
        for row in 0..ROWS {
            for ply in 0..PLIES {
                let points =
                    (0..=LOOPS * PIECES).map(|n| ply_center(&path, row, ply, n as f32 / PIECES as f32));
                strands.add((row * PLIES + ply) as u32, PLY, points);
            }
        }
        let plies = strands.segments.len();
        for n in 0..STRAY_FIBRES {
            let row = (random.unit() * ROWS as f32) as usize % ROWS;
            let t = random.unit() * LOOPS as f32;
            let (sin, cos) = (random.range(-1.3, 1.3)).sin_cos();
            let at = center(&path, row, t);
            let along = (center(&path, row, t + 0.02) - at).normalize();
            let side = along.cross(Vec3::Z).normalize_or(Vec3::X);
            let out = side * sin + Vec3::Z * cos;
            let direction =
                (along * random.range(-1.0, 1.0) + side * random.range(-0.7, 0.7) + 0.35 * out).normalize();
            let radius = (0.014 * WIDTH).max(0.72 * voxel);
            let length = random.range(0.25, 0.6) * WIDTH;
            strands.add(
                (ROWS * PLIES + n) as u32,
                radius,
                stray_fibre(random, at + out * (0.97 * YARN), direction, length),
            );
        }
        strands.finish();
        Wool {
            pattern,
            strands,
            plies,
            fibre,
            dye,
        }
    }
}

/// Centre line of a row at `t` loops.
fn center(path: &Noise, row: usize, t: f32) -> Vec3 {
    let phase = t * TAU;
    let uneven = |n: u32, amount: f32| {
        amount
            * path
                .derive(n)
                .plane(vec2(t * 2.0, row as f32 + 0.5), [2 * LOOPS as i32, 64])
    };
    vec3(
        (t + 0.25) * WIDTH + LEAN * (2.0 * phase).sin() + uneven(1, 0.06 * WIDTH),
        (row as f32 + 0.5) * HEIGHT
            + REACH * (1.0 + uneven(2, 0.10)) * phase.cos()
            + uneven(3, 0.06 * HEIGHT),
        -DEPTH * (2.0 * phase).cos() + uneven(4, 0.02 * WIDTH),
    )
}

fn ply_center(path: &Noise, row: usize, ply: usize, t: f32) -> Vec3 {
    let at = center(path, row, t);
    let along = (center(path, row, t + 0.01) - center(path, row, t - 0.01)).normalize_or(Vec3::X);
    let side = along.cross(Vec3::Z).normalize_or(Vec3::X);
    let up = side.cross(along);
    let angle = TAU * (t * TURNS as f32 + ply as f32 / PLIES as f32 + 0.1 * row as f32);
    at + PLY_CIRCLE * (angle.cos() * side + angle.sin() * up)
}

impl Solid for Wool {
    fn extent(&self) -> Range<f32> {
        LOWEST..DEPTH + YARN * 1.1 + 0.02
    }

    fn fill(&self, row: &mut Row<'_>) {
        row.add_below(|_| (LOWEST + 0.004, FLOOR));
        self.strands.fill(row, 1);
    }
}

impl Material for Wool {
    fn attributes(&self, p: Vec3, normal: Vec3, part: u16) -> Attributes {
        if part == FLOOR {
            return Attributes {
                normal,
                tangent: Vec3::X,
                diffuse: vec3(0.008, 0.022, 0.024),
                specular: Vec3::splat(0.02),
                roughness: [0.9; 2],
            };
        }
        let segment = part - 1;
        let strand = self.strands.segments[usize::from(segment)].strand;
        let at = self.strands.locate(segment, p);
        let source = self.fibre.derive(strand);
        if usize::from(segment) >= self.plies {
            return Attributes {
                normal,
                tangent: at.tangent,
                diffuse: PETROL.lerp(vec3(0.45, 0.42, 0.34), 0.6 * unit(mix(strand))),
                specular: Vec3::splat(0.05),
                roughness: [0.6, 0.35],
            };
        }
        // Fibres lie against the twist of the plies.
        let twist = -7.0 * LOOPS as f32 / 8.0;
        let relief = |q: Vec3| {
            let on = self.strands.locate(segment, q);
            on.fibres(source, twist, 13.0, 0.16 * WIDTH)
                + 0.6 * on.fibres(source.derive(1), twist, 26.0, 0.1 * WIDTH)
        };
        let fibre = relief(p);
        let fleck = smoothstep(0.34, 0.55, at.fibres(source.derive(2), twist, 11.0, 0.3 * WIDTH));
        let tone = self.dye.fractal(p, [4, 4], 3);
        let dyed = yarn_colour(self.pattern, strand as usize / PLIES, p.x);
        let shade = if self.pattern == 0 && (strand as usize).is_multiple_of(PLIES) {
            vec3(0.12, 0.30, 0.29)
        } else {
            dyed
        };
        let fleck_color = if unit(source.bits(5, 5, 5)) < 0.5 {
            vec3(0.55, 0.50, 0.40)
        } else {
            vec3(0.42, 0.22, 0.045)
        };
        let mut color = shade * (1.0 + 0.14 * tone + 0.26 * fibre);
        let flecked = if self.pattern == 0 { 0.75 } else { 0.2 };
        color = color.lerp(fleck_color, flecked * fleck);
        Attributes {
            normal: bump(p, normal, 0.02 * WIDTH, |q| 0.016 * WIDTH * relief(q)),
            tangent: at.fibre_direction(normal, twist, PLY),
            diffuse: color.max(Vec3::splat(0.01)),
            specular: Vec3::splat(0.035),
            roughness: [0.75, 0.45],
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
