//! What a run did, for people and scripts.

use serde::Serialize;

use crate::build::ArchiveBytes;
use crate::factorize::Weights;
use crate::goal::Goal;
use crate::source::RepairReport;

/// One stage's error, root mean square of reflectance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StageError {
    /// In the unit of the BTF's samples.
    pub rms: f64,
    /// Relative to the root mean square of the BTF.
    pub relative: f64,
}

impl StageError {
    pub(crate) fn new(rms: f64, whole: f64) -> Self {
        Self {
            rms,
            relative: if whole > 0.0 { rms / whole } else { 0.0 },
        }
    }
}

/// Errors with the squares of rows weighted; weights have a mean of 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WeightedError {
    /// Which weights.
    pub weights: Weights,
    /// What the truncated rank leaves out.
    pub rank: StageError,
    /// All of it, measured on the archive.
    pub measured: StageError,
}

/// Seconds by phase.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading samples and converting them to f32.
    pub read: f64,
    /// Products of samples with the subspace.
    pub product: f64,
    /// Orthonormalization.
    pub basis: f64,
    /// The small decomposition, and forming the factors.
    pub decompose: f64,
    /// Saving what an interrupted run continues from.
    pub save: f64,
    /// Coding pages and columns of the archive that was kept.
    pub encode: f64,
    /// Measuring what half floats and codec lost, when coding and on the archive.
    pub measure: f64,
    /// Writing the archive.
    pub write: f64,
    /// All of the run.
    pub total: f64,
}

/// Report of one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Program and version.
    pub generator: String,
    /// The BTF.
    pub input: String,
    /// The archive.
    pub output: String,
    /// Samples that were repaired, where that was asked for; those that an earlier, interrupted run read do not count.
    pub repairs: Option<RepairReport>,
    /// View directions.
    pub views: usize,
    /// Light directions.
    pub lights: usize,
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// What the archive had to meet; `None` where components and step were given.
    pub goal: Option<Goal>,
    /// Archives that were coded to meet it.
    pub trials: u32,
    /// Components asked for, where they were.
    pub components_wanted: Option<u32>,
    /// Components in the archive: fewer where the BTF has no more.
    pub components: u32,
    /// Predicted relative error of the exported product u·v: root of the sum of squares of all stages.
    pub relative_error: f64,
    /// Peak signal-to-noise ratio in decibels, of a peak of 1: see [`Goal::Psnr`]. `None` where there is no error.
    pub psnr: Option<f64>,
    /// Root mean square of the BTF's samples.
    pub btf_rms: f64,
    /// What the truncated rank leaves out: exact, but for a single pass.
    pub rank_error: StageError,
    /// Whether `rank_error` is an estimate, as after a single pass.
    pub rank_estimated: bool,
    /// What half floats lose in both factors.
    pub half_error: StageError,
    /// What the codec loses in the finest mip.
    pub codec_error: StageError,
    /// Root of the sum of squares of these three, as the manifest states it.
    pub total_error: StageError,
    /// The same measured on the archive as it was written and read again.
    pub measured_error: StageError,
    /// What the archive was compared with: "factors", whose own error is known exactly, or "btf".
    pub measured_against: &'static str,
    /// The same in the norm of the weights, if there were any.
    pub weighted: Option<WeightedError>,
    /// Quantizer step in root mean squares of the BTF.
    pub quality: f64,
    /// Quantizer step in units of the stored eigen-textures.
    pub quantizer_step: f64,
    /// Power of two by which decoded eigen-textures are multiplied.
    pub texture_scale: f64,
    /// Mean reflectance, linear RGB.
    pub mean_rgb: [f64; 3],
    /// Singular values of the BTF divided by √(rows·columns).
    pub singular_values: Vec<f64>,
    /// Seconds by phase.
    pub seconds: Seconds,
    /// Bytes of samples read, all passes together.
    pub bytes_read: u64,
    /// Passes over the samples.
    pub passes: u32,
    /// Width of the subspace that the samples were projected on.
    pub subspace: usize,
    /// Rows of all passes that an earlier, interrupted run had done.
    pub resumed_rows: u64,
    /// Rows of the matrix read at a time.
    pub block_rows: usize,
    /// Speed of the products with samples.
    pub gflops: f64,
    /// Memory that could be used.
    pub memory_limit_bytes: u64,
    /// Largest resident set of the process, mapped files included; `None` where the system does not say.
    pub peak_rss_bytes: Option<u64>,
    /// Largest memory seen between blocks that no file backs; 0 where the system does not say.
    pub peak_anonymous_bytes: u64,
    /// What the bytes of the archive are.
    pub archive: ArchiveBytes,
}
