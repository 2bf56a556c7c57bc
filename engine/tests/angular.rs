//! Properties of the interpolation between directions, for real and for degenerate sets of samples.

mod directions;

use directions::{bonn81, direction, rings, ubo151};
use engine::angular::{Taps, Triangulation, cosine_from_parabolic, parabolic_from_direction};
use proptest::prelude::*;
use tileset::Direction;

fn known_sets() -> Vec<(&'static str, Vec<Direction>)> {
    vec![
        ("bonn81", bonn81()),
        ("ubo151", ubo151()),
        ("one", vec![direction(40.0, 30.0)]),
        ("one at the normal", vec![direction(0.0, 0.0)]),
        ("two", vec![direction(10.0, 0.0), direction(70.0, 100.0)]),
        (
            "on a line",
            (-5..=5).map(|i| direction(f64::from(i) * 17.0, 33.0)).collect(),
        ),
        (
            "the same place",
            vec![
                direction(30.0, 0.0),
                direction(30.0, 360.0),
                direction(30.0, -360.0),
            ],
        ),
        (
            "many normals",
            (0..24)
                .map(|i| direction(0.0, f64::from(i) * 15.0))
                .chain(bonn81())
                .collect(),
        ),
        ("square", rings(&[(60.0, 4, 45.0)])),
        ("horizon", rings(&[(90.0, 12, 0.0), (0.0, 1, 0.0)])),
        (
            "below the horizon",
            rings(&[(100.0, 5, 0.0), (170.0, 5, 20.0), (45.0, 3, 0.0)]),
        ),
        (
            "far away",
            vec![direction(80.0, 0.0), direction(80.0, 3.0), direction(82.0, 1.0)],
        ),
    ]
}

/// A grid in parabolic coordinates, whose rows and columns are collinear up to rounding.
fn grid(side: i32) -> Vec<Direction> {
    let points = (-side..=side).flat_map(|y| (-side..=side).map(move |x| (f64::from(x), f64::from(y))));
    let scale = 0.7 / f64::from(side);
    points
        .map(|(x, y)| Direction {
            theta: 2.0 * (x.hypot(y) * scale).atan(),
            phi: y.atan2(x),
        })
        .collect()
}

fn from_parabolic([x, y]: [f64; 2]) -> [f64; 3] {
    let square = x * x + y * y;
    [
        2.0 * x / (1.0 + square),
        2.0 * y / (1.0 + square),
        cosine_from_parabolic([x, y]),
    ]
}

fn check_weights(taps: &Taps, samples: usize) {
    assert!(
        taps.weights
            .iter()
            .all(|weight| *weight >= 0.0 && *weight <= 1.0 + 1e-12),
        "{taps:?}"
    );
    assert!((taps.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{taps:?}");
    assert!(
        taps.indices.iter().all(|&index| (index as usize) < samples),
        "{taps:?}"
    );
    assert!((0.0..=1.0 + 1e-12).contains(&taps.cosine), "{taps:?}");
}

fn interpolate(taps: &Taps, values: impl Fn(u32) -> f64) -> f64 {
    taps.indices
        .iter()
        .zip(taps.weights)
        .map(|(&index, weight)| weight * values(index))
        .sum()
}

/// The point that the taps stand for.
fn place(triangulation: &Triangulation, taps: &Taps) -> [f64; 2] {
    [0, 1].map(|axis| interpolate(taps, |index| triangulation.points[index as usize][axis]))
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Directions over the whole sphere.
fn sphere(count: u32) -> impl Iterator<Item = [f64; 3]> {
    (0..count).map(move |i| {
        let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(count);
        let (sin, cos) = (f64::from(i) * 2.399963229728653).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        [radius * cos, radius * sin, z]
    })
}

#[test]
fn every_direction_has_taps() {
    for (name, set) in known_sets()
        .into_iter()
        .chain([("grid", grid(4)), ("none", Vec::new())])
    {
        let triangulation = Triangulation::new(&set);
        let odd = [
            [0.0; 3],
            [f64::NAN, 0.0, 1.0],
            [0.0, f64::INFINITY, 0.0],
            [0.0, 0.0, -1.0],
            [1e-300, 0.0, 1e-300],
        ];
        for direction in sphere(2000).chain(odd) {
            check_weights(&triangulation.taps(direction), triangulation.points.len());
        }
        assert!(!triangulation.hull.is_empty(), "{name}");
    }
}

#[test]
fn samples_are_met_exactly() {
    for (name, set) in known_sets().into_iter().chain([("grid", grid(4))]) {
        let triangulation = Triangulation::new(&set);
        for sample in &set {
            let vector = sample.to_vector();
            let wanted = parabolic_from_direction(vector);
            let taps = triangulation.taps(vector);
            // Up to samples at the same place, of which one stands for all.
            let value = interpolate(&taps, |index| {
                if distance(triangulation.points[index as usize], wanted) < 1e-8 {
                    1.0
                } else {
                    0.0
                }
            });
            assert!((value - 1.0).abs() < 1e-6, "{name} {sample:?}: {taps:?}");
        }
    }
}

/// Inside the hull the interpolant reproduces functions that are linear in parabolic coordinates; outside it
/// takes the hull's closest point.
#[test]
fn linear_functions_are_exact_and_outside_is_the_closest_point() {
    for (name, set) in known_sets().into_iter().chain([("grid", grid(4))]) {
        let triangulation = Triangulation::new(&set);
        for direction in sphere(3000) {
            let wanted = parabolic_from_direction(direction);
            let taps = triangulation.taps(direction);
            let found = place(&triangulation, &taps);
            assert!(
                (cosine_from_parabolic(found) - taps.cosine).abs() < 1e-8,
                "{name}"
            );
            if !taps.outside {
                assert!(distance(found, wanted) < 1e-8, "{name} {direction:?}");
                continue;
            }
            // No sample, and no point between two, lies closer.
            let points = &triangulation.points;
            for &a in points {
                for &b in points.iter().step_by(7) {
                    for share in [0.0, 0.25, 0.5] {
                        let point = [0, 1].map(|axis| a[axis] * (1.0 - share) + b[axis] * share);
                        let closer = distance(point, wanted) < distance(found, wanted) - 1e-8;
                        assert!(
                            !closer,
                            "{name} {direction:?}: {point:?} is closer than {found:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn triangles_are_counter_clockwise_neighbours_mutual_and_delaunay() {
    for (name, set) in [("bonn81", bonn81()), ("ubo151", ubo151()), ("grid", grid(4))] {
        let triangulation = Triangulation::new(&set);
        let point = |vertex: u32| triangulation.points[vertex as usize];
        let area = |[a, b, c]: [[f64; 2]; 3]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let mut edges = 0;
        for (at, triangle) in triangulation.triangles.iter().enumerate() {
            assert!(area(triangle.vertices.map(point)) > 0.0, "{name}");
            for (k, &neighbour) in triangle.neighbours.iter().enumerate() {
                if neighbour == u32::MAX {
                    edges += 1;
                    continue;
                }
                let other = &triangulation.triangles[neighbour as usize];
                let back = other
                    .neighbours
                    .iter()
                    .position(|&back| back == at as u32)
                    .expect("mutual");
                assert!(
                    !triangle.vertices.contains(&other.vertices[back])
                        && !other.vertices.contains(&triangle.vertices[k])
                );
            }
            // No sample lies inside the circle through the corners.
            let [a, b, c] = triangle.vertices.map(point);
            for p in &triangulation.points {
                let row = |q: [f64; 2]| {
                    let (x, y) = (q[0] - p[0], q[1] - p[1]);
                    [x, y, x * x + y * y]
                };
                let [a, b, c] = [row(a), row(b), row(c)];
                let determinant = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                    + a[2] * (b[0] * c[1] - b[1] * c[0]);
                assert!(determinant < 1e-9, "{name}");
            }
        }
        assert_eq!(edges, triangulation.hull.len());
        for (at, edge) in triangulation.hull.iter().enumerate() {
            assert_eq!(
                edge[1],
                triangulation.hull[(at + 1) % edges][0],
                "{name}: the hull is one loop"
            );
        }
        // Euler: a triangulation of n points with h on the hull has 2n − 2 − h triangles.
        assert_eq!(triangulation.triangles.len(), 2 * set.len() - 2 - edges, "{name}");
    }
}

#[test]
fn degenerate_sets_have_no_triangles_but_a_hull() {
    let hull = |set: &[Direction]| {
        let triangulation = Triangulation::new(set);
        assert!(
            triangulation.triangles.is_empty() && triangulation.start.iter().all(|start| *start == u32::MAX)
        );
        triangulation.hull
    };
    assert_eq!(hull(&[direction(40.0, 30.0)]), [[0, 0]]);
    assert_eq!(hull(&[direction(40.0, 30.0); 3]), [[0, 0]]);
    assert_eq!(hull(&[direction(40.0, 30.0), direction(10.0, 0.0)]).len(), 1);
    let line = [20.0, -40.0, 0.0, 60.0].map(|theta| direction(theta, 33.0));
    let ordered = hull(&line);
    let along = |sample: u32| line[sample as usize].theta;
    assert_eq!(ordered.len(), 3);
    let rising = along(ordered[0][0]) < along(ordered[0][1]);
    assert!(
        ordered
            .iter()
            .all(|edge| (along(edge[0]) < along(edge[1])) == rising)
    );
    assert!(ordered.windows(2).all(|pair| pair[0][1] == pair[1][0]));
}

/// ∫ ρ cosθ dω / π by many directions spread evenly over the hemisphere.
fn integrate(triangulation: &Triangulation, values: &[f64], cosine: bool) -> f64 {
    let count = 200_000;
    let sum: f64 = sphere(count)
        .filter(|direction| direction[2] > 0.0)
        .map(|direction| {
            let taps = triangulation.taps(direction);
            let reflectance = interpolate(&taps, |index| values[index as usize]);
            reflectance
                * if cosine {
                    taps.horizon_scale(direction[2])
                } else {
                    direction[2]
                }
        })
        .sum();
    sum * 4.0 / f64::from(count)
}

#[test]
fn ambient_weights_integrate_the_interpolant() {
    for (name, set) in [
        ("bonn81", bonn81()),
        ("ubo151", ubo151()),
        ("grid", grid(3)),
        ("one", vec![direction(40.0, 30.0)]),
    ] {
        let triangulation = Triangulation::new(&set);
        for cosine in [false, true] {
            let weights = triangulation.ambient_weights(&set, cosine);
            assert_eq!(weights.len(), set.len());
            assert!(weights.iter().all(|weight| *weight >= 0.0));
            let white: Vec<f64> = set
                .iter()
                .map(|direction| if cosine { direction.theta.cos() } else { 1.0 })
                .collect();
            let dot = |values: &[f64]| {
                weights
                    .iter()
                    .zip(values)
                    .map(|(weight, value)| weight * value)
                    .sum::<f64>()
            };
            assert!(
                (dot(&white) - 1.0).abs() < 1e-12,
                "{name} {cosine}: white is {}",
                dot(&white)
            );
            // Anything else is integrated up to what the normalization takes out.
            let normalization = integrate(&triangulation, &white, cosine);
            let values: Vec<f64> = white
                .iter()
                .zip(&set)
                .map(|(white, at)| white * (1.0 + 0.5 * (at.phi * 3.0).cos() * at.theta))
                .collect();
            let expected = integrate(&triangulation, &values, cosine) / normalization;
            assert!(
                (dot(&values) - expected).abs() < 2e-4,
                "{name} {cosine}: {} {expected}",
                dot(&values)
            );
            // What is taken out is the error of interpolation: small where sampling is dense.
            let most = if name == "bonn81" || name == "ubo151" {
                0.02
            } else {
                0.8
            };
            assert!(
                (normalization - 1.0).abs() < most,
                "{name} {cosine}: {normalization}"
            );
        }
    }
}

#[test]
fn samples_at_the_horizon_with_the_cosine_included_stay_finite() {
    let set = rings(&[(90.0, 12, 0.0)]);
    let weights = Triangulation::new(&set).ambient_weights(&set, true);
    assert!(weights.iter().all(|weight| weight.is_finite() && *weight >= 0.0));
}

fn random_set() -> impl Strategy<Value = Vec<Direction>> {
    let free = prop::collection::vec((0.0..95.0f64, 0.0..360.0f64), 1..40).prop_map(|angles| {
        angles
            .into_iter()
            .map(|(theta, phi)| direction(theta, phi))
            .collect()
    });
    // Whole degrees, and few of them: many coincide, lie on lines and on circles.
    let coarse = prop::collection::vec((0u32..7, 0u32..8), 1..40).prop_map(|angles| {
        angles
            .into_iter()
            .map(|(theta, phi)| direction(f64::from(theta) * 15.0, f64::from(phi) * 45.0))
            .collect()
    });
    prop_oneof![free, coarse]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_set_interpolates(
        set in random_set(), points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 40),
    ) {
        let triangulation = Triangulation::new(&set);
        for (x, y) in points {
            let direction = from_parabolic([x, y]);
            let taps = triangulation.taps(direction);
            check_weights(&taps, set.len());
            if !taps.outside {
                let found = place(&triangulation, &taps);
                prop_assert!(distance(found, parabolic_from_direction(direction)) < 1e-7);
            }
        }
    }

    /// A small step changes the place that is interpolated, and so any function linear in it, by no more than
    /// the step; and the samples' weights by no more than steps over the smallest triangle allow.
    #[test]
    fn interpolation_is_continuous(set in random_set(), x in -1.0..1.0f64, y in -1.0..1.0f64, turn in 0.0..6.3f64) {
        let triangulation = Triangulation::new(&set);
        let step = 1e-6;
        let here = triangulation.taps(from_parabolic([x, y]));
        let there = triangulation.taps(from_parabolic([x + step * turn.cos(), y + step * turn.sin()]));
        let moved = distance(place(&triangulation, &here), place(&triangulation, &there));
        prop_assert!(moved < 4.0 * step, "moved by {moved}");
        prop_assert!((here.cosine - there.cosine).abs() < 8.0 * step);
    }
}

/// The same along lines across triangles, hull and horizon, for values that are not linear.
#[test]
fn values_are_continuous_along_lines() {
    for (name, set) in known_sets().into_iter().chain([("grid", grid(4))]) {
        let triangulation = Triangulation::new(&set);
        let value = |index: u32| f64::from(index * 7919 % 101) / 101.0;
        for turn in 0..16 {
            let (sin, cos) = (f64::from(turn) * 0.4).sin_cos();
            let mut before: Option<f64> = None;
            for step in -5000..5000 {
                let t = f64::from(step) / 4000.0;
                let direction = from_parabolic([t * cos - 0.1 * sin, t * sin + 0.1 * cos]);
                let now = interpolate(&triangulation.taps(direction), value);
                if let Some(before) = before {
                    assert!((now - before).abs() < 0.06, "{name}: {before} to {now} at {t}");
                }
                before = Some(now);
            }
        }
    }
}
