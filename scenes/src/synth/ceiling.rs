//! Heights above which light arrives unhindered.
//!
//! Most of a surface is lit by most lights, and that a ray towards a light meets nothing takes as many steps to find out as it
//! needs to climb out of the relief. For each light a height map says where there is nothing to meet: the greatest, along the way to the
//! light, of the relief's height there less what a ray has climbed until then. Rays that start above it are not traced. It never
//! lies too low, so that all others find out for themselves, and nothing changes but the time.
//!
//! The idea is that of horizons (Max, Horizon Mapping: Shadows for Bump-Mapped Surfaces, 1988), for directions that are known.

use super::reflectance::Lights;
use super::volume::Volume;
use glam::Vec3;
use rayon::prelude::*;

/// Side of a square of the maps, in voxels; the grid's side is a multiple.
const SQUARE: usize = 2;
/// Stored units per voxel.
const UNITS: f32 = 32.0;

/// A map for each light, `[light][y][x]`.
pub(super) struct Ceilings {
    squares: usize,
    maps: Vec<Vec<u16>>,
}

impl Ceilings {
    pub(super) fn new(volume: &Volume, lights: &Lights) -> Ceilings {
        let squares = volume.side / SQUARE;
        let roof = roof(volume, squares);
        let maps = (0..lights.count)
            .into_par_iter()
            .map(|light| {
                let direction = lights.direction(light);
                if direction.z <= 0.0 {
                    return Vec::new();
                }
                let map = ceiling(&roof, squares, direction);
                // The cast saturates: such a height is above the grid.
                map.iter().map(|height| (height * UNITS).ceil() as u16).collect()
            })
            .collect();
        Ceilings { squares, maps }
    }

    /// Whether nothing is between `p`, with x and y in [0, side), and the light, which is above the horizon. If not, there may be something.
    #[inline(always)]
    pub(super) fn clear(&self, light: usize, p: Vec3) -> bool {
        let square = |v: f32| (v as usize / SQUARE).min(self.squares - 1);
        let height = self.maps[light][square(p.y) * self.squares + square(p.x)];
        height < u16::MAX && p.z * UNITS > f32::from(height)
    }
}

/// Height above each square over which there is only air.
fn roof(volume: &Volume, squares: usize) -> Vec<f32> {
    (0..squares * squares)
        .into_par_iter()
        .map(|at| {
            let (i, j) = (at % squares * SQUARE, at / squares * SQUARE);
            // Interpolation reads the samples around.
            let columns = (j..=j + SQUARE).flat_map(|j| (i..=i + SQUARE).map(move |i| (i, j)));
            columns.map(|(i, j)| volume.height(i, j)).fold(0.0, f32::max)
        })
        .collect()
}

/// The map for a direction that points up.
fn ceiling(roof: &[f32], squares: usize, direction: Vec3) -> Vec<f32> {
    let (lowest, highest) = roof.iter().fold((f32::MAX, 0f32), |(low, high), &height| {
        (low.min(height), high.max(height))
    });
    let mut ceiling = roof.to_vec();
    let across = direction.x.abs().max(direction.y.abs());
    if across < 1e-6 {
        return ceiling;
    }
    // Steps of one square along the longer axis.
    let step = Vec3::new(direction.x, direction.y, direction.z * SQUARE as f32) / across;
    for n in 0.. {
        let climbed = n as f32 * step.z;
        if climbed >= highest - lowest {
            break;
        }
        // Squares that a ray may pass in this step, from anywhere in its first one.
        let passed = |step: f32| {
            let (from, to) = (n as f32 * step, (n + 1) as f32 * step);
            from.min(to).floor() as isize..=(from.max(to) + 1.0).ceil() as isize - 1
        };
        for y in passed(step.y) {
            for x in passed(step.x) {
                raise(&mut ceiling, roof, squares, [x, y], climbed);
            }
        }
    }
    ceiling
}

/// Raises each square to what stands over the one that is `offset` away, less what was climbed.
fn raise(ceiling: &mut [f32], roof: &[f32], squares: usize, [x, y]: [isize; 2], climbed: f32) {
    let wrapped = |v: isize| v.rem_euclid(squares as isize) as usize;
    let (right, up) = (wrapped(x), wrapped(y));
    for (row, ceiling) in ceiling.chunks_exact_mut(squares).enumerate() {
        let roof = &roof[(row + up) % squares * squares..][..squares];
        let (first, last) = ceiling.split_at_mut(squares - right);
        for (ceiling, roof) in [(first, &roof[right..]), (last, &roof[..right])] {
            for (ceiling, roof) in ceiling.iter_mut().zip(roof) {
                *ceiling = ceiling.max(roof - climbed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::materials::find;
    use super::*;

    #[test]
    fn what_is_clear_is_really_clear_and_much_is() {
        for name in ["cloth", "gravel", "sponge"] {
            let material = find(name)
                .unwrap()
                .make(5, 1.0 / 128.0, &crate::synth::Style::default());
            let volume = Volume::build(material.as_solid(), 128);
            let directions = [
                Vec3::Z,
                Vec3::new(0.5, 0.2, 0.6),
                Vec3::new(-0.9, 0.1, 0.3),
                Vec3::new(0.3, -0.9, 0.4),
                Vec3::new(0.5, 0.5, -0.1),
            ];
            let lights = Lights::new(&directions.map(Vec3::normalize));
            let ceilings = Ceilings::new(&volume, &lights);
            assert!(ceilings.maps[4].is_empty(), "never asked for");
            let (mut clear, mut free) = (0, 0);
            for n in 0..4000 {
                let start = Vec3::new((n * 37 % 1280) as f32 * 0.1, (n / 32) as f32, volume.top);
                let Some(hit) = volume.march(start, Vec3::NEG_Z) else {
                    continue;
                };
                let p = volume.wrap(hit + Vec3::Z);
                for light in 0..4 {
                    let escapes = volume.march(p, lights.direction(light)).is_none();
                    free += usize::from(escapes);
                    if ceilings.clear(light, p) {
                        assert!(escapes, "{name}: {p} towards light {light}");
                        clear += 1;
                    }
                }
            }
            assert!(5 * clear > free, "{name}: {clear} of {free}");
        }
    }
}
