//! Small BTFs and naive f64 algebra for the tests.
#![allow(dead_code, reason = "each test program uses a part")]

use std::path::{Path, PathBuf};

use preprocess::npy::{BtfWriter, Dtype, Sampling};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tileset::Direction;

/// `count` different directions.
pub(crate) fn directions(count: usize) -> Vec<Direction> {
    (0..count)
        .map(|i| Direction {
            theta: if i == 0 { 0.0 } else { 0.3 + 0.01 * i as f64 },
            phi: 0.7 * i as f64 % 6.0,
        })
        .collect()
}

pub(crate) fn sampling(views: usize, lights: usize) -> Sampling {
    Sampling {
        views: directions(views),
        lights: directions(lights),
        wrap: true,
        cosine: false,
    }
}

/// Sizes of a BTF.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) views: usize,
    pub(crate) lights: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Shape {
    pub(crate) fn rows(self) -> usize {
        self.views * self.lights * 3
    }

    pub(crate) fn columns(self) -> usize {
        self.width * self.height
    }

    pub(crate) fn samples(self) -> usize {
        self.rows() * self.columns()
    }
}

/// Writes `samples` as NAME.npy and NAME.json.
pub(crate) fn write_btf(folder: &Path, shape: Shape, dtype: Dtype, samples: &[f32]) -> PathBuf {
    let path = folder.join("material.npy");
    let sampling = sampling(shape.views, shape.lights);
    let mut writer =
        BtfWriter::create(&path, sampling, shape.width as u32, shape.height as u32, dtype).unwrap();
    writer.write_f32(samples).unwrap();
    writer.finish().unwrap();
    path
}

/// Uniform in [-1, 1).
pub(crate) fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    move || random.next_u32() as i32 as f32 / 2f32.powi(31)
}

/// Samples like those of a material: a mean, smooth textures that fall off with their number, and noise.
pub(crate) fn material(shape: Shape, terms: usize, noise_size: f32, seed: u64) -> Vec<f32> {
    let mut random = noise(seed);
    let weights: Vec<Vec<f32>> = (0..shape.rows())
        .map(|_| (0..terms).map(|_| random()).collect())
        .collect();
    let phases: Vec<[f32; 2]> = (0..terms).map(|_| [random() * 3.0, random() * 3.0]).collect();
    let mut samples = Vec::with_capacity(shape.samples());
    for weights in &weights {
        for texel in 0..shape.columns() {
            let (x, y) = (texel % shape.width, texel / shape.width);
            let (x, y) = (x as f32 / shape.width as f32, y as f32 / shape.height as f32);
            let term = |c: usize| {
                let wave = std::f32::consts::TAU * ((1 + c % 3) as f32 * x + (1 + c / 3) as f32 * y);
                weights[c] / (1 + c) as f32 * (wave + phases[c][0]).sin()
            };
            samples.push(1.0 + (0..terms).map(term).sum::<f32>() + noise_size * random());
        }
    }
    samples
}

/// Singular values of the row-major `rows` × `columns` matrix, falling: one-sided Jacobi rotations in f64.
pub(crate) fn singular_values(samples: &[f64], rows: usize, columns: usize) -> Vec<f64> {
    // Orthogonalize the shorter side.
    let mut vectors: Vec<Vec<f64>> = if rows <= columns {
        samples.chunks(columns).map(<[f64]>::to_vec).collect()
    } else {
        (0..columns)
            .map(|c| (0..rows).map(|r| samples[r * columns + c]).collect())
            .collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for _ in 0..60 {
        let mut rotated = false;
        for i in 0..vectors.len() {
            for j in i + 1..vectors.len() {
                let (a, b, c) = (
                    dot(&vectors[i], &vectors[i]),
                    dot(&vectors[j], &vectors[j]),
                    dot(&vectors[i], &vectors[j]),
                );
                if c.abs() <= 1e-14 * (a * b).sqrt() || c == 0.0 {
                    continue;
                }
                rotated = true;
                let zeta = (b - a) / (2.0 * c);
                let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cos = 1.0 / t.hypot(1.0);
                let sin = cos * t;
                let (head, tail) = vectors.split_at_mut(j);
                for (x, y) in head[i].iter_mut().zip(&mut tail[0]) {
                    (*x, *y) = (cos * *x - sin * *y, sin * *x + cos * *y);
                }
            }
        }
        if !rotated {
            break;
        }
    }
    let mut values: Vec<f64> = vectors.iter().map(|v| dot(v, v).sqrt()).collect();
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// ‖samples − Σ_c u_c·v_c‖ / ‖samples‖ in f64; `u` `[component][row]`, `v` `[component][column]`.
pub(crate) fn product_error(samples: &[f64], rows: usize, columns: usize, u: &[f32], v: &[f32]) -> f64 {
    let components = u.len() / rows;
    let (mut energy, mut difference) = (0.0, 0.0);
    for row in 0..rows {
        for column in 0..columns {
            let product: f64 = (0..components)
                .map(|c| f64::from(u[c * rows + row]) * f64::from(v[c * columns + column]))
                .sum();
            let sample = samples[row * columns + column];
            energy += sample * sample;
            difference += (sample - product).powi(2);
        }
    }
    if energy > 0.0 {
        (difference / energy).sqrt()
    } else {
        difference.sqrt()
    }
}

/// What a file of this type makes of the samples.
pub(crate) fn stored(samples: &[f32], dtype: Dtype) -> Vec<f64> {
    samples
        .iter()
        .map(|&sample| match dtype {
            Dtype::F16 => half::f16::from_f32(sample).to_f64(),
            Dtype::F32 => sample.into(),
        })
        .collect()
}
