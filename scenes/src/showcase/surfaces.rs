//! Parametric surfaces. u runs along s, v falls along t, and ∂s × ∂t points outwards: so materials stand
//! upright and unmirrored.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::Mesh;

/// A grid of `columns` × `rows` cells over a surface; s and t run from 0 to 1, `repeats` is how often the
/// material fits along each.
fn grid(columns: usize, rows: usize, repeats: Vec2, surface: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let corner = |index: usize| {
        let (column, row) = (index % (columns + 1), index / (columns + 1));
        (column as f32 / columns as f32, row as f32 / rows as f32)
    };
    let count = (columns + 1) * (rows + 1);
    let mut mesh = Mesh {
        positions: (0..count).map(corner).map(|(s, t)| surface(s, t)).collect(),
        uvs: (0..count)
            .map(corner)
            .map(|(s, t)| Vec2::new(s, 1.0 - t) * repeats)
            .collect(),
        indices: cells(columns, rows),
        ..Mesh::default()
    };
    mesh.compute_smooth_normals(); // for poles, where a derivative vanishes
    for (index, normal) in mesh.normals.iter_mut().enumerate() {
        let ((s, t), step) = (corner(index), 2e-3);
        let along_s = surface(s + step, t) - surface(s - step, t);
        let along_t = surface(s, t + step) - surface(s, t - step);
        let (direction_s, direction_t) = (along_s.normalize_or_zero(), along_t.normalize_or_zero());
        *normal = direction_s.cross(direction_t).try_normalize().unwrap_or(*normal);
    }
    mesh.compute_tangents();
    mesh
}

/// Corners of the triangles of a grid: counter-clockwise where ∂s × ∂t points to the viewer.
pub(super) fn cells(columns: usize, rows: usize) -> Vec<u32> {
    let stride = columns as u32 + 1;
    let cell = |index: usize| {
        let low = (index / columns) as u32 * stride + (index % columns) as u32;
        [
            low,
            low + 1,
            low + stride + 1,
            low,
            low + stride + 1,
            low + stride,
        ]
    };
    (0..columns * rows).flat_map(cell).collect()
}

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
    let outline = |t: f32| spline(&VASE, t);
    // v follows the length of the outline, so that the material is not squeezed where it bends.
    let steps = 400;
    let mut length = vec![0.0];
    for step in 0..steps {
        let (from, to) = (
            outline(step as f32 / steps as f32),
            outline((step + 1) as f32 / steps as f32),
        );
        length.push(length[step] + from.distance(to));
    }
    let total = length[steps];
    let at_length = |share: f32| {
        let wanted = share.clamp(0.0, 1.0) * total;
        let after = length.partition_point(|length| *length < wanted).clamp(1, steps);
        let inside = (wanted - length[after - 1]) / (length[after] - length[after - 1]);
        outline((after as f32 - 1.0 + inside) / steps as f32)
    };
    grid(64, 72, Vec2::new(3.0, 3.0), |s, t| {
        let (around, point) = (s * TAU, at_length(t));
        Vec3::new(point.x * around.cos(), point.y, -point.x * around.sin())
    })
}

/// Catmull and Rom's cubic through points, t from 0 to 1.
fn spline(points: &[[f32; 2]], t: f32) -> Vec2 {
    let last = points.len() as isize - 1;
    let position = t.clamp(0.0, 1.0) * last as f32;
    let start = (position as isize).min(last - 1);
    let [a, b, c, d] =
        [-1, 0, 1, 2].map(|offset| Vec2::from(points[(start + offset).clamp(0, last) as usize]));
    let s = position - start as f32;
    let cubic =
        (c - a) * s + (a * 2.0 - b * 5.0 + c * 4.0 - d) * s * s + (b * 3.0 - a - c * 3.0 + d) * s * s * s;
    b + cubic * 0.5
}

/// A closed tube around a curve of one turn per unit. Frames are carried along the curve without twist, and
/// what is missing to a whole turn at the end is spread over its length.
fn tube(columns: usize, rows: usize, radius: f32, repeats: Vec2, curve: impl Fn(f32) -> Vec3) -> Mesh {
    let forward = |s: f32| (curve(s + 1e-3) - curve(s - 1e-3)).normalize();
    let carried = |side: Vec3, forward: Vec3| (side - forward * side.dot(forward)).normalize();
    let start = carried(Vec3::Y, forward(0.0));
    let mut sides = vec![start];
    for column in 1..=columns {
        sides.push(carried(
            sides[column - 1],
            forward(column as f32 / columns as f32),
        ));
    }
    let missing = {
        let end = sides[columns];
        forward(0.0).dot(end.cross(start)).atan2(end.dot(start))
    };
    let mut mesh = Mesh {
        indices: cells(columns, rows),
        ..Mesh::default()
    };
    for row in 0..=rows {
        for (column, side) in sides.iter().enumerate() {
            let (s, t) = (column as f32 / columns as f32, row as f32 / rows as f32);
            let angle = missing * s - t * TAU;
            let normal = *side * angle.cos() + forward(s).cross(*side) * angle.sin();
            mesh.positions.push(curve(s) + normal * radius);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(s, 1.0 - t) * repeats);
        }
    }
    mesh.compute_tangents();
    mesh
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
