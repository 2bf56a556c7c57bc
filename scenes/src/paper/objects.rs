//! The objects of the scenes. Each takes the number of its triangles and how often its material fits along u and v.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::Mesh;
use crate::shapes::{grid, revolved, star, tube};

/// Columns and rows of a grid.
pub(super) struct Grain {
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Grain {
    /// The grid of about so many triangles whose columns are `aspect` times its rows.
    pub(super) fn of(triangles: f32, aspect: f32) -> Grain {
        let columns = ((triangles * 0.5 * aspect).sqrt().round() as usize).max(12);
        let rows = ((triangles * 0.5 / columns as f32).round() as usize).max(6);
        Grain { columns, rows }
    }
}

/// A lying torus around the origin.
pub(super) fn torus(triangles: f32, repeats: Vec2, radius: f32, thickness: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 50.0 / 18.0);
    grid(columns, rows, repeats, |s, t| {
        let (around, up) = (s * TAU, (t - 0.5) * TAU);
        let reach = radius + thickness * up.cos();
        Vec3::new(reach * around.cos(), thickness * up.sin(), -reach * around.sin())
    })
}

/// The side of an upright cylinder, and its lid with the material as it lies in the plane.
pub(super) fn cylinder(triangles: f32, radius: f32, height: f32) -> [Mesh; 2] {
    let columns = (triangles / 21.0).round().max(8.0) as usize; // ten rows of two, and one for the lid
    let side = grid(columns, 10, Vec2::new(2.0, 1.0), |s, t| {
        let around = s * TAU;
        Vec3::new(
            radius * around.cos(),
            t.clamp(0.0, 1.0) * height,
            -radius * around.sin(),
        )
    });
    let rim = |column: usize| {
        let around = column as f32 / columns as f32 * TAU;
        Vec2::new(around.cos(), -around.sin())
    };
    let corners: Vec<Vec2> = std::iter::once(Vec2::ZERO).chain((0..columns).map(rim)).collect();
    let mut lid = Mesh {
        positions: corners
            .iter()
            .map(|at| Vec3::new(at.x * radius, height, at.y * radius))
            .collect(),
        normals: vec![Vec3::Y; corners.len()],
        uvs: corners
            .iter()
            .map(|at| Vec2::new(at.x, at.y) * 0.32 + 0.5)
            .collect(),
        indices: (0..columns as u32)
            .flat_map(|n| [0, n + 1, (n + 1) % columns as u32 + 1])
            .collect(),
        ..Mesh::default()
    };
    lid.compute_tangents();
    [side, lid]
}

/// A ball with dents, bumps and ridges.
pub(super) fn blob(triangles: f32, repeats: Vec2, radius: f32, roughness: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 2.0);
    star(columns, rows, repeats, |d| {
        let wave = |x: f32, y: f32, z: f32, phase: f32| (Vec3::new(x, y, z).dot(d) + phase).sin();
        let broad = wave(3.1, 1.7, -2.2, 0.3) + wave(-1.4, 4.2, 2.9, 1.1) + wave(2.7, -3.3, 3.8, 2.0);
        let ridge = 1.0 - wave(6.0, 5.0, -4.0, broad).abs();
        let fine = wave(17.0, -11.0, 13.0, 0.0) * wave(-9.0, 15.0, 19.0, 1.0);
        radius * (1.0 + roughness * (0.07 * broad + 0.05 * ridge + 0.012 * fine))
    })
}

/// |x|ᵖ + |y|ᵖ + |z|ᵖ = 1: a box with round edges for large p, a star for p below one.
pub(super) fn superquadric(triangles: f32, repeats: Vec2, radii: Vec3, power: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 2.0);
    let mut mesh = star(columns, rows, repeats, |d| {
        let sum: f32 = d
            .to_array()
            .iter()
            .map(|axis| (axis.abs() + 1e-4).powf(power))
            .sum();
        sum.powf(-1.0 / power)
    });
    for (position, normal) in mesh.positions.iter_mut().zip(&mut mesh.normals) {
        (*position, *normal) = (*position * radii, (*normal / radii).normalize());
    }
    mesh.compute_tangents();
    mesh
}

/// A closed tube along a torus knot: `turns` times around the axis while it winds `winds` times.
pub(super) fn knot(triangles: f32, repeats: Vec2, size: f32, turns: f32, winds: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 8.0);
    tube(columns, rows, 0.2 * size, repeats, |s| {
        let (along, wind) = (s * TAU * turns, s * TAU * winds);
        let reach = 0.62 + 0.27 * wind.cos();
        Vec3::new(reach * along.cos(), reach * along.sin(), 0.34 * wind.sin()) * size
    })
}

/// A ring whose section is a rounded square that turns once along it.
pub(super) fn twisted(triangles: f32, repeats: Vec2, size: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 3.0);
    grid(columns, rows, repeats, |s, t| {
        let (around, angle) = (s * TAU, (t - 0.5) * TAU);
        let turned = angle - s * TAU;
        let reach = 0.3 / (turned.cos().powi(6) + turned.sin().powi(6)).powf(1.0 / 6.0);
        let out = 0.68 + reach * angle.cos();
        Vec3::new(out * around.cos(), reach * angle.sin(), -out * around.sin()) * size
    })
}

/// A sea shell: a tube that grows as it winds up, with ribs.
pub(super) fn shell(triangles: f32, repeats: Vec2, size: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 4.0);
    grid(columns, rows, repeats, |s, t| {
        let wound = s * 3.6; // turns
        let growth = 0.62f32.powf(3.6 - wound);
        let around = wound * TAU;
        let angle = (t - 0.5) * TAU;
        let rib = 1.0 + 0.05 * (around * 9.0).sin() * (0.5 + 0.5 * angle.cos());
        let knobs = 1.0 + 0.16 * (1.0 + (around * 3.0).cos()) * (-((angle - 0.9) * 2.4).powi(2)).exp();
        let radius = 0.44 * growth * rib * knobs;
        let out = 0.4 * growth + radius * angle.cos();
        let height = 1.55 * (1.0 - growth) + radius * angle.sin() + 0.42;
        Vec3::new(out * around.cos(), height, -out * around.sin()) * size
    })
}

/// A column with twenty flutes.
pub(super) fn fluted(triangles: f32, repeats: Vec2, height: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 3.0);
    grid(columns, rows, repeats, |s, t| {
        let (around, t) = (s * TAU, t.clamp(0.0, 1.0));
        let flute = (around * 10.0).cos().abs();
        let ends = (t * 12.0).min((1.0 - t) * 12.0).min(1.0);
        let radius = 0.26 + 0.05 * (1.0 - ends) - 0.03 * ends * flute - 0.03 * t;
        Vec3::new(radius * around.cos(), t, -radius * around.sin()) * height
    })
}

const PAWN: [[f32; 2]; 15] = [
    [0.002, 0.0],
    [0.3, 0.005],
    [0.31, 0.07],
    [0.25, 0.13],
    [0.26, 0.17],
    [0.17, 0.28],
    [0.125, 0.5],
    [0.11, 0.6],
    [0.2, 0.635],
    [0.2, 0.665],
    [0.12, 0.69],
    [0.18, 0.78],
    [0.185, 0.88],
    [0.12, 0.97],
    [0.002, 1.0],
];
const VASE: [[f32; 2]; 11] = [
    [0.002, 0.0],
    [0.18, 0.005],
    [0.26, 0.16],
    [0.37, 0.4],
    [0.33, 0.62],
    [0.17, 0.79],
    [0.13, 0.89],
    [0.2, 1.0],
    [0.18, 0.99],
    [0.1, 0.88],
    [0.1, 0.7],
];
const BOWL: [[f32; 2]; 11] = [
    [0.002, 0.0],
    [0.22, 0.005],
    [0.23, 0.05],
    [0.14, 0.1],
    [0.36, 0.24],
    [0.52, 0.5],
    [0.55, 0.62],
    [0.52, 0.62],
    [0.46, 0.45],
    [0.28, 0.24],
    [0.002, 0.17],
];

/// Things turned on a lathe.
#[derive(Clone, Copy)]
pub(super) enum Turned {
    Pawn,
    Vase,
    Bowl,
}

/// A surface of revolution, `size` metres high if the outline were one metre high.
pub(super) fn turned(triangles: f32, repeats: Vec2, size: f32, what: Turned) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 1.0);
    let outline: &[[f32; 2]] = match what {
        Turned::Pawn => &PAWN,
        Turned::Vase => &VASE,
        Turned::Bowl => &BOWL,
    };
    let scaled: Vec<[f32; 2]> = outline.iter().map(|at| at.map(|value| value * size)).collect();
    revolved(columns, rows, repeats, &scaled)
}

/// A level ground that rolls further out.
pub(super) fn ground(triangles: f32, side: f32, repeats: f32) -> Mesh {
    let Grain { columns, rows } = Grain::of(triangles, 1.0);
    grid(columns, rows, Vec2::splat(repeats), |s, t| {
        let (x, z) = ((s - 0.5) * side, (0.5 - t) * side);
        let away = ((x.hypot(z) - 0.3 * side) / (0.2 * side)).clamp(0.0, 1.0);
        let rolling = (1.3 * x + 0.5 * z).sin() + (0.9 * z - 0.4 * x + 1.0).sin();
        Vec3::new(x, 0.06 * away * away * (3.0 - 2.0 * away) * rolling, z)
    })
}

/// Half a turn, for objects that lean.
pub(super) const HALF_TURN: f32 = PI;
