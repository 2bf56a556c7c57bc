//! Orthonormal transform of a column along views, lights and colours, and back.

use super::basis::{self, Block};
use crate::{Direction, codec::texel::Texel};

/// Floats of one view and light: three colours of four components.
const TRIPLE: usize = 12;
/// Outputs that are summed together, in registers.
const LINES: usize = 4;

/// The bases of all three axes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Transform {
    pub views: Vec<Block>,
    pub lights: Vec<Block>,
    /// `[function][rgb]`, orthonormal.
    pub colours: [[f32; 3]; 3],
    pub view_count: usize,
    pub light_count: usize,
}

impl Transform {
    pub(super) fn new(views: &[Direction], lights: &[Direction], colours: [[f32; 3]; 3]) -> Self {
        let view_blocks = basis::blocks(views);
        // Most samplings have the same directions for both.
        let light_blocks = if lights == views {
            view_blocks.clone()
        } else {
            basis::blocks(lights)
        };
        Self {
            views: view_blocks,
            lights: light_blocks,
            colours,
            view_count: views.len(),
            light_count: lights.len(),
        }
    }

    /// Texels of a column.
    pub(super) fn texels(&self) -> usize {
        self.view_count * self.light_count * 3
    }

    /// `[view][light][rgb]` to coefficients in the same shape.
    pub(super) fn forward(&self, column: &[Texel]) -> Vec<Texel> {
        let line = self.light_count * 3;
        let coloured: Vec<Texel> = column
            .chunks_exact(3)
            .flat_map(|rgb| turn(rgb, &self.colours))
            .collect();
        let mut by_light = vec![Texel::default(); column.len()];
        for (from, to) in coloured.chunks_exact(line).zip(by_light.chunks_exact_mut(line)) {
            analyze(&self.lights, from, to, 3);
        }
        let mut coefficients = vec![Texel::default(); column.len()];
        analyze(&self.views, &by_light, &mut coefficients, line);
        coefficients
    }

    /// Coefficients to `[view][light][rgb]`. Functions whose coefficients are all zero cost no work.
    pub(super) fn inverse(&self, coefficients: &[Texel]) -> Vec<Texel> {
        let line = self.light_count * 3;
        let mut by_light = vec![Texel::default(); coefficients.len()];
        let mut used = vec![false; self.view_count];
        let transposed = transpose(&self.colours);
        let mut coloured = vec![Texel::default(); line];
        let mut used_lights = vec![false; self.light_count];
        for (view, (from, to)) in coefficients
            .chunks_exact(line)
            .zip(by_light.chunks_exact_mut(line))
            .enumerate()
        {
            for (light, (rgb, out)) in from.chunks_exact(3).zip(coloured.chunks_exact_mut(3)).enumerate() {
                used_lights[light] = rgb.iter().any(|texel| *texel != Texel::default());
                if used_lights[light] {
                    out.copy_from_slice(&turn(rgb, &transposed));
                }
            }
            used[view] = used_lights.contains(&true);
            if used[view] {
                synthesize(&self.lights, &coloured, &used_lights, to, 3);
            }
        }
        let mut column = vec![Texel::default(); coefficients.len()];
        synthesize(&self.views, &by_light, &used, &mut column, line);
        column
    }
}

fn transpose(matrix: &[[f32; 3]; 3]) -> [[f32; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[j][i]))
}

fn turn(rgb: &[Texel], matrix: &[[f32; 3]; 3]) -> [Texel; 3] {
    matrix.map(|row| rgb[0] * row[0] + rgb[1] * row[1] + rgb[2] * row[2])
}

/// `from[direction][texel]` to `to[function][texel]`, each of `width` texels.
fn analyze(blocks: &[Block], from: &[Texel], to: &mut [Texel], width: usize) {
    for block in blocks {
        let range = block.start * width..(block.start + block.len) * width;
        for (function, to) in block
            .functions
            .chunks_exact(block.len)
            .zip(to[range.clone()].chunks_exact_mut(width))
        {
            for (&weight, from) in function.iter().zip(from[range.clone()].chunks_exact(width)) {
                for (to, from) in to.iter_mut().zip(from) {
                    *to = *to + *from * weight;
                }
            }
        }
    }
}

/// `from[function][texel]` to `to[direction][texel]`, each of `width` texels, a multiple of three. Sums go from
/// the smoothest function to the roughest, over those that are used.
fn synthesize(blocks: &[Block], from: &[Texel], used: &[bool], to: &mut [Texel], width: usize) {
    for block in blocks {
        let used: Vec<usize> = (0..block.len).filter(|i| used[block.start + i]).collect();
        let range = block.start * width..(block.start + block.len) * width;
        let from: &[f32] = bytemuck::cast_slice(&from[range.clone()]);
        let to: &mut [f32] = bytemuck::cast_slice_mut(&mut to[range]);
        let width = width * 4;
        for start in (0..width).step_by(TRIPLE) {
            for first in (0..block.len).step_by(LINES) {
                let lines = LINES.min(block.len - first);
                let mut sums = [[0f32; TRIPLE]; LINES];
                for &function in &used {
                    let values: &[f32; TRIPLE] = from[function * width + start..][..TRIPLE]
                        .try_into()
                        .expect("of that length");
                    let weights = &block.functions[function * block.len + first..];
                    // A full set has a fixed length, which the compiler unrolls.
                    match weights.first_chunk::<LINES>() {
                        Some(weights) if lines == LINES => accumulate(&mut sums, values, weights),
                        _ => accumulate(&mut sums[..lines], values, &weights[..lines]),
                    }
                }
                for (line, sums) in sums[..lines].iter().enumerate() {
                    to[(first + line) * width + start..][..TRIPLE].copy_from_slice(sums);
                }
            }
        }
    }
}

#[inline(always)]
fn accumulate(sums: &mut [[f32; TRIPLE]], values: &[f32; TRIPLE], weights: &[f32]) {
    for (sums, &weight) in sums.iter_mut().zip(weights) {
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value * weight;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn directions(count: usize, theta: f64) -> Vec<Direction> {
        (0..count)
            .map(|i| Direction {
                theta: theta * i as f64 / count as f64,
                phi: 2.4 * i as f64 % 6.0,
            })
            .collect()
    }

    #[test]
    fn it_comes_back_keeps_lengths_and_skips_zeros() {
        let colours = [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]];
        for (views, lights) in [(1, 1), (1, 7), (5, 1), (13, 22), (3, 300)] {
            let transform = Transform::new(&directions(views, 1.3), &directions(lights, 1.5), colours);
            let column: Vec<Texel> = (0..transform.texels())
                .map(|i| {
                    Texel(std::array::from_fn(|c| {
                        ((i * 37 + c * 11) % 101) as f32 / 50.0 - 1.0
                    }))
                })
                .collect();
            let mut coefficients = transform.forward(&column);
            let energy = |texels: &[Texel]| -> f32 { texels.iter().flat_map(|t| t.0).map(|x| x * x).sum() };
            assert!((energy(&column) / energy(&coefficients) - 1.0).abs() < 1e-4);
            let difference = |a: &[Texel], b: &[Texel]| {
                energy(&a.iter().zip(b).map(|(&a, &b)| a - b).collect::<Vec<_>>()).sqrt()
            };
            let back = transform.inverse(&coefficients);
            assert!(difference(&back, &column) < 1e-5 * energy(&column).sqrt());
            // What is set to zero is exactly the error.
            let dropped: Vec<usize> = (0..coefficients.len()).filter(|i| i % 5 > 1).collect();
            let lost: Vec<Texel> = dropped
                .iter()
                .map(|&i| std::mem::take(&mut coefficients[i]))
                .collect();
            let lost = energy(&lost).sqrt();
            let back = transform.inverse(&coefficients);
            assert!((difference(&back, &column) - lost).abs() < 1e-4 * energy(&column).sqrt());
        }
    }

    #[test]
    fn a_smooth_function_needs_few_coefficients() {
        let directions: Vec<Direction> = (0..81)
            .map(|i| Direction {
                theta: 1.3 * (f64::from(i) / 81.0).sqrt(),
                phi: f64::from(i) * 2.399_963,
            })
            .collect();
        let transform = Transform::new(
            &directions,
            &directions,
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        );
        let column: Vec<Texel> = directions
            .iter()
            .flat_map(|view| {
                directions
                    .iter()
                    .map(|light| (view.to_vector(), light.to_vector()))
            })
            .flat_map(|(o, i)| {
                let cosine = o[0] * i[0] + o[1] * i[1] + o[2] * i[2];
                [Texel([1.0, cosine as f32, (cosine * cosine) as f32, i[2] as f32]); 3]
            })
            .collect();
        let mut coefficients = transform.forward(&column);
        let line = 3 * 81;
        for (at, texel) in coefficients.iter_mut().enumerate() {
            if at / line >= 24 || at % line / 3 >= 24 {
                *texel = Texel::default();
            }
        }
        let error: f32 = transform
            .inverse(&coefficients)
            .iter()
            .zip(&column)
            .map(|(&a, &b)| (a - b).0.iter().map(|x| x * x).sum::<f32>())
            .sum();
        assert!((error / (column.len() * 4) as f32).sqrt() < 0.01, "{error}");
    }
}
