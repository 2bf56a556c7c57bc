//! What a run did, for people and scripts.

use serde::Serialize;

use crate::build::ArchiveBytes;

/// One stage's error, root mean square of reflectance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StageError {
    /// In the unit of the BTF's samples.
    pub rms: f64,
    /// Relative to the root mean square of the BTF.
    pub relative: f64,
}

/// Seconds by phase.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading samples and converting them to f32.
    pub read: f64,
    /// Products of samples with the subspace.
    pub product: f64,
    /// Random numbers and orthonormalization.
    pub basis: f64,
    /// The small decomposition, and forming the factors.
    pub decompose: f64,
    /// Coding pages and columns.
    pub encode: f64,
    /// Measuring what half floats and codec lost.
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
    /// View directions.
    pub views: usize,
    /// Light directions.
    pub lights: usize,
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Components asked for.
    pub components_wanted: u32,
    /// Components in the archive: fewer where the BTF has no more.
    pub components: u32,
    /// Predicted relative error of the exported product u·v: root of the sum of squares of all stages.
    pub relative_error: f64,
    /// Root mean square of the BTF's samples.
    pub btf_rms: f64,
    /// What the truncated rank leaves out, exactly.
    pub rank_error: StageError,
    /// What half floats lose in both factors.
    pub half_error: StageError,
    /// What the codec loses in the finest mip.
    pub codec_error: StageError,
    /// Quantizer step in root mean squares of the BTF, as asked for.
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
