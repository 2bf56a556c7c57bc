//! From a direction to the samples around it.

use super::{HULL_COSINE_FLOOR, START_CELLS, Triangulation};

/// Three samples and their weights, which are not negative and add up to one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps {
    /// Indices of the samples.
    pub indices: [u32; 3],
    /// Weights.
    pub weights: [f64; 3],
    /// Cosine of the polar angle of the direction that was interpolated: the asked one, or where that lies
    /// outside the convex hull of the samples, the hull's closest point in parabolic coordinates.
    pub cosine: f64,
    /// Whether the asked direction lies outside the hull.
    pub outside: bool,
}

impl Taps {
    /// What a sample that includes the light's cosine is multiplied with: one inside the hull, and outside
    /// cosθ / cosθ_hull, so that reflectance falls to zero at the horizon as the samples themselves do.
    ///
    /// `cosine` is cosθ of the asked direction; below the horizon the factor is 0. The divisor is at least
    /// [`HULL_COSINE_FLOOR`].
    pub fn horizon_scale(&self, cosine: f64) -> f64 {
        if self.outside {
            cosine.max(0.0) / self.cosine.max(HULL_COSINE_FLOOR)
        } else {
            1.0
        }
    }
}

/// Parabolic coordinates (x, y) / (1 + z) of a direction of any length.
///
/// z at or below 0 counts as the horizon; a zero or non-finite direction, and one straight down, as the
/// normal.
pub fn parabolic_from_direction([x, y, z]: [f64; 3]) -> [f64; 2] {
    // Scaled first, so that squares neither overflow nor vanish.
    let largest = x.abs().max(y.abs()).max(z.abs());
    if !(largest > 0.0 && largest.is_finite()) || x.is_nan() || y.is_nan() || z.is_nan() {
        return [0.0, 0.0];
    }
    let (x, y, z) = (x / largest, y / largest, (z / largest).max(0.0));
    let length = (x * x + y * y + z * z).sqrt();
    if length > 0.0 {
        [x / (length + z), y / (length + z)]
    } else {
        [0.0, 0.0]
    }
}

/// cosθ of a point in parabolic coordinates: (1 − |p|²) / (1 + |p|²).
pub fn cosine_from_parabolic([x, y]: [f64; 2]) -> f64 {
    let square = x * x + y * y;
    (1.0 - square) / (1.0 + square)
}

/// Barycentric coordinates down to which a point counts as inside: far above what rounding does to them in
/// the triangles that are kept, far below anything visible.
const INSIDE: f64 = -1e-10;

impl Triangulation {
    /// The taps for a direction; z at or below 0 counts as the horizon, a zero or non-finite one as the
    /// normal.
    pub fn taps(&self, direction: [f64; 3]) -> Taps {
        self.taps_at(parabolic_from_direction(direction))
    }

    /// The taps for a finite point in parabolic coordinates.
    pub(super) fn taps_at(&self, point: [f64; 2]) -> Taps {
        let inside = (!self.triangles.is_empty())
            .then(|| self.walk(self.start[start_cell(point)], point))
            .and_then(|(triangle, barycentric)| barycentric.map(|weights| (triangle, weights)));
        match inside {
            Some((triangle, weights)) => Taps {
                indices: self.triangles[triangle as usize].vertices,
                weights: weights.map(|weight| weight.max(0.0)),
                cosine: cosine_from_parabolic(point).max(0.0),
                outside: false,
            }
            .normalized(),
            None => self.closest_on_hull(point),
        }
    }

    /// Walks towards a point: the triangle that holds it and the barycentric coordinates there, or none and
    /// the triangle at the hull where the walk left.
    ///
    /// In a Delaunay triangulation such a walk cannot run in circles (De Floriani, Falcidieno, Nagy,
    /// Pienovi 1991). Rounding among nearly cocircular samples leaves triangulations that are Delaunay only
    /// nearly, so the steps are counted, and past the count all triangles are tried.
    pub(super) fn walk(&self, start: u32, point: [f64; 2]) -> (u32, Option<[f64; 3]>) {
        let mut triangle = start;
        for _ in 0..self.triangles.len() {
            let weights = self.barycentric(triangle, point);
            let (lowest, weight) = lowest(weights);
            if weight >= INSIDE {
                return (triangle, Some(weights));
            }
            match self.triangles[triangle as usize].neighbours[lowest] {
                u32::MAX => return (triangle, None),
                next => triangle = next,
            }
        }
        (0..self.triangles.len() as u32)
            .map(|triangle| (triangle, self.barycentric(triangle, point)))
            .max_by(|(_, a), (_, b)| lowest(*a).1.total_cmp(&lowest(*b).1))
            .map_or((start, None), |(triangle, weights)| {
                (triangle, (lowest(weights).1 >= INSIDE).then_some(weights))
            })
    }

    fn barycentric(&self, triangle: u32, point: [f64; 2]) -> [f64; 3] {
        let [a, b, c] = self.triangles[triangle as usize]
            .vertices
            .map(|vertex| self.points[vertex as usize]);
        let opposite = [
            doubled_area(point, b, c),
            doubled_area(a, point, c),
            doubled_area(a, b, point),
        ];
        let whole = doubled_area(a, b, c);
        opposite.map(|part| part / whole)
    }

    fn closest_on_hull(&self, point: [f64; 2]) -> Taps {
        let mut best = (f64::INFINITY, [0, 0], 0.0, [0.0, 0.0]);
        for &[from, to] in &self.hull {
            let (a, b) = (self.points[from as usize], self.points[to as usize]);
            let edge = [b[0] - a[0], b[1] - a[1]];
            let square = edge[0] * edge[0] + edge[1] * edge[1];
            let along = (point[0] - a[0]) * edge[0] + (point[1] - a[1]) * edge[1];
            let along = if square > 0.0 {
                (along / square).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let foot = [a[0] + along * edge[0], a[1] + along * edge[1]];
            let distance = (foot[0] - point[0]).powi(2) + (foot[1] - point[1]).powi(2);
            if distance < best.0 {
                best = (distance, [from, to], along, foot);
            }
        }
        let (distance, [from, to], along, foot) = best;
        Taps {
            indices: [from, to, to],
            weights: [1.0 - along, along, 0.0],
            // On the horizon rounding can leave it a little below zero.
            cosine: cosine_from_parabolic(foot).max(0.0),
            outside: distance > 0.0,
        }
    }
}

impl Taps {
    fn normalized(mut self) -> Self {
        let sum: f64 = self.weights.iter().sum();
        self.weights = self.weights.map(|weight| weight / sum);
        self
    }
}

/// Twice the signed area of a triangle: positive counter-clockwise.
pub(super) fn doubled_area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn lowest(weights: [f64; 3]) -> (usize, f64) {
    let mut at = 0;
    for i in 1..3 {
        if weights[i] < weights[at] {
            at = i;
        }
    }
    (at, weights[at])
}

/// Row-major index of a point's cell in the start grid.
fn start_cell(point: [f64; 2]) -> usize {
    let [x, y] = point.map(|at| (((at + 1.0) / 2.0 * START_CELLS as f64) as usize).min(START_CELLS - 1));
    y * START_CELLS + x
}
