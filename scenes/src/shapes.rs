//! Parametric surfaces. u runs along s, v falls along t, and ∂s × ∂t points outwards: so materials stand
//! upright and unmirrored.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use crate::Mesh;

/// A grid of `columns` × `rows` cells over a surface; s and t run from 0 to 1, `repeats` is how often the
/// material fits along each.
pub(crate) fn grid(columns: usize, rows: usize, repeats: Vec2, surface: impl Fn(f32, f32) -> Vec3) -> Mesh {
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
    // Half a cell where cells are small: relief as fine as the grid has its own normals.
    let step = (0.5 / columns.max(rows) as f32).min(2e-3);
    mesh.compute_smooth_normals(); // for poles, where a derivative vanishes
    for (index, normal) in mesh.normals.iter_mut().enumerate() {
        let (s, t) = corner(index);
        let along_s = surface(s + step, t) - surface(s - step, t);
        let along_t = surface(s, t + step) - surface(s, t - step);
        let (direction_s, direction_t) = (along_s.normalize_or_zero(), along_t.normalize_or_zero());
        *normal = direction_s.cross(direction_t).try_normalize().unwrap_or(*normal);
    }
    mesh.compute_tangents();
    mesh
}

/// Corners of the triangles of a grid: counter-clockwise where ∂s × ∂t points to the viewer.
pub(crate) fn cells(columns: usize, rows: usize) -> Vec<u32> {
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

/// A closed surface around the origin: `radius` by direction. Spherical coordinates; the poles, on y, are left open
/// by less than a thousandth.
#[cfg(feature = "synth")]
pub(crate) fn star(columns: usize, rows: usize, repeats: Vec2, radius: impl Fn(Vec3) -> f32) -> Mesh {
    grid(columns, rows, repeats, |s, t| {
        let (around, up) = (s * TAU, (t - 0.5) * TAU / 2.0 * 0.9995);
        let direction = Vec3::new(up.cos() * around.cos(), up.sin(), -up.cos() * around.sin());
        direction * radius(direction)
    })
}

/// A surface of revolution around y; `outline` holds radius and height, from the foot on. v follows the length of
/// the outline, so that a material is not squeezed where it bends.
pub(crate) fn revolved(columns: usize, rows: usize, repeats: Vec2, outline: &[[f32; 2]]) -> Mesh {
    let point = by_length(outline);
    grid(columns, rows, repeats, |s, t| {
        let (around, point) = (s * TAU, point(t));
        Vec3::new(point.x * around.cos(), point.y, -point.x * around.sin())
    })
}

/// The curve through `points` by the share of its length.
pub(crate) fn by_length(points: &[[f32; 2]]) -> impl Fn(f32) -> Vec2 + use<'_> {
    let steps = 400;
    let mut length = vec![0.0];
    for step in 0..steps {
        let at = |step: usize| spline(points, step as f32 / steps as f32);
        length.push(length[step] + at(step).distance(at(step + 1)));
    }
    let total = length[steps];
    move |share| {
        let wanted = share.clamp(0.0, 1.0) * total;
        let after = length.partition_point(|length| *length < wanted).clamp(1, steps);
        let inside = (wanted - length[after - 1]) / (length[after] - length[after - 1]);
        spline(points, (after as f32 - 1.0 + inside) / steps as f32)
    }
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
pub(crate) fn tube(
    columns: usize,
    rows: usize,
    radius: f32,
    repeats: Vec2,
    curve: impl Fn(f32) -> Vec3,
) -> Mesh {
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
