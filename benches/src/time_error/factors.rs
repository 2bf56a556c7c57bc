//! Passes of the factorization: seconds over error.

use std::time::Instant;

use preprocess::factorize::factorize;
use preprocess::{Btf, Factors, ProgressFn, Settings};

use super::rounds::alternate;
use super::{Family, Knob, Point};
use crate::Result;

/// Passes that are tried; none for what the program chooses.
const PASSES: [Option<u32>; 6] = [Some(1), Some(2), Some(3), None, Some(6), Some(8)];
/// Products of two numbers that the error of one setting may take: images are left out evenly where all would take more.
const MOST_PRODUCTS: f64 = 4e9;

/// Factorizes with several numbers of passes, by turns with the default.
///
/// # Errors
/// Those of the factorization and of reading samples.
pub(super) fn factors(
    btf: &Btf,
    settings: &Settings,
    rounds: usize,
    progress: ProgressFn<'_>,
) -> Result<Family> {
    let mut points = Vec::new();
    for passes in PASSES {
        let with = Settings { passes, ..*settings };
        let mut made = None;
        let times = alternate(rounds, |which| {
            let began = Instant::now();
            let factors = factorize(btf, if which { &with } else { settings }, progress)?;
            let ms = began.elapsed().as_secs_f64() * 1e3;
            if which {
                made = Some(factors);
            }
            Ok(ms)
        })?;
        let Some(made) = made else { continue };
        points.push(Point {
            setting: match passes {
                Some(passes) => passes.to_string(),
                None => format!("as it chooses: {}", made.statistics.passes),
            },
            ms: times.ms,
            ratio: times.ratio,
            noise: times.noise,
            work: made.statistics.product_flops,
            bytes: None,
            error: error(btf, &made)?,
            error_of_btf: None,
            beaten_by: None,
        });
    }
    let default = PASSES.iter().position(Option::is_none).unwrap_or(0);
    Ok(Family::new(Knob::Passes, default, points))
}

/// The relative error of the product: not what the factorization states, which is an estimate after one pass. Of as many images as are
/// affordable, evenly among all.
fn error(btf: &Btf, factors: &Factors) -> Result<f64> {
    let (rows, columns) = (btf.rows(), btf.columns());
    let products = rows as f64 * columns as f64 * factors.components as f64;
    let step = (products / MOST_PRODUCTS).ceil().max(1.0) as usize;
    let mut buffer = Vec::new();
    let mut product = vec![0f32; columns];
    let (mut squared, mut energy) = (0f64, 0f64);
    for image in (0..rows / 3).step_by(step) {
        let samples = btf.samples(image..image + 1, &mut buffer)?;
        for channel in 0..3 {
            product.fill(0.0);
            let row = 3 * image + channel;
            let terms = factors.u.chunks_exact(rows).zip(factors.v.chunks_exact(columns));
            for (u, v) in terms {
                let weight = u[row];
                product.iter_mut().zip(v).for_each(|(sum, v)| *sum += weight * v);
            }
            for (texel, product) in product.iter().enumerate() {
                let sample = samples.get(channel * columns + texel);
                squared += (sample - f64::from(*product)).powi(2);
                energy += sample * sample;
            }
        }
    }
    Ok(if energy > 0.0 {
        (squared / energy).sqrt()
    } else {
        0.0
    })
}
