//! Known sets of directions.

use tileset::Direction;

pub(crate) fn direction(theta_degrees: f64, phi_degrees: f64) -> Direction {
    Direction {
        theta: theta_degrees.to_radians(),
        phi: phi_degrees.to_radians(),
    }
}

/// Rings of evenly spaced samples: polar angle, number and azimuth of the first, in degrees.
pub(crate) fn rings(rings: &[(f64, u32, f64)]) -> Vec<Direction> {
    let ring = |&(theta, count, first): &(f64, u32, f64)| {
        (0..count).map(move |i| direction(theta, first + 360.0 * f64::from(i) / f64::from(count)))
    };
    rings.iter().flat_map(ring).collect()
}

/// The 81 directions of UBO2003.
pub(crate) fn bonn81() -> Vec<Direction> {
    rings(&[
        (0.0, 1, 0.0),
        (15.0, 6, 0.0),
        (30.0, 12, 0.0),
        (45.0, 18, 0.0),
        (60.0, 20, 0.0),
        (75.0, 24, 0.0),
    ])
}

/// The 151 directions of UBO2014.
pub(crate) fn ubo151() -> Vec<Direction> {
    let thetas = [0.0, 11.0, 23.5, 30.0, 37.5, 45.0, 52.5, 60.0, 67.5, 75.0];
    let counts = [1, 6, 12, 12, 12, 18, 18, 24, 24, 24];
    let offsets = [0.0, 15.0, 0.0, 15.0, 0.0, 0.0, 7.5, 0.0, 7.5, 0.0];
    rings(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9].map(|i| (thetas[i], counts[i], offsets[i])))
}
