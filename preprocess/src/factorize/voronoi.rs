//! Areas of the Voronoi cells of directions on the upper hemisphere: how much of it is nearest to each.

use rayon::prelude::*;
use tileset::Direction;

type Vector = [f64; 3];

/// Solid angle that is nearer to each direction than to all others, in steradians; they add up to 2π.
///
/// A cell is the hemisphere cut by the planes halfway to all other directions. All planes pass through the centre of
/// the sphere, so its corners are cut as those of a flat polygon are, without regard to their lengths.
pub(super) fn cell_areas(directions: &[Direction]) -> Vec<f64> {
    let sites: Vec<Vector> = directions.iter().map(|direction| direction.to_vector()).collect();
    (0..sites.len())
        .into_par_iter()
        .map(|site| cell_area(&sites, site))
        .collect()
}

fn cell_area(sites: &[Vector], site: usize) -> f64 {
    // Quarters of the hemisphere: sides of a polygon must be shorter than half a circle.
    let equator = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
    ];
    let (mut area, mut spare) = (0.0, Vec::new());
    for corner in 0..4 {
        let mut quarter = vec![[0.0, 0.0, 1.0], equator[corner], equator[(corner + 1) % 4]];
        for other in (0..sites.len()).filter(|&other| other != site) {
            let plane: Vector = std::array::from_fn(|axis| sites[site][axis] - sites[other][axis]);
            cut(&mut quarter, &mut spare, plane);
            if quarter.is_empty() {
                break;
            }
        }
        area += polygon_area(&quarter);
    }
    area
}

/// Keeps of the polygon what lies on the positive side of a plane through the centre; `spare` is overwritten.
fn cut(polygon: &mut Vec<Vector>, spare: &mut Vec<Vector>, plane: Vector) {
    spare.clear();
    for (index, &a) in polygon.iter().enumerate() {
        let b = polygon[(index + 1) % polygon.len()];
        let (side_a, side_b) = (dot(a, plane), dot(b, plane));
        if side_a >= 0.0 {
            spare.push(a);
        }
        if (side_a > 0.0 && side_b < 0.0) || (side_a < 0.0 && side_b > 0.0) {
            let corner = std::array::from_fn(|axis| a[axis] * side_b.abs() + b[axis] * side_a.abs());
            spare.push(scaled_to_unit(corner));
        }
    }
    if spare.len() < 3 {
        spare.clear();
    }
    std::mem::swap(polygon, spare);
}

/// A fan of triangles, each by van Oosterom and Strackee: The Solid Angle of a Plane Triangle, 1983, equation 8.
fn polygon_area(polygon: &[Vector]) -> f64 {
    let triangle = |a: Vector, b: Vector, c: Vector| {
        let cross = [
            b[1] * c[2] - b[2] * c[1],
            b[2] * c[0] - b[0] * c[2],
            b[0] * c[1] - b[1] * c[0],
        ];
        2.0 * dot(a, cross).atan2(1.0 + dot(a, b) + dot(b, c) + dot(c, a))
    };
    (2..polygon.len())
        .map(|i| triangle(polygon[0], polygon[i - 1], polygon[i]))
        .sum::<f64>()
        .max(0.0)
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn scaled_to_unit(a: Vector) -> Vector {
    let length = dot(a, a).sqrt();
    a.map(|value| value / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    fn at(theta: f64, phi: f64) -> Direction {
        Direction { theta, phi }
    }

    #[test]
    fn cells_of_simple_samplings() {
        assert!((cell_areas(&[at(0.3, 1.0)])[0] - TAU).abs() < 1e-12);
        for (a, b) in cell_areas(&[at(0.4, 0.1), at(0.4, 0.1 + PI)])
            .iter()
            .zip([PI, PI])
        {
            assert!((a - b).abs() < 1e-12);
        }
        // The pole and the horizon: the pole's cell is within a regular hexagon around a cap of 45 degrees.
        let mut ring: Vec<Direction> = (0..6).map(|i| at(FRAC_PI_2, f64::from(i) * TAU / 6.0)).collect();
        ring.push(at(0.0, 0.0));
        let areas = cell_areas(&ring);
        let cap = TAU * (1.0 - (PI / 4.0).cos());
        assert!(
            areas[6] > cap && areas[6] < 1.3 * cap,
            "{} beside {cap}",
            areas[6]
        );
        assert!((areas.iter().sum::<f64>() - TAU).abs() < 1e-9);
    }

    #[test]
    fn cells_are_those_of_the_nearest_direction() {
        let directions: Vec<Direction> = (0..40)
            .map(|i| at(FRAC_PI_2 * (f64::from(i) / 40.0).sqrt(), 2.4 * f64::from(i) % TAU))
            .collect();
        let sites: Vec<Vector> = directions.iter().map(|d| d.to_vector()).collect();
        let mut counts = vec![0f64; 40];
        const POINTS: u32 = 200_000;
        for i in 0..POINTS {
            // A spiral of equal areas.
            let z = (f64::from(i) + 0.5) / f64::from(POINTS);
            let (sin, cos) = (2.399963229728653 * f64::from(i)).sin_cos();
            let point = [(1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z];
            let nearest = (0..40).max_by(|&a, &b| dot(sites[a], point).total_cmp(&dot(sites[b], point)));
            counts[nearest.unwrap()] += TAU / f64::from(POINTS);
        }
        for (area, count) in cell_areas(&directions).iter().zip(counts) {
            assert!((area - count).abs() < 0.002, "{area} beside {count}");
        }
    }
}
