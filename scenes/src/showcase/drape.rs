//! A cloth that has fallen over a ball: particles on a grid, held together by distances.
//!
//! Position based dynamics, after Müller, Heidelberger, Hennix, Ratcliff: Position Based Dynamics, 2007. One
//! thread, additions, products and square roots only: the same cloth on every platform. The cloth does not
//! collide with itself.

use glam::{Vec2, Vec3};

use crate::Mesh;
use crate::shapes::cells;

/// The ball under the cloth, metres.
pub(super) const BALL_CENTRE: Vec3 = Vec3::new(0.0, 0.33, 0.0);
pub(super) const BALL_RADIUS: f32 = 0.325;

/// Cells along a side of the cloth.
const CELLS: usize = 76;
/// Side of the cloth, metres, and how often the material fits along it.
const SIDE: f32 = 1.18;
const REPEATS: f32 = 6.0;
/// Distance between the particles and what they lie on: half the cloth, and room for the flat triangles
/// between particles on a round ball.
const THICKNESS: f32 = 0.008;
/// Steps of a 60th of a second, and rounds of constraints in each.
const STEPS: usize = 280;
const ROUNDS: usize = 12;
/// Metres a second a second; less than on earth, which makes distances hold in fewer rounds.
const GRAVITY: f32 = 2.0;

/// Two particles and their distance at rest; `give` is the share of an error that one round corrects.
struct Link {
    ends: [usize; 2],
    rest: f32,
    give: f32,
}

/// The cloth at rest.
pub(super) fn cloth() -> Mesh {
    let count = CELLS + 1;
    let rest = SIDE / CELLS as f32;
    let grid = |index: usize| Vec2::new((index % count) as f32, (index / count) as f32) / CELLS as f32;
    // Turned and off the middle, so that no two sides fall alike.
    let (cos, sin) = (0.955, 0.2966);
    let mut positions: Vec<Vec3> = (0..count * count)
        .map(|index| {
            let flat = (grid(index) - 0.5) * SIDE;
            let height = BALL_CENTRE.y + BALL_RADIUS + 0.02 + 0.01 * flat.x;
            Vec3::new(
                flat.x * cos - flat.y * sin + 0.03,
                height,
                -(flat.x * sin + flat.y * cos) - 0.02,
            )
        })
        .collect();
    let links = links(count, rest);
    let mut before = positions.clone();
    for _ in 0..STEPS {
        let step = Vec3::NEG_Y * (GRAVITY / 3600.0);
        for (position, before) in positions.iter_mut().zip(&mut before) {
            let moved = (*position - *before) * 0.985 + step;
            *before = *position;
            *position += moved;
        }
        for _ in 0..ROUNDS {
            for Link {
                ends: [a, b],
                rest,
                give,
            } in &links
            {
                let apart = positions[*b] - positions[*a];
                let length = apart.length().max(1e-9);
                let correction = apart * (0.5 * give * (length - rest) / length);
                positions[*a] += correction;
                positions[*b] -= correction;
            }
        }
        for (position, before) in positions.iter_mut().zip(&before) {
            *position = outside(*position, *before);
        }
    }
    let mut mesh = Mesh {
        positions,
        uvs: (0..count * count)
            .map(grid)
            .map(|at| Vec2::new(at.x, 1.0 - at.y) * REPEATS)
            .collect(),
        indices: cells(CELLS, CELLS),
        ..Mesh::default()
    };
    mesh.compute_smooth_normals();
    mesh.compute_tangents();
    mesh
}

/// Threads, which keep their length; diagonals, which give; and links over one particle, which resist bending.
fn links(count: usize, rest: f32) -> Vec<Link> {
    let mut links = Vec::new();
    let shapes: [(usize, usize, f32); 6] = [
        (1, 0, 1.0),
        (0, 1, 1.0),
        (1, 1, 0.25),
        (2, 0, 0.06),
        (0, 2, 0.06),
        (4, 4, 0.02),
    ];
    for (right, up, give) in shapes {
        for index in 0..count * count {
            let (column, row) = (index % count, index / count);
            let length = rest * ((right * right + up * up) as f32).sqrt();
            if column + right < count && row + up < count {
                links.push(Link {
                    ends: [index, index + up * count + right],
                    rest: length,
                    give,
                });
            }
            if right > 0 && up > 0 && column >= right && row + up < count {
                links.push(Link {
                    ends: [index, index + up * count - right],
                    rest: length,
                    give,
                });
            }
        }
    }
    links
}

/// A particle moved out of ball and ground, and held back along them by friction.
fn outside(position: Vec3, before: Vec3) -> Vec3 {
    let mut position = position;
    let from_centre = position - BALL_CENTRE;
    let distance = from_centre.length();
    if distance < BALL_RADIUS + THICKNESS {
        let normal = from_centre / distance.max(1e-9);
        let moved = position - before;
        let along = moved - normal * moved.dot(normal);
        position = BALL_CENTRE + normal * (BALL_RADIUS + THICKNESS) - along * 0.35;
    }
    if position.y < THICKNESS {
        let moved = position - before;
        position = Vec3::new(position.x - moved.x * 0.7, THICKNESS, position.z - moved.z * 0.7);
    }
    position
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lies_on_the_ball_hangs_and_is_hardly_stretched() {
        let mesh = cloth();
        for position in &mesh.positions {
            assert!(
                (*position - BALL_CENTRE).length() > BALL_RADIUS,
                "inside the ball at {position}"
            );
            assert!(position.y > 0.0 && position.is_finite());
        }
        let lowest = mesh
            .positions
            .iter()
            .map(|position| position.y)
            .fold(f32::MAX, f32::min);
        assert!(lowest < 0.1, "the corners hang down to {lowest}");
        let rest = SIDE / CELLS as f32;
        let stretch = |a: usize, b: usize| mesh.positions[a].distance(mesh.positions[b]) / rest;
        let stretches: Vec<f32> = (0..CELLS * (CELLS + 1))
            .map(|at| stretch(at, at + CELLS + 1))
            .collect();
        let mean = stretches.iter().sum::<f32>() / stretches.len() as f32;
        assert!((0.97..1.04).contains(&mean), "mean stretch {mean}");
        assert!(stretches.iter().all(|stretch| *stretch < 1.3));
        assert_eq!(cloth().positions, mesh.positions, "the same cloth again");
    }
}
