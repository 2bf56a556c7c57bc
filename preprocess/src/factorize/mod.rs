//! Truncated singular value decomposition of a BTF that is far larger than memory.
//!
//! The BTF is the m×n matrix B with a row for every (view, light, rgb) and a column for every texel: the full
//! matrix factorization (FMF) of Schwartz, Ruiters, Klein 2013, section 3, equation 2. B is read in passes of
//! bulk products over blocks of rows (`subspace`); what the result leaves out is computed, not estimated.
//!
//! Factors are scaled so that errors can be read off: U' = √m·U has unit root mean square per component, and
//! with V' = V·Σ/√m a squared difference in V' at a texel is the mean squared error of reflectance there.

mod basis;
mod gram;
mod plan;
mod ritz;
mod stream;
mod subspace;

pub(crate) use gram::gram;

use std::time::Instant;

use faer::MatRef;

use crate::progress::ProgressFn;
use crate::{Btf, Error, Result, memory};
use stream::Stream;

/// Below this share of ‖B‖² the difference ‖B‖² − ‖B·Q‖² is too close to the rounding of the f32 products (about
/// 1e-7 of ‖B‖², measured in the tests) to be trusted to a percent: one more pass measures the residual itself.
const DIRECT_RESIDUAL_SHARE: f64 = 2e-5;

/// How to factorize.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Rank: number of terms, at least 1. Fewer result where the BTF has no more.
    pub components: u32,
    /// Width of the subspace beyond the rank; Halko et al. 2011, section 4.2, advise 5 to 10.
    pub oversampling: u32,
    /// Passes that sharpen the subspace before the one that projects on it. With 0 the subspace is random.
    pub power_iterations: u32,
    /// Seed of the random start: the same seed gives the same bits on the same machine.
    pub seed: u64,
    /// Memory that may be used, in bytes.
    pub memory_bytes: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            components: 100,
            oversampling: 10,
            power_iterations: 2,
            seed: 1,
            memory_bytes: memory::default_limit_bytes(),
        }
    }
}

/// Where time and bytes went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Seconds of reading samples and converting them to f32: the mean over all threads.
    pub read_seconds: f64,
    /// Seconds of products with blocks of samples.
    pub product_seconds: f64,
    /// Seconds of random numbers and orthonormalization.
    pub basis_seconds: f64,
    /// Seconds of the small decomposition and of forming the factors.
    pub decompose_seconds: f64,
    /// Bytes of samples read, all passes together.
    pub bytes_read: u64,
    /// Passes over the samples.
    pub passes: u32,
    /// Floating point operations of the products with samples.
    pub product_flops: f64,
    /// Rows in a block.
    pub block_rows: usize,
    /// Largest memory seen that no file backs, in bytes; 0 where the system does not say.
    pub peak_anonymous_bytes: u64,
}

impl Statistics {
    fn sample_memory(&mut self) {
        self.peak_anonymous_bytes = self
            .peak_anonymous_bytes
            .max(memory::anonymous_bytes().unwrap_or(0));
    }
}

/// A BTF as a sum of products: `ρ[row][texel] ≈ Σ_c u[c][row]·v[c][texel]`.
#[derive(Clone, Debug, Default)]
pub struct Factors {
    /// Rows of the matrix: views × lights × 3.
    pub rows: usize,
    /// Columns of the matrix: texels.
    pub columns: usize,
    /// Terms, at least one.
    pub components: usize,
    /// U', `[component][view][light][rgb]`; unit root mean square per component.
    pub u: Vec<f32>,
    /// V', `[component][y][x]`, in the unit of the BTF's samples.
    pub v: Vec<f32>,
    /// Singular values of B, falling.
    pub singular_values: Vec<f64>,
    /// ‖B‖², the sum of the squares of all samples.
    pub energy: f64,
    /// ‖B − U'ᵀV'‖², the sum of the squares of all that the factors leave out.
    pub residual_energy: f64,
    /// Mean of all red, green and blue samples.
    pub mean_rgb: [f64; 3],
    /// Where time and bytes went.
    pub statistics: Statistics,
}

impl Factors {
    /// Root mean square of the BTF's samples.
    pub fn btf_rms(&self) -> f64 {
        self.rms(self.energy)
    }

    /// Root mean square of what the factors leave out.
    pub fn rank_rms(&self) -> f64 {
        self.rms(self.residual_energy)
    }

    /// ‖B − U'ᵀV'‖ / ‖B‖; 0 for a BTF that is all zero.
    pub fn relative_error(&self) -> f64 {
        if self.energy > 0.0 {
            (self.residual_energy / self.energy).sqrt()
        } else {
            0.0
        }
    }

    /// The best factors of fewer terms: the first ones, for terms are orthogonal and sorted. The whole of it if it has
    /// no more than `components` terms.
    pub fn truncated(&self, components: usize) -> Factors {
        let kept = components.clamp(1, self.components.max(1)).min(self.components);
        let dropped: f64 = self.singular_values[kept..].iter().map(|value| value * value).sum();
        Factors {
            components: kept,
            u: self.u[..kept * self.rows].to_vec(),
            v: self.v[..kept * self.columns].to_vec(),
            singular_values: self.singular_values[..kept].to_vec(),
            residual_energy: self.residual_energy + dropped,
            ..*self
        }
    }

    fn rms(&self, energy: f64) -> f64 {
        let samples = self.rows as f64 * self.columns as f64;
        if samples > 0.0 {
            (energy / samples).sqrt()
        } else {
            0.0
        }
    }
}

/// Factorizes a BTF.
///
/// The error stated, [`Factors::relative_error`], is exact to about a percent down to 1e-7, where f32 ends: it is
/// √(‖B‖² − ‖B·Q‖²)/‖B‖ in f64, or measured by another pass where that difference would cancel.
///
/// # Errors
/// [`Error::Invalid`] for settings out of range, [`Error::OverBudget`], [`Error::BadSample`].
pub fn factorize(btf: &Btf, settings: &Settings, progress: ProgressFn<'_>) -> Result<Factors> {
    check(settings)?;
    let (rows, columns) = (btf.rows(), btf.columns());
    let smaller_side = rows.min(columns);
    let width = (settings.components as usize + settings.oversampling as usize).min(smaller_side);
    let block_rows = plan::block_rows(btf, settings.components, width, settings.memory_bytes)?;
    let mut stream = Stream::new(btf, block_rows, progress);

    // Q is stored transposed: its rows are contiguous.
    let mut basis_seconds = 0.0;
    let mut q = timed(&mut basis_seconds, || {
        basis::random_matrix(width, columns, settings.seed)
    });
    for number in 1..=settings.power_iterations {
        let z = subspace::power_iteration(&mut stream, number, q.transpose())?;
        drop(q);
        q = timed(&mut basis_seconds, || basis::orthonormal_rows(z, settings.seed))?;
    }
    let y = subspace::project(&mut stream, q.transpose())?;
    let mut decompose_seconds = 0.0;
    let ritz = timed(&mut decompose_seconds, || {
        ritz::ritz(q.transpose(), y, settings.components as usize)
    })?;
    drop(q);
    stream.statistics.sample_memory();

    let totals = stream.totals();
    let explained: f64 = ritz.singular_values.iter().map(|value| value * value).sum();
    let mut residual_energy = totals.energy - explained;
    if residual_energy < DIRECT_RESIDUAL_SHARE * totals.energy {
        let components = ritz.singular_values.len();
        let u = MatRef::from_column_major_slice(&ritz.u, rows, components);
        let v = MatRef::from_row_major_slice(&ritz.v, components, columns);
        residual_energy = subspace::residual(&mut stream, u, v)?;
    }
    let samples_per_channel = rows as f64 / 3.0 * columns as f64;
    Ok(Factors {
        rows,
        columns,
        components: ritz.singular_values.len(),
        u: ritz.u,
        v: ritz.v,
        singular_values: ritz.singular_values,
        energy: totals.energy,
        residual_energy,
        mean_rgb: totals.sums.map(|sum| sum / samples_per_channel),
        statistics: Statistics {
            basis_seconds,
            decompose_seconds,
            ..stream.statistics
        },
    })
}

fn check(settings: &Settings) -> Result<()> {
    if !(1..=tileset::MAX_COMPONENTS).contains(&settings.components) {
        return Err(Error::Invalid {
            what: "number of components",
            found: settings.components.to_string(),
            expected: "from 1 to 1024",
        });
    }
    Ok(())
}

/// Runs `work` and adds the seconds it takes.
fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = work();
    *seconds += began.elapsed().as_secs_f64();
    result
}
