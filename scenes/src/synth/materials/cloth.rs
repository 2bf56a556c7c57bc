//! Woven cloth of spun yarns, whose fibres wind around them, with stray fibres on top: a tartan in 2/2 twill, a striped
//! plain weave, denim, and a check.

use super::{Material, bump};
use crate::synth::noise::{Noise, smoothstep};
use crate::synth::random::{Random, mix, unit};
use crate::synth::reflectance::Attributes;
use crate::synth::strands::{Strands, stray_fibre};
use crate::synth::volume::{Row, Solid};
use glam::{Vec2, Vec3, vec2, vec3};
use std::f32::consts::TAU;
use std::ops::Range;

/// Yarns along a side of the patch, for warp and for weft; a multiple of four closes the twill.
const YARNS: usize = 20;
const PITCH: f32 = 1.0 / YARNS as f32;
/// Half width and half thickness of a yarn, and how far it swings up and down.
const WIDTH: f32 = 0.53 * PITCH;
const THICKNESS: f32 = 0.30 * PITCH;
const SWING: f32 = 0.27 * PITCH;
/// Turns of the fibres over the patch, and fibres around a yarn.
const TWIST: f32 = 4.0;
const FIBRES: f32 = 15.0;
const STRAY_FIBRES: usize = 420;
const FLOOR: u16 = 0;
/// Parts: floor, warp yarns, weft yarns, segments of stray fibres.
const FIRST_STRAY: u16 = 1 + 2 * YARNS as u16;

/// A dyed colour of the tartan, linear RGB.
const NAVY: Vec3 = vec3(0.020, 0.040, 0.105);
const GREEN: Vec3 = vec3(0.022, 0.085, 0.055);
const CREAM: Vec3 = vec3(0.62, 0.54, 0.40);
const RUST: Vec3 = vec3(0.42, 0.075, 0.030);
/// The sett: the same for warp and weft.
const SETT: [Vec3; YARNS] = [
    NAVY, NAVY, NAVY, NAVY, NAVY, NAVY, CREAM, CREAM, GREEN, GREEN, GREEN, GREEN, GREEN, GREEN, RUST, RUST,
    RUST, RUST, CREAM, NAVY,
];

/// Whether the warp lies above at a crossing: 2/2 twill, plain weave, 1/3 twill (denim), 2/2 twill. All repeat
/// after four yarns.
fn warp_above(pattern: u32, warp: i32, weft: i32) -> bool {
    let step = (warp - weft).rem_euclid(4);
    match pattern {
        1 => step % 2 == 0,
        2 => step == 3,
        _ => step < 2,
    }
}

/// Colour of a yarn: tartan, stripes, indigo warp with pale weft, small check.
fn yarn_colour(pattern: u32, warp: bool, index: usize) -> Vec3 {
    match pattern {
        1 if warp && index % 10 < 4 => RUST,
        1 if warp && index % 10 == 7 => NAVY,
        1 => CREAM,
        2 if warp => NAVY * 1.6,
        2 => CREAM,
        3 if index % 4 < 2 => GREEN * 0.7,
        3 => CREAM,
        _ => SETT[index],
    }
}

/// Woven cloth.
pub(super) struct Cloth {
    pattern: u32,
    path: Noise,
    fibre: Noise,
    dye: Noise,
    strays: Strands,
}

/// A yarn's centre line and thickness at one place along it.
#[derive(Clone, Copy)]
struct Station {
    /// Across the yarns.
    center: f32,
    height: f32,
    /// Slope of the centre line.
    slope: f32,
    /// Half width and half thickness.
    half: Vec2,
}

impl Cloth {
    pub(super) fn new(seed: u64, voxel: f32, pattern: u32) -> Cloth {
        let random = &mut Random::new(seed, "cloth");
        let (path, fibre, dye) = (Noise::new(random), Noise::new(random), Noise::new(random));
        let radius = (0.03 * PITCH).max(0.75 * voxel);
        let mut strays = Strands::default();
        for n in 0..STRAY_FIBRES {
            let p = vec3(
                random.unit(),
                random.unit(),
                SWING + random.range(0.3, 0.9) * THICKNESS,
            );
            let (sin, cos) = (random.unit() * TAU).sin_cos();
            let direction = vec3(cos, sin, random.range(0.0, 0.5)).normalize();
            let length = random.range(0.6, 1.8) * PITCH;
            strays.add(n as u32, radius, stray_fibre(random, p, direction, length));
        }
        strays.finish();
        Cloth {
            pattern,
            path,
            fibre,
            dye,
            strays,
        }
    }

    /// Yarn `index` of the warp, or of the weft, at a place along it.
    fn station(&self, warp: bool, index: usize, along: f32) -> Station {
        let source = self.path.derive(2 * index as u32 + u32::from(warp));
        let wander = 0.06 * PITCH * source.plane(vec2(along * 10.0, 0.3), [10, 1]);
        let slub = 1.0 + 0.14 * source.plane(vec2(along * 14.0, 0.7), [14, 1]);
        let over = |crossing: i32| {
            if warp_above(self.pattern, index as i32, crossing) {
                SWING
            } else {
                -SWING
            }
        };
        let s = along / PITCH - 0.5;
        let (low, t) = (s.floor() as i32, s - s.floor());
        let (a, b) = if warp {
            (over(low), over(low + 1))
        } else {
            self.weft_swing(index, low)
        };
        Station {
            center: (index as f32 + 0.5) * PITCH + wander,
            height: a + (b - a) * t * t * (3.0 - 2.0 * t),
            slope: (b - a) * 6.0 * t * (1.0 - t) / PITCH,
            half: vec2(WIDTH, THICKNESS) * slub,
        }
    }

    /// Where the warp is up, the weft is down.
    fn weft_swing(&self, weft: usize, crossing: i32) -> (f32, f32) {
        let under = |warp: i32| {
            if warp_above(self.pattern, warp, weft as i32) {
                -SWING
            } else {
                SWING
            }
        };
        (under(crossing), under(crossing + 1))
    }

    fn yarn_attributes(&self, p: Vec3, normal: Vec3, warp: bool, index: usize) -> Attributes {
        let (across, along) = if warp { (p.x, p.y) } else { (p.y, p.x) };
        let station = self.station(warp, index, along);
        let source = self.fibre.derive(2 * index as u32 + u32::from(warp));
        // Fibres run along helices: noise on the unrolled yarn, sheared by the twist.
        let relief = |q: Vec3| {
            let (across, along) = if warp { (q.x, q.y) } else { (q.y, q.x) };
            let side = across - station.center;
            let cross = vec2(side - side.round(), q.z - station.height) / station.half;
            let turn = cross.x.atan2(cross.y) / TAU + along * TWIST;
            source.plane(vec2(turn * FIBRES, along * 36.0), [FIBRES as i32, 36])
                + 0.5
                    * source
                        .derive(9)
                        .plane(vec2(turn * 2.0 * FIBRES, along * 60.0), [2 * FIBRES as i32, 60])
        };
        let fibre = relief(p);
        let side = across - station.center;
        let below = 1.0 - (p.z - station.height) / station.half.y;
        let dye = self
            .dye
            .derive(1 + u32::from(warp))
            .plane(vec2(along * 9.0, index as f32 + 0.5), [9, 64]);
        let yarn = unit(mix(source.bits(1, 2, 3)));
        let heather = smoothstep(
            0.25,
            0.6,
            source.derive(3).plane(
                vec2((side / PITCH + along * TWIST) * FIBRES, along * 30.0),
                [1 << 20, 30],
            ),
        );
        let mut color =
            yarn_colour(self.pattern, warp, index) * (0.82 + 0.36 * yarn) * (1.0 + 0.18 * dye + 0.34 * fibre);
        color = color.lerp(vec3(0.34, 0.31, 0.27), 0.22 * heather);
        color *= 1.0 - 0.3 * smoothstep(0.3, 1.2, below);
        let direction = if warp {
            vec3(0.0, 1.0, station.slope)
        } else {
            vec3(1.0, 0.0, station.slope)
        };
        let direction = direction.normalize();
        let twist = normal.cross(direction) * (TWIST * TAU * 0.5 * (WIDTH + THICKNESS));
        Attributes {
            normal: bump(p, normal, 0.05 * PITCH, |q| 0.045 * PITCH * relief(q)),
            tangent: direction - twist,
            diffuse: color.max(Vec3::splat(0.004)),
            specular: Vec3::splat(0.04),
            roughness: [0.7, 0.38],
        }
    }
}

impl Solid for Cloth {
    fn extent(&self) -> Range<f32> {
        -SWING - 1.4 * THICKNESS..SWING + 1.2 * THICKNESS + 0.4 * PITCH
    }

    fn fill(&self, row: &mut Row<'_>) {
        let (y, voxel) = (row.y, row.voxel());
        let heights = -SWING - 1.3 * THICKNESS..SWING + 1.3 * THICKNESS;
        let reach = 1.4 * WIDTH;
        row.add_below(|_| (-SWING - THICKNESS, FLOOR));
        let distance = |side: f32, z: f32, at: &Station| {
            (vec2(side, z - at.height) / at.half).length() * THICKNESS - THICKNESS
        };
        for warp in 0..YARNS {
            let at = self.station(true, warp, y);
            row.add(
                at.center - reach..at.center + reach,
                heights.clone(),
                1 + warp as u16,
                |x| move |z| distance(x - at.center, z, &at),
            );
        }
        for weft in 0..YARNS {
            if row.offset((weft as f32 + 0.5) * PITCH).abs() < reach {
                let side = |at: &Station| y - at.center - (y - at.center).round();
                row.add(
                    0.5 * voxel..1.0 - 0.5 * voxel,
                    heights.clone(),
                    (1 + YARNS + weft) as u16,
                    |x| {
                        let at = self.station(false, weft, x);
                        move |z| distance(side(&at), z, &at)
                    },
                );
            }
        }
        self.strays.fill(row, FIRST_STRAY);
    }
}

impl Material for Cloth {
    fn attributes(&self, p: Vec3, normal: Vec3, part: u16) -> Attributes {
        match usize::from(part) {
            0 => Attributes {
                normal,
                tangent: Vec3::X,
                diffuse: Vec3::splat(0.01),
                specular: Vec3::splat(0.02),
                roughness: [0.9; 2],
            },
            yarn if yarn <= 2 * YARNS => self.yarn_attributes(p, normal, yarn <= YARNS, (yarn - 1) % YARNS),
            stray => {
                let segment = (stray - usize::from(FIRST_STRAY)) as u16;
                let strand = self.strays.segments[usize::from(segment)].strand;
                let color = yarn_colour(self.pattern, true, strand as usize % YARNS)
                    .lerp(vec3(0.45, 0.41, 0.35), 0.5);
                Attributes {
                    normal,
                    tangent: self.strays.locate(segment, p).tangent,
                    diffuse: color,
                    specular: Vec3::splat(0.05),
                    roughness: [0.6, 0.3],
                }
            }
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
