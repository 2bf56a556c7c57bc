//! The judge: products formed in f64.

use std::path::Path;

use faer::{Mat, MatRef};
use half::f16;
use preprocess::{Btf, Factors, build, export};
use serde::Serialize;

use super::Input;
use crate::{Error, Result, npy};

/// What came out. Errors are relative to ‖B‖, or absolute where B is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Measured {
    /// Components asked for.
    pub components: usize,
    /// Components found.
    pub rank: usize,
    /// Largest entry of |UᵀU/m − I|.
    pub u_defect: f64,
    /// Largest entry of |VᵀV − I| for V without its singular values.
    pub v_defect: f64,
    /// Error of the best product of `components` terms, from an f64 singular value decomposition.
    pub optimum: f64,
    /// Error of the product of the factors.
    pub rank_true: f64,
    /// The same as the factorization states it.
    pub rank_stated: f64,
    /// What rounding both factors to half floats changes in their product.
    pub half_true: f64,
    /// The same as the archive states it.
    pub half_stated: f64,
    /// What the codec changes, as the archive states it.
    pub codec_stated: f64,
    /// Quantizer step of the pages.
    pub step: f64,
    /// Quantizer step of the eigen-ABRDFs, in what it does to reflectance.
    pub column_step: f64,
    /// Error of the product of the decoded archive.
    pub total_true: f64,
    /// The same as the archive states it.
    pub total_stated: f64,
    /// What was repaired, if anything.
    pub repair: Option<RepairMeasured>,
}

/// What was repaired.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RepairMeasured {
    /// Samples that were counted.
    pub samples: u64,
    /// Samples that were harmed.
    pub harmed: u64,
    /// Images in which they were.
    pub images: u64,
    /// Difference to the samples before they were harmed.
    pub loss: f64,
}

/// Quantizer step, in root mean squares of the BTF.
const QUALITY: f64 = build::DEFAULT_QUALITY;

/// Measures `factors` of a BTF with these samples, and the archive that is made of them in `folder`.
///
/// # Errors
/// [`Error::Preprocess`]; [`Error::Archive`]; [`Error::Kept`] and [`Error::Io`] for what was exported.
pub fn measure(
    input: &Input,
    btf: &Btf,
    factors: &Factors,
    components: usize,
    folder: &Path,
) -> Result<Measured> {
    let (rows, columns, rank) = (factors.rows, factors.columns, factors.components);
    let b = Mat::from_fn(rows, columns, |row, column| {
        f64::from(input.samples[row * columns + column])
    });
    let norm = b.norm_l2();
    let relative = |norm_of_error: f64| {
        if norm > 0.0 {
            norm_of_error / norm
        } else {
            norm_of_error
        }
    };
    let u = widened(&factors.u, rows);
    let v = widened(&factors.v, columns);
    let product = &u * v.transpose();

    let archive = folder.join("case.bsvtf");
    let built = build::build(btf, factors, QUALITY, &archive, &|_| ())?;
    let manifest = &built.manifest;
    let ledger = manifest.errors;
    let rms_relative = |rms: f64| {
        if ledger.btf_rms > 0.0 {
            rms / ledger.btf_rms
        } else {
            rms
        }
    };
    export(&archive, folder, &|_| ())?;
    let shape = input.shape;
    let decoded_u = npy::read_f32(&folder.join("u.npy"), &[rank, shape.views, shape.lights, 3])?;
    let decoded_v = npy::read_f32(&folder.join("v.npy"), &[rank, shape.height, shape.width])?;
    let decoded = widened(&decoded_u, rows) * widened(&decoded_v, columns).transpose();

    let scale = manifest.texture_scale;
    let half = |value: f64| f16::from_f64(value).to_f64();
    let half_u = Mat::from_fn(rows, rank, |row, c| half(u[(row, c)]));
    let half_v = Mat::from_fn(columns, rank, |column, c| half(v[(column, c)] / scale) * scale);
    let in_halves = half_u * half_v.transpose();

    let largest = factors
        .v
        .iter()
        .fold(0f32, |largest, value| largest.max(value.abs()));
    // The step that was asked for, but no finer than what a coefficient of 16 times the largest value can be
    // counted in, 2²² steps.
    let step = QUALITY.max(rms_relative(f64::from(largest) * 16.0 / f64::from(1 << 22)));
    Ok(Measured {
        components,
        rank,
        u_defect: if norm > 0.0 { u_defect(&u) } else { 0.0 },
        v_defect: v_defect(&v, &factors.singular_values, rows),
        optimum: relative(optimum(&b, components)?),
        rank_true: relative((&b - &product).norm_l2()),
        rank_stated: factors.relative_error(),
        half_true: relative((&product - &in_halves).norm_l2()),
        half_stated: rms_relative(ledger.half_rms),
        codec_stated: rms_relative(ledger.codec_rms),
        step,
        // Of equal slope of rate and distortion, so larger the fewer texels share the eigen-ABRDFs.
        column_step: step * (rows as f64 / columns as f64).sqrt(),
        total_true: relative((&b - &decoded).norm_l2()),
        total_stated: rms_relative(ledger.measured_rms),
        repair: None,
    })
}

/// `[component][index]` of f32 as a matrix of f64 with a column for each component.
fn widened(factor: &[f32], length: usize) -> Mat<f64> {
    let components = factor.len() / length;
    Mat::from_fn(length, components, |index, c| {
        f64::from(factor[c * length + index])
    })
}

/// The error of the best product of `components` terms: root of the sum of squares of the singular values beyond.
fn optimum(b: &Mat<f64>, components: usize) -> Result<f64> {
    let singular_values = b.singular_values().map_err(|_| {
        Error::Preprocess(preprocess::Error::NotConverged(
            "f64 singular value decomposition",
        ))
    })?;
    let beyond = singular_values.iter().skip(components);
    Ok(beyond.map(|value| value * value).sum::<f64>().sqrt())
}

fn u_defect(u: &Mat<f64>) -> f64 {
    let rows = u.nrows() as f64;
    defect(u.as_ref(), |_, _| rows)
}

/// V' = V·Σ/√m, so the product of two columns is that of their singular values, over m. Columns of zero singular values
/// are zero, and have no direction.
fn v_defect(v: &Mat<f64>, singular_values: &[f64], rows: usize) -> f64 {
    let rank = singular_values.iter().take_while(|&&value| value > 0.0).count();
    defect(v.subcols(0, rank), |i, j| {
        singular_values[i] * singular_values[j] / rows as f64
    })
}

/// Largest deviation from the identity of the Gram matrix of `x`, each entry divided by its scale.
fn defect(x: MatRef<'_, f64>, scale: impl Fn(usize, usize) -> f64) -> f64 {
    let gram = x.transpose() * x;
    let mut worst = 0f64;
    for j in 0..gram.ncols() {
        for i in 0..gram.nrows() {
            let deviation = (gram[(i, j)] / scale(i, j) - f64::from(u8::from(i == j))).abs();
            // `max` would pass over NaN.
            worst = if deviation <= worst { worst } else { deviation };
        }
    }
    worst
}
