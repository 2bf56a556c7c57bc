//! The surfaces of the demo's objects.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::Mesh;
use crate::shapes::{grid, revolved, tube};

/// An upright square in the xy plane.
pub(super) fn square(side: f32) -> Mesh {
    grid(4, 4, Vec2::ONE, |s, t| {
        Vec3::new((s - 0.5) * side, (t - 0.5) * side, 0.0)
    })
}

/// Level in the middle, gently rolling further out.
pub(super) fn ground(side: f32) -> Mesh {
    grid(56, 56, Vec2::ONE, |s, t| {
        let (x, z) = ((s - 0.5) * side, (0.5 - t) * side);
        let away = ((x.hypot(z) - 1.3) / 1.5).clamp(0.0, 1.0);
        let rolling =
            (1.9 * x + 0.7 * z).sin() + (1.3 * z - 0.6 * x + 1.0).sin() + (2.7 * x - 1.1).cos() * 0.4;
        Vec3::new(x, 0.035 * away * away * (3.0 - 2.0 * away) * rolling, z)
    })
}

/// A sphere without its lowest tip.
pub(super) fn ball(centre: Vec3, radius: f32) -> Mesh {
    grid(48, 24, Vec2::new(6.0, 3.0), |s, t| {
        let (around, up) = (s * TAU, (t - 0.5) * PI * 0.995);
        centre + Vec3::new(up.cos() * around.cos(), up.sin(), -up.cos() * around.sin()) * radius
    })
}

/// A sheet over a square whose corners are drawn in: `drawn` is 0 for a square, ½ for a disc. `half` is half of each
/// side, `height` that of the middle above the rim; `up` is 1 for the upper sheet, -1 for the lower one.
fn pillow(half: Vec2, drawn: f32, height: f32, up: f32) -> impl Fn(f32, f32) -> Vec3 {
    move |s, t| {
        let (a, b) = ((s - 0.5) * PI, (t - 0.5) * PI);
        let (p, q) = (a.sin(), b.sin());
        let rise = height * a.cos() * b.cos() * (1.0 + 0.25 * p * p * q * q);
        let outline = |p: f32, q: f32| p * (1.0 - drawn * q * q).sqrt();
        Vec3::new(half.x * outline(p, q), up * rise, -up * half.y * outline(q, p))
    }
}

/// A flat, worn stone: an upper and a lower half.
pub(super) fn stone() -> [Mesh; 2] {
    let half = |height: f32, up: f32| {
        let sheet = pillow(Vec2::new(0.2, 0.15), 0.46, height, up);
        grid(32, 32, Vec2::new(1.0, 1.0), move |s, t| {
            let point = sheet(s, t);
            let dents =
                0.09 * (13.0 * point.x + 1.0).sin() + 0.08 * (15.0 * point.z - 0.4 + 9.0 * point.y).sin();
            point * (1.0 + dents) + Vec3::Y * 0.05
        })
    };
    [half(0.13, 1.0), half(0.06, -1.0)]
}

/// Half the outline of the vase: radius and height in metres, from the foot over the lip and down inside.
const VASE: [[f32; 2]; 12] = [
    [0.085, 0.0],
    [0.125, 0.05],
    [0.178, 0.16],
    [0.196, 0.27],
    [0.165, 0.39],
    [0.105, 0.49],
    [0.073, 0.57],
    [0.074, 0.64],
    [0.108, 0.695],
    [0.098, 0.692],
    [0.062, 0.63],
    [0.058, 0.5],
];

/// A surface of revolution.
pub(super) fn vase() -> Mesh {
    revolved(64, 72, Vec2::new(3.0, 3.0), &VASE)
}

/// A trefoil, lying.
pub(super) fn knot() -> Mesh {
    tube(224, 28, 0.078, Vec2::new(16.0, 2.0), |s| {
        let angle = s * TAU;
        let reach = 0.215 + 0.095 * (3.0 * angle).cos();
        let flat = Vec3::new(
            reach * (2.0 * angle).cos(),
            0.1 * (3.0 * angle).sin(),
            reach * (2.0 * angle).sin(),
        );
        // Leaning back, to be seen from the front.
        let (sin, cos) = 0.62f32.sin_cos();
        Vec3::new(
            flat.x,
            flat.y * cos - flat.z * sin + 0.335,
            flat.y * sin + flat.z * cos,
        )
    })
}

/// Half the side of the cushion, and the height of its upper half, metres; the lower half is flatter.
const CUSHION: Vec2 = Vec2::new(0.3, 0.135);
/// How far its corners are drawn in.
const CUSHION_DRAWN: f32 = 0.3;

/// A square cushion: two sheets and the welt that joins them.
pub(super) fn cushion() -> [Mesh; 3] {
    let outline = |p: f32, q: f32| CUSHION.x * p * (1.0 - CUSHION_DRAWN * q * q).sqrt();
    let sheet = |height: f32, up: f32| {
        let sheet = pillow(Vec2::splat(CUSHION.x), CUSHION_DRAWN, height, up);
        move |s: f32, t: f32| sheet(s, t) + Vec3::Y * (CUSHION.y * 0.5)
    };
    let welt = |s: f32| {
        let around = s.rem_euclid(1.0) * 4.0;
        let along = around.fract() * 2.0 - 1.0;
        let (edge, across) = (outline(1.0, along), outline(along, 1.0));
        let (x, z) = match around as usize {
            0 => (across, edge),
            1 => (edge, -across),
            2 => (-across, -edge),
            _ => (-edge, across),
        };
        Vec3::new(x, CUSHION.y * 0.5, z)
    };
    [
        grid(36, 36, Vec2::splat(2.0), sheet(CUSHION.y, 1.0)),
        grid(24, 24, Vec2::splat(2.0), sheet(CUSHION.y * 0.5, -1.0)),
        tube(160, 8, 0.009, Vec2::new(32.0, 1.0), welt),
    ]
}
