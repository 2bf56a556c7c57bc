//! Two figures: a seated one of soft lobes, and a standing one in scale armour. Both are displaced surfaces over
//! spherical or cylindrical coordinates, so that their texture coordinates have no seams but one.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::objects::Grain;
use crate::Mesh;
use crate::shapes::{by_length, grid, star};

/// A soft bulge: direction, height in radii, and how narrow it is.
type Lobe = ([f32; 3], f32, f32);

const SEATED: [Lobe; 15] = [
    ([0.0, 1.0, 0.08], 0.52, 5.0),     // neck and shoulders
    ([0.0, 1.0, 0.12], 0.78, 26.0),    // head
    ([0.0, 0.93, 0.36], 0.10, 90.0),   // face
    ([0.0, 1.0, -0.02], 0.14, 420.0),  // topknot
    ([0.17, 0.98, 0.08], 0.08, 700.0), // ears
    ([-0.17, 0.98, 0.08], 0.08, 700.0),
    ([0.78, -0.35, 0.62], 0.46, 9.0), // knees
    ([-0.78, -0.35, 0.62], 0.46, 9.0),
    ([0.8, 0.32, 0.1], 0.22, 14.0), // arms
    ([-0.8, 0.32, 0.1], 0.22, 14.0),
    ([0.25, -0.1, 0.97], 0.14, 40.0), // hands
    ([-0.25, -0.1, 0.97], 0.14, 40.0),
    ([0.0, 0.05, 1.0], 0.10, 8.0),    // belly
    ([0.0, -0.42, 0.9], -0.12, 30.0), // lap
    ([0.0, 0.5, -0.85], 0.10, 6.0),   // back
];

/// A seated figure about a metre high, on the ground.
pub(super) fn seated(triangles: f32, repeats: Vec2, size: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 1.6);
    let lobes = SEATED.map(|(direction, height, narrow)| (Vec3::from(direction).normalize(), height, narrow));
    let radius = move |d: Vec3| {
        let soft: f32 = lobes
            .iter()
            .map(|(at, height, narrow)| height * (narrow * (at.dot(d) - 1.0)).exp())
            .sum();
        // Folds of a robe, below the shoulders.
        let robe = (1.0 - (d.y - 0.1).max(0.0) * 2.2).clamp(0.0, 1.0);
        let along = d.x.atan2(d.z);
        let folds = (along * 9.0 + 5.0 * d.y + 1.2 * (3.0 * along).sin()).sin();
        let crease = (along * 23.0 - 8.0 * d.y).sin() * 0.35;
        0.62 + 0.75 * soft + 0.012 * robe * (folds + crease)
    };
    let mut mesh = star(columns, rows, repeats, |d| {
        // Flat below: the ray to the ground, softened.
        let free = radius(d);
        let ground = if d.y < -1e-3 { 0.45 / -d.y } else { f32::MAX };
        let sharp = 12.0f32;
        if ground > 4.0 * free {
            free
        } else {
            (free.powf(-sharp) + ground.powf(-sharp)).powf(-1.0 / sharp)
        }
    });
    // The lowest point stands on the ground.
    for position in &mut mesh.positions {
        *position = (*position + Vec3::Y * 0.45) * size * 0.5;
    }
    mesh
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
