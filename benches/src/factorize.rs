//! One factorization, measured: to be called alternately with `peers/factorize_numpy.py`.

use std::path::Path;
use std::time::Instant;

use preprocess::{Btf, Factors, Settings, factorize::factorize, memory};
use serde::{Deserialize, Serialize};

use crate::Result;

/// How a BTF was factorized, and what that took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Factorized {
    /// Rows of the matrix: views × lights × 3.
    pub rows: usize,
    /// Columns of the matrix: texels.
    pub columns: usize,
    /// Terms.
    pub components: usize,
    /// Passes over the samples.
    pub passes: u32,
    /// Seconds from opening the file to scaled factors in memory.
    pub seconds: f64,
    /// Seconds of reading samples and converting them to f32: the mean over all threads.
    pub read_seconds: f64,
    /// Seconds of products with samples.
    pub product_seconds: f64,
    /// Seconds of random numbers and orthonormalization.
    pub basis_seconds: f64,
    /// Seconds of the small decomposition and of forming the factors.
    pub decompose_seconds: f64,
    /// Speed of the products with samples.
    pub gflops: f64,
    /// ‖B − U'ᵀV'‖ / ‖B‖.
    pub relative_error: f64,
    /// Largest resident set of the process so far, mapped files included; `None` where the system does not say.
    pub peak_rss_bytes: Option<u64>,
    /// Largest memory seen that no file backs; 0 where the system does not say.
    pub peak_anonymous_bytes: u64,
}

/// Opens and factorizes the BTF at `path`.
///
/// # Errors
/// Those of [`Btf::open`] and [`factorize()`].
pub fn run(
    path: &Path,
    settings: &Settings,
    progress: preprocess::ProgressFn<'_>,
) -> Result<(Btf, Factors, Factorized)> {
    let began = Instant::now();
    let btf = Btf::open(path)?;
    let factors = factorize(&btf, settings, progress)?;
    let seconds = began.elapsed().as_secs_f64();
    let statistics = factors.statistics;
    let factorized = Factorized {
        rows: factors.rows,
        columns: factors.columns,
        components: factors.components,
        passes: statistics.passes,
        seconds,
        read_seconds: statistics.read_seconds,
        product_seconds: statistics.product_seconds,
        basis_seconds: statistics.basis_seconds,
        decompose_seconds: statistics.decompose_seconds,
        gflops: statistics.product_flops / statistics.product_seconds.max(f64::MIN_POSITIVE) * 1e-9,
        relative_error: factors.relative_error(),
        peak_rss_bytes: memory::peak_resident_bytes(),
        peak_anonymous_bytes: statistics.peak_anonymous_bytes,
    };
    Ok((btf, factors, factorized))
}
