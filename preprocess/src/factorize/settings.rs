//! How to factorize, and where time and bytes went.

use super::Weights;
use crate::memory;

/// How to factorize.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Rank: number of terms, at least 1. Fewer result where the BTF has no more.
    pub components: u32,
    /// If given, the rank error that is enough: the subspace grows until it is met, and `components` is only the most
    /// that it may grow to (or what fits into memory, if that is less).
    pub enough: Option<Enough>,
    /// Width of the subspace beyond the rank in a run of two passes, and half of that in any other one, whose subspace is
    /// twice as wide. Halko et al. 2011, section 4.2, advise 5 to 10.
    pub oversampling: u32,
    /// Passes over the samples: 1 for a single one, whose error is estimated instead of exact; more passes, of fewer
    /// vectors each, find a better subspace. `None` for as many as are worth it, which usually are four (two where the
    /// rank turns out to be small, up to eight where the spectrum falls slowly), or as the goal needs.
    pub passes: Option<u32>,
    /// What the squares of the error are weighted by when the subspace is chosen.
    pub weights: Weights,
    /// Seed of the random start: the same seed gives the same bits on the same machine.
    pub seed: u64,
    /// Memory that may be used, in bytes.
    pub memory_bytes: u64,
}

/// A rank error that is enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Enough {
    /// Root mean square in the unit of the samples.
    Rms(f64),
    /// The same relative to the root mean square of the BTF.
    Relative(f64),
}

impl Enough {
    /// The sum of squares that may be left out of a BTF with so many samples, whose sum of squares is `energy`.
    pub(super) fn energy(self, samples: f64, energy: f64) -> f64 {
        match self {
            Enough::Rms(rms) => rms * rms * samples,
            Enough::Relative(relative) => relative * relative * energy,
        }
    }
}

impl Enough {
    /// The same for samples `scale` times as large.
    pub(super) fn of_scaled(self, scale: f64) -> Self {
        match self {
            Enough::Rms(rms) => Enough::Rms(rms * scale),
            Enough::Relative(_) => self,
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            components: 100,
            enough: None,
            oversampling: 10,
            passes: None,
            weights: Weights::Uniform,
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
    /// Seconds of orthonormalization.
    pub basis_seconds: f64,
    /// Seconds of the small decomposition and of forming the factors.
    pub decompose_seconds: f64,
    /// Seconds of saving what a later run continues from.
    pub save_seconds: f64,
    /// Bytes of samples read, all passes together.
    pub bytes_read: u64,
    /// Passes over the samples.
    pub passes: u32,
    /// Width of the subspace that the samples were projected on.
    pub subspace: usize,
    /// Rows that an earlier, interrupted run had done already, all passes together.
    pub resumed_rows: u64,
    /// Floating point operations of the products with samples.
    pub product_flops: f64,
    /// Rows in a block.
    pub block_rows: usize,
    /// Largest memory seen that no file backs, in bytes; 0 where the system does not say.
    pub peak_anonymous_bytes: u64,
}

impl Statistics {
    pub(super) fn sample_memory(&mut self) {
        self.peak_anonymous_bytes = self
            .peak_anonymous_bytes
            .max(memory::anonymous_bytes().unwrap_or(0));
    }
}
