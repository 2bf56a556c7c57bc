//! Samples of the cases, from seeds: the same on every platform up to the rounding of f64.

use faer::Mat;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::Shape;

/// Uniform in [-1, 1).
pub(super) fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    move || f64::from(random.next_u32() as i32) * 0.5f64.powi(31)
}

/// Like a measured material: a mean of 1, twelve smooth textures that fall off with their number, and 1 % of noise.
pub(super) fn material(shape: Shape) -> Vec<f32> {
    const TERMS: usize = 12;
    let mut random = noise(1);
    let phases: Vec<f64> = (0..TERMS).map(|_| 3.0 * random()).collect();
    let texture = |c: usize, texel: usize| {
        let (x, y) = (texel % shape.width, texel / shape.width);
        let (x, y) = (x as f64 / shape.width as f64, y as f64 / shape.height as f64);
        let turns = (1 + c % 3) as f64 * x + (1 + c / 3) as f64 * y;
        (std::f64::consts::TAU * turns + phases[c]).sin()
    };
    let textures: Vec<f64> = (0..TERMS)
        .flat_map(|c| (0..shape.columns()).map(move |texel| (c, texel)))
        .map(|(c, texel)| texture(c, texel))
        .collect();
    let mut samples = Vec::with_capacity(shape.samples());
    for _ in 0..shape.rows() {
        let weights: Vec<f64> = (0..TERMS).map(|c| 0.5 * random() / (1 + c) as f64).collect();
        for texel in 0..shape.columns() {
            let sum: f64 = (0..TERMS)
                .map(|c| weights[c] * textures[c * shape.columns() + texel])
                .sum();
            samples.push((1.0 + sum + 0.01 * random()) as f32);
        }
    }
    samples
}

/// A matrix with these singular values and random singular vectors, in f64 rounded to f32 at the end; scaled so that a
/// singular value is its component's root mean square.
pub(super) fn with_spectrum(shape: Shape, singular_values: &[f64]) -> Vec<f32> {
    let (rows, columns, rank) = (shape.rows(), shape.columns(), singular_values.len());
    let mut random = noise(2);
    let u = Mat::from_fn(rows, rank, |_, _| random()).qr().compute_thin_Q();
    let v = Mat::from_fn(columns, rank, |_, _| random()).qr().compute_thin_Q();
    let scale = (shape.samples() as f64).sqrt();
    let u = Mat::from_fn(rows, rank, |row, c| u[(row, c)] * singular_values[c] * scale);
    let product = u * v.transpose();
    (0..rows)
        .flat_map(|row| (0..columns).map(move |column| (row, column)))
        .map(|at| product[at] as f32)
        .collect()
}
