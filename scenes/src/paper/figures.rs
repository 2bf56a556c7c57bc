//! Two figures: a seated one, and a standing one in scale armour. Both are displaced surfaces over cylindrical
//! coordinates, so that their texture coordinates have no seams but one.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::objects::Grain;
use crate::Mesh;
use crate::shapes::{by_length, grid};

/// Outline of the seated figure: half width and height in metres, from the ground up.
const SEATED: [[f32; 2]; 17] = [
    [0.002, 0.0],
    [0.36, 0.004],
    [0.42, 0.05],
    [0.40, 0.13],
    [0.30, 0.21],
    [0.235, 0.3],
    [0.225, 0.42],
    [0.25, 0.54],
    [0.255, 0.61],
    [0.16, 0.675],
    [0.078, 0.715],
    [0.085, 0.755],
    [0.122, 0.82],
    [0.112, 0.9],
    [0.05, 0.945],
    [0.045, 0.985],
    [0.002, 1.0],
];

/// A seated figure, legs crossed, `height` metres high.
pub(super) fn seated(triangles: f32, repeats: Vec2, height: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 1.6);
    let outline = by_length(&SEATED);
    // A bulge: angle from the front, height, how wide in both, and how far it stands out.
    let bulges: [[f32; 5]; 11] = [
        [0.95, 0.085, 0.42, 0.075, 0.14], // knees
        [-0.95, 0.085, 0.42, 0.075, 0.14],
        [0.0, 0.09, 0.35, 0.05, -0.07], // between the shins
        [0.0, 0.235, 0.4, 0.045, 0.12], // hands in the lap
        [1.45, 0.42, 0.3, 0.16, 0.06],  // arms
        [-1.45, 0.42, 0.3, 0.16, 0.06],
        [0.0, 0.36, 0.6, 0.08, 0.035],  // belly
        [0.0, 0.8, 0.16, 0.018, 0.03],  // nose
        [0.0, 0.762, 0.5, 0.02, 0.012], // chin
        [1.5, 0.81, 0.13, 0.045, 0.03], // ears
        [-1.5, 0.81, 0.13, 0.045, 0.03],
    ];
    grid(columns, rows, repeats, |s, t| {
        let Vec2 { x: reach, y } = outline(t);
        // The front is +z, which is at three quarters of a turn.
        let around = s * TAU;
        let from_front = (around - 1.5 * PI + PI).rem_euclid(TAU) - PI;
        let bulged: f32 = bulges
            .iter()
            .map(|[angle, at, wide, high, out]| {
                let across = ((from_front - angle) / wide).powi(2);
                out * (-across - ((y - at) / high).powi(2)).exp()
            })
            .sum();
        // The robe falls in folds from the left shoulder; hair in small curls.
        let robe = ((y - 0.03) / 0.05).clamp(0.0, 1.0) * ((0.63 - y) / 0.06).clamp(0.0, 1.0);
        let folds = (from_front * 4.0 + 34.0 * y + 0.8 * (from_front * 3.0).sin()).sin();
        let hair = ((y - 0.855) / 0.01).clamp(0.0, 1.0) * ((0.975 - y) / 0.02).clamp(0.0, 1.0);
        let curls = (around * 18.0).sin() * (y * 260.0).sin();
        let relief = robe * 0.007 * folds + hair * 0.004 * curls;
        let reach = reach + (bulged + relief) * (reach / 0.03).min(1.0);
        let (sin, cos) = around.sin_cos();
        let flat = 1.0 - 0.22 * ((y - 0.15) / 0.2).clamp(0.0, 1.0) * ((0.72 - y) / 0.1).clamp(0.0, 1.0);
        Vec3::new(reach * cos, y, -reach * sin * flat) * height
    })
}

/// Outline of the soldier: half width and height in metres, from the base up.
const OUTLINE: [[f32; 2]; 17] = [
    [0.002, 0.0],
    [0.26, 0.005],
    [0.27, 0.05],
    [0.22, 0.07],
    [0.16, 0.12],
    [0.15, 0.45],
    [0.17, 0.62],
    [0.235, 0.66],
    [0.215, 0.9],
    [0.19, 1.08],
    [0.24, 1.28],
    [0.25, 1.38],
    [0.12, 1.48],
    [0.085, 1.53],
    [0.125, 1.66],
    [0.10, 1.8],
    [0.002, 1.86],
];

/// A standing soldier, `height` metres high.
pub(super) fn soldier(triangles: f32, repeats: Vec2, height: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 0.8);
    let outline = by_length(&OUTLINE);
    let scale = height / 1.86;
    grid(columns, rows, repeats, |s, t| {
        let Vec2 { x: reach, y } = outline(t);
        let around = s * TAU;
        let (sin, cos) = around.sin_cos();
        let within = |low: f32, high: f32, soft: f32| {
            ((y - low) / soft).clamp(0.0, 1.0) * ((high - y) / soft).clamp(0.0, 1.0)
        };
        // Arms at the sides, held a little to the front.
        let arm = |side: f32| (-(around - side).sin().powi(2) * 9.0).exp() * (around - side).cos().max(0.0);
        let arms = 0.085 * within(0.72, 1.4, 0.12) * (arm(0.25) + arm(PI - 0.25));
        // Scales of armour: rows of round plates, each row moved by half a plate.
        let armour = within(0.66, 1.44, 0.02);
        let row = y * 24.0;
        let plate = around * 26.0 / TAU + 0.5 * (row.floor() % 2.0);
        let (px, py) = (plate - plate.floor() - 0.5, row - row.floor() - 0.5);
        let dome = (1.0 - (px * px * 3.2 + (py + 0.12).powi(2) * 2.6))
            .max(0.0)
            .sqrt();
        let rivet = (-((px * px) + (py - 0.22).powi(2)) * 160.0).exp();
        // The skirt hangs in folds, the legs are wrapped in bands.
        let skirt = 0.016 * within(0.45, 0.7, 0.08) * (around * 15.0).sin();
        let bands = 0.004 * within(0.1, 0.48, 0.03) * (y * 150.0 + around).sin();
        let relief = armour * (0.012 * dome + 0.005 * rivet) + skirt + bands;
        // The face looks to the front, +z, which is at three quarters of a turn.
        let front = (-sin).max(0.0);
        let nose = 0.028 * (-((y - 1.645) / 0.03).powi(2)).exp() * front.powi(60);
        let brow = 0.01 * (-((y - 1.69) / 0.014).powi(2)).exp() * front.powi(6);
        let reach = reach + (arms + relief + nose + brow) * (reach / 0.02).min(1.0);
        // Deeper than wide nowhere: bodies are flat.
        Vec3::new(
            reach * cos,
            y,
            -reach * sin * (1.0 - 0.28 * within(0.1, 1.5, 0.2)),
        ) * scale
    })
}
