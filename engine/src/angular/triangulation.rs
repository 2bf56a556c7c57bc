//! Triangles over the samples, for any set of samples.

use std::collections::HashMap;

use tileset::Direction;

use super::{locate::doubled_area, parabolic_from_direction};

/// One triangle, for CPU and GPU alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Samples, counter-clockwise in parabolic coordinates.
    pub vertices: [u32; 3],
    /// Triangles beyond the edges opposite to each vertex; `u32::MAX` at the hull.
    pub neighbours: [u32; 3],
}

/// The triangulated directions of one side (views or lights) of a BTF.
#[derive(Clone, Debug)]
pub struct Triangulation {
    /// Parabolic coordinates (x, y) / (1 + z) of the samples.
    pub points: Vec<[f64; 2]>,
    /// Triangles; none if all samples lie on one line.
    pub triangles: Vec<Triangle>,
    /// Edges of the convex hull, counter-clockwise; for samples on one line its segments, for one sample
    /// (0, 0).
    pub hull: Vec<[u32; 2]>,
    /// For each cell of a [`START_CELLS`]² grid over [-1, 1]² the triangle from which to walk, row by row
    /// from y = -1; `u32::MAX` where there are no triangles.
    pub start: Vec<u32>,
}

/// Cells of the start grid along one side.
pub const START_CELLS: usize = 32;

/// Height of a triangle relative to its longest edge below which it is dropped from the hull's rim: its
/// barycentric coordinates would be rounding noise, and samples so close to a line are on it.
const SLIVER: f64 = 1e-9;

/// Distance below which samples lie at the same place: azimuths 0 and 2π, or any azimuth at the normal.
const SAME: f64 = 1e-9;

impl Triangulation {
    /// Triangulates the directions. At least one is needed: for none, there is one sample at the normal.
    ///
    /// Directions below the horizon count as the horizon, and of samples at the same place one is used.
    pub fn new(directions: &[Direction]) -> Self {
        let mut points: Vec<_> = directions
            .iter()
            .map(|direction| parabolic_from_direction(direction.to_vector()))
            .collect();
        if points.is_empty() {
            points.push([0.0, 0.0]);
        }
        let distinct = distinct(&points);
        let sites: Vec<_> = distinct
            .iter()
            .map(|&at| delaunator::Point::from(points[at as usize]))
            .collect();
        let delaunay = delaunator::triangulate(&sites);
        let mut vertices: Vec<[u32; 3]> = delaunay
            .triangles
            .chunks_exact(3)
            .map(|corners| [distinct[corners[0]], distinct[corners[1]], distinct[corners[2]]])
            .map(|[a, b, c]| {
                let [p, q, r] = [a, b, c].map(|vertex| points[vertex as usize]);
                if doubled_area(p, q, r) < 0.0 {
                    [a, c, b]
                } else {
                    [a, b, c]
                }
            })
            .collect();
        peel_slivers(&points, &mut vertices);
        let triangles = connect(&vertices);
        let hull = if triangles.is_empty() {
            segments(&points, distinct)
        } else {
            hull(&triangles)
        };
        let mut triangulation = Self {
            points,
            triangles,
            hull,
            start: vec![u32::MAX; START_CELLS * START_CELLS],
        };
        triangulation.fill_start();
        triangulation
    }

    fn fill_start(&mut self) {
        if self.triangles.is_empty() {
            return;
        }
        let centre = |cell: usize| (cell as f64 + 0.5) / START_CELLS as f64 * 2.0 - 1.0;
        let mut triangle = 0;
        for cell in 0..self.start.len() {
            let point = [centre(cell % START_CELLS), centre(cell / START_CELLS)];
            triangle = self.walk(triangle, point).0;
            self.start[cell] = triangle;
        }
    }
}

/// Drops flat triangles that touch the hull, from outside inwards.
fn peel_slivers(points: &[[f64; 2]], vertices: &mut Vec<[u32; 3]>) {
    loop {
        let triangles = connect(vertices);
        let before = vertices.len();
        let mut at = 0;
        vertices.retain(|_| {
            let triangle = &triangles[at];
            at += 1;
            !(triangle.neighbours.contains(&u32::MAX) && is_sliver(points, triangle.vertices))
        });
        if vertices.len() == before {
            return;
        }
    }
}

fn is_sliver(points: &[[f64; 2]], vertices: [u32; 3]) -> bool {
    let [a, b, c] = vertices.map(|vertex| points[vertex as usize]);
    let longest = square_distance(a, b)
        .max(square_distance(b, c))
        .max(square_distance(c, a));
    doubled_area(a, b, c) <= SLIVER * longest
}

fn connect(vertices: &[[u32; 3]]) -> Vec<Triangle> {
    // Edge opposite to corner k runs from corner k+1 to k+2; its twin in the neighbour runs the other way.
    let edge = |[a, b, c]: [u32; 3], k: usize| [[b, c], [c, a], [a, b]][k];
    let mut owner = HashMap::new();
    for (triangle, &corners) in vertices.iter().enumerate() {
        for k in 0..3 {
            owner.insert(edge(corners, k), triangle as u32);
        }
    }
    let beyond = |[from, to]: [u32; 2]| owner.get(&[to, from]).copied().unwrap_or(u32::MAX);
    vertices
        .iter()
        .map(|&corners| Triangle {
            vertices: corners,
            neighbours: [0, 1, 2].map(|k| beyond(edge(corners, k))),
        })
        .collect()
}

/// Edges without a neighbour, each followed by the one that begins where it ends.
fn hull(triangles: &[Triangle]) -> Vec<[u32; 2]> {
    let mut edges = Vec::new();
    for Triangle {
        vertices: [a, b, c],
        neighbours,
    } in triangles
    {
        for (edge, beyond) in [[*b, *c], [*c, *a], [*a, *b]].into_iter().zip(neighbours) {
            if *beyond == u32::MAX {
                edges.push(edge);
            }
        }
    }
    for at in 1..edges.len() {
        let end = edges[at - 1][1];
        if let Some(next) = (at..edges.len()).find(|&next| edges[next][0] == end) {
            edges.swap(at, next);
        }
    }
    edges
}

/// The segments between samples that lie on one line, in order along it; (0, 0) for a single place.
fn segments(points: &[[f64; 2]], mut distinct: Vec<u32>) -> Vec<[u32; 2]> {
    // The sample farthest from any one of them is an end of the line.
    let distance = |a: u32, b: u32| square_distance(points[a as usize], points[b as usize]);
    let first = distinct[0];
    let end = distinct
        .iter()
        .copied()
        .max_by(|&a, &b| distance(a, first).total_cmp(&distance(b, first)));
    distinct
        .sort_by(|&a, &b| distance(a, end.unwrap_or(first)).total_cmp(&distance(b, end.unwrap_or(first))));
    if distinct.len() == 1 {
        return vec![[first, first]];
    }
    distinct.windows(2).map(|pair| [pair[0], pair[1]]).collect()
}

/// Indices of the samples without those that lie where an earlier one does.
fn distinct(points: &[[f64; 2]]) -> Vec<u32> {
    let mut distinct: Vec<u32> = Vec::new();
    for (at, &point) in points.iter().enumerate() {
        let same = |&other: &u32| square_distance(points[other as usize], point) < SAME * SAME;
        if !distinct.iter().any(same) {
            distinct.push(at as u32);
        }
    }
    distinct
}

fn square_distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}
