//! Periodic noise: gradient noise, its sums over octaves, and cells around scattered points.
//!
//! Coordinates are in lattice units, with an integer period per axis, so that every pattern closes seamlessly.
//! Sources: Perlin, Improving Noise, 2002; Worley, A Cellular Texture Basis Function, 1996.

use super::random::{Random, mix, unit};
use glam::{Vec2, Vec3, vec2};

/// A source of noise; two with different keys are independent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Noise {
    key: u32,
}

/// What cellular noise knows at a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Distance to the nearest scattered point.
    pub(super) nearest: f32,
    /// Distance to the edge between the two nearest points' cells.
    pub(super) edge: f32,
    /// Random bits of the nearest point.
    pub(super) id: u32,
}

impl Noise {
    pub(super) fn new(random: &mut Random) -> Noise {
        Noise { key: random.bits() }
    }

    /// An independent source derived from this one.
    pub(super) fn derive(self, index: u32) -> Noise {
        Noise {
            key: mix(self.key ^ mix(index.wrapping_add(0x9e37_79b9))),
        }
    }

    /// Random bits of a lattice point.
    pub(super) fn bits(self, x: i32, y: i32, z: i32) -> u32 {
        let h = mix(self.key ^ (x as u32).wrapping_mul(0x9e37_79b1));
        let h = mix(h ^ (y as u32).wrapping_mul(0x85eb_ca77));
        mix(h ^ (z as u32).wrapping_mul(0xc2b2_ae3d))
    }

    /// Gradient noise in two dimensions, about [-1, 1].
    pub(super) fn plane(self, p: Vec2, period: [i32; 2]) -> f32 {
        self.space(p.extend(0.5), period)
    }

    /// Gradient noise in three dimensions, about [-1, 1]; not periodic in z.
    pub(super) fn space(self, p: Vec3, period: [i32; 2]) -> f32 {
        let floor = p.floor();
        let f = p - floor;
        let (x, y, z) = (floor.x as i32, floor.y as i32, floor.z as i32);
        let xs = [x.rem_euclid(period[0]), (x + 1).rem_euclid(period[0])];
        let ys = [y.rem_euclid(period[1]), (y + 1).rem_euclid(period[1])];
        let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
        let mut sum = 0.0;
        for corner in 0..8 {
            let (i, j, k) = (corner & 1, corner >> 1 & 1, corner >> 2);
            let offset = f - Vec3::new(i as f32, j as f32, k as f32);
            let weight = |axis: f32, upper: usize| if upper == 1 { axis } else { 1.0 - axis };
            let w = weight(fade.x, i) * weight(fade.y, j) * weight(fade.z, k);
            sum += w * slope(self.bits(xs[i], ys[j], z + k as i32), offset);
        }
        sum
    }

    /// Sum of `octaves` of noise with halving amplitude, about [-1, 1]; `p` covers the patch as [0, 1).
    pub(super) fn fractal(self, p: Vec3, frequency: [i32; 2], octaves: u32) -> f32 {
        let (mut sum, mut amplitude, mut total) = (0.0, 1.0, 0.0);
        for octave in 0..octaves {
            let period = [frequency[0] << octave, frequency[1] << octave];
            let scale = Vec3::new(
                period[0] as f32,
                period[1] as f32,
                period[0].max(period[1]) as f32,
            );
            sum += amplitude * self.derive(octave).space(p * scale, period);
            total += amplitude;
            amplitude *= 0.5;
        }
        1.4 * sum / total
    }

    /// Cells around one scattered point per lattice square.
    pub(super) fn cells(self, p: Vec2, period: [i32; 2]) -> Cell {
        let base = p.floor();
        let mut best = (f32::MAX, Vec2::ZERO, 0);
        let mut points = [(Vec2::ZERO, 0); 25];
        for (n, point) in points.iter_mut().enumerate() {
            let (x, y) = (base.x as i32 + n as i32 % 5 - 2, base.y as i32 + n as i32 / 5 - 2);
            let id = self.bits(x.rem_euclid(period[0]), y.rem_euclid(period[1]), 0);
            let jitter = vec2(unit(id), unit(mix(id))) * 0.84 + 0.08;
            *point = (vec2(x as f32, y as f32) + jitter - p, id);
            let squared = point.0.length_squared();
            if squared < best.0 {
                best = (squared, point.0, id);
            }
        }
        let edge = points
            .iter()
            .filter(|other| other.1 != best.2)
            .map(|&(other, _)| {
                let across = other - best.1;
                (other + best.1).dot(across) * 0.5 / across.length().max(1e-6)
            });
        Cell {
            nearest: best.0.sqrt(),
            edge: edge.fold(f32::MAX, f32::min).max(0.0),
            id: best.2,
        }
    }
}

/// Dot product with one of Perlin's twelve gradients (sixteen cases, four of them twice).
fn slope(bits: u32, p: Vec3) -> f32 {
    let u = if bits & 8 == 0 { p.x } else { p.y };
    let v = match bits & 15 {
        0..=3 => p.y,
        12 | 14 => p.x,
        _ => p.z,
    };
    (if bits & 16 == 0 { u } else { -u }) + (if bits & 32 == 0 { v } else { -v })
}

/// Cubic step from 0 at `low` to 1 at `high`.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    fn noise() -> Noise {
        Noise::new(&mut Random::new(7, "noise"))
    }

    #[test]
    fn periodic() {
        for i in 0..50 {
            let p = vec3(i as f32 * 0.37, i as f32 * 0.11, i as f32 * 0.05);
            let moved = p + vec3(6.0, -5.0, 0.0);
            assert!((noise().space(p, [6, 5]) - noise().space(moved, [6, 5])).abs() < 1e-4);
            let (a, b) = (
                noise().cells(p.truncate(), [6, 5]),
                noise().cells(moved.truncate(), [6, 5]),
            );
            assert!((a.edge - b.edge).abs() < 1e-4 && a.id == b.id);
        }
    }

    #[test]
    fn balanced_and_bounded() {
        let values: Vec<f32> = (0..4000)
            .map(|i| noise().fractal(vec3(i as f32 * 0.0137, i as f32 * 0.0071, 0.3), [8, 8], 4))
            .collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!(mean.abs() < 0.1, "{mean}");
        assert!(values.iter().all(|v| v.abs() < 1.6));
        assert!(values.iter().any(|v| *v > 0.4) && values.iter().any(|v| *v < -0.4));
    }
}
