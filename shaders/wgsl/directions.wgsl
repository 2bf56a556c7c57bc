// Interpolation between sampled directions, by Delaunay triangulation in parabolic coordinates.
//
// Source: Schwartz, Ruiters, Klein 2013, section 4; instead of rasterized lookup textures the triangulation
// itself is walked, which is exact and takes a few kilobytes. Twin of `engine::angular`.

#import frame
#import material

// Of all triangulations: points (2 words), triangles (3 vertices and the 3 triangles beyond the opposite edges),
// hull edges (2), and the grid of triangles from which to walk.
@group(1) @binding(1) var<storage, read> directions: array<u32>;

struct Taps {
    indices: vec3<u32>,
    weights: vec3<f32>,
    // Cosine of the polar angle of what was interpolated, and whether that is the hull's closest point.
    cosine: f32,
    outside: bool,
}

const START_CELLS: f32 = 32.0;
// A walk from a neighbouring cell crosses a few triangles; a walk that does not end stops here.
const WALK_STEPS: u32 = 64u;
// Rounding in barycentric coordinates; see `engine::angular`.
const TOLERANCE: f32 = -1e-5;

fn sample_point(table: Triangulation, index: u32) -> vec2<f32> {
    let word = table.points + index * 2u;
    return vec2(bitcast<f32>(directions[word]), bitcast<f32>(directions[word + 1u]));
}

fn cross2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// The closest point of the convex hull's boundary.
fn hull_taps(table: Triangulation, p: vec2<f32>) -> Taps {
    var best = Taps(vec3(0u), vec3(1.0, 0.0, 0.0), 1.0, true);
    var least = 1e30;
    for (var edge = 0u; edge < table.hull_count; edge++) {
        let i = directions[table.hull + edge * 2u];
        let j = directions[table.hull + edge * 2u + 1u];
        let a = sample_point(table, i);
        let ab = sample_point(table, j) - a;
        let t = clamp(dot(p - a, ab) / max(dot(ab, ab), 1e-30), 0.0, 1.0);
        let closest = a + t * ab;
        let distance = dot(p - closest, p - closest);
        if distance < least {
            least = distance;
            let square = dot(closest, closest);
            best = Taps(vec3(i, j, j), vec3(1.0 - t, t, 0.0), (1.0 - square) / (1.0 + square), true);
        }
    }
    return best;
}

// Parabolic coordinates of a unit direction in the tangent frame; below the horizon counts as the horizon.
fn parabolic(direction: vec3<f32>) -> vec2<f32> {
    let horizon = direction.xy / max(length(direction.xy), 1e-20);
    return select(direction.xy / (1.0 + max(direction.z, 0.0)), horizon, direction.z <= 0.0);
}

fn direction_taps(table: Triangulation, direction: vec3<f32>) -> Taps {
    let p = parabolic(direction);
    let cell = min(vec2<u32>(max((p + 1.0) * (0.5 * START_CELLS), vec2(0.0))), vec2(u32(START_CELLS) - 1u));
    if table.triangle_count == 0u {
        return hull_taps(table, p);
    }
    var triangle = directions[table.start + cell.y * u32(START_CELLS) + cell.x];
    for (var step = 0u; step < WALK_STEPS && triangle != NONE; step++) {
        let word = table.triangles + triangle * 6u;
        let vertices = vec3(directions[word], directions[word + 1u], directions[word + 2u]);
        let a = sample_point(table, vertices.x) - p;
        let b = sample_point(table, vertices.y) - p;
        let c = sample_point(table, vertices.z) - p;
        let areas = vec3(cross2(b, c), cross2(c, a), cross2(a, b));
        let weights = areas / (areas.x + areas.y + areas.z);
        let least = min(weights.x, min(weights.y, weights.z));
        if least >= TOLERANCE {
            let inside = max(weights, vec3(0.0));
            return Taps(vertices, inside / (inside.x + inside.y + inside.z), max(direction.z, 0.0), false);
        }
        let across = select(select(2u, 1u, weights.y == least), 0u, weights.x == least);
        triangle = directions[word + 3u + across];
    }
    return hull_taps(table, p);
}
