//! The whole way from a BTF to an archive.

use std::path::PathBuf;
use std::time::Instant;

use tileset::Codec;

use crate::build::{self, DEFAULT_QUALITY};
use crate::output::AtomicFile;
use crate::progress::ProgressFn;
use crate::report::{Report, Seconds, StageError};
use crate::{Btf, Result, Settings, factorize, memory};

/// What to do.
#[derive(Clone, Debug)]
pub struct Options {
    /// The BTF, a `.npy` file with its `.json` beside it.
    pub input: PathBuf,
    /// The archive to write.
    pub output: PathBuf,
    /// Rank, memory and seed of the factorization.
    pub settings: Settings,
    /// Quantizer step in root mean squares of the BTF.
    pub quality: f64,
}

impl Options {
    /// Defaults: rank 100, two power iterations, [`DEFAULT_QUALITY`], a quarter of the machine's memory.
    pub fn new(input: impl Into<PathBuf>, output: impl Into<PathBuf>) -> Self {
        Self {
            input: input.into(),
            output: output.into(),
            settings: Settings::default(),
            quality: DEFAULT_QUALITY,
        }
    }
}

/// Factorizes a BTF, codes it, and writes the archive. An interrupted or failed run leaves no archive.
///
/// # Errors
/// Those of [`Btf::open`], [`factorize::factorize`] and [`build::build`]. What can be known before the long work is
/// checked before it: options, directions, and whether the output can be written.
pub fn run(options: &Options, progress: ProgressFn<'_>) -> Result<Report> {
    let began = Instant::now();
    let Options {
        input,
        output,
        settings,
        quality,
    } = options;
    let btf = Btf::open(input)?;
    build::check(&btf, settings.components, *quality)?;
    drop(AtomicFile::create(output)?);

    let factors = factorize::factorize(&btf, settings, progress)?;
    let built = build::build(&btf, &factors, *quality, output, progress)?;

    let manifest = built.manifest;
    let ledger = manifest.errors;
    let stage = |rms: f64| StageError {
        rms,
        relative: if ledger.btf_rms > 0.0 {
            rms / ledger.btf_rms
        } else {
            0.0
        },
    };
    let quantizer_step = match manifest.codec {
        Codec::DctDeltaZstd { step } => step,
        _ => f64::NAN,
    };
    let statistics = factors.statistics;
    let [encode, measure, write] = built.seconds;
    Ok(Report {
        generator: manifest.generator,
        input: input.display().to_string(),
        output: output.display().to_string(),
        views: manifest.views.len(),
        lights: manifest.lights.len(),
        width: manifest.width,
        height: manifest.height,
        components_wanted: settings.components,
        components: manifest.components,
        relative_error: ledger.total_relative(),
        btf_rms: ledger.btf_rms,
        rank_error: stage(ledger.rank_rms),
        half_error: stage(ledger.half_rms),
        codec_error: stage(ledger.codec_rms),
        quality: *quality,
        quantizer_step,
        texture_scale: manifest.texture_scale,
        mean_rgb: manifest.mean_rgb,
        singular_values: manifest.singular_values,
        seconds: Seconds {
            read: statistics.read_seconds,
            product: statistics.product_seconds,
            basis: statistics.basis_seconds,
            decompose: statistics.decompose_seconds,
            encode,
            measure,
            write,
            total: began.elapsed().as_secs_f64(),
        },
        bytes_read: statistics.bytes_read,
        passes: statistics.passes,
        block_rows: statistics.block_rows,
        gflops: statistics.product_flops / statistics.product_seconds.max(f64::MIN_POSITIVE) * 1e-9,
        memory_limit_bytes: settings.memory_bytes,
        peak_rss_bytes: memory::peak_resident_bytes(),
        peak_anonymous_bytes: statistics.peak_anonymous_bytes,
        archive: built.bytes,
    })
}
