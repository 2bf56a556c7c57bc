//! The whole way from a BTF to an archive.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tileset::{Ledger, MAX_COMPONENTS};

use crate::build::{self, Built, DEFAULT_QUALITY};
use crate::factorize::{self, Checkpoint, Enough};
use crate::goal::{self, Goal};
use crate::measure::{self, Against};
use crate::npy::read_once;
use crate::output::AtomicFile;
use crate::progress::ProgressFn;
use crate::report::{Report, Seconds, StageError, WeightedError};
use crate::source::Overrides;
use crate::{Btf, Error, Factors, Result, Settings, memory};

/// Terms computed at most where the goal is a number of bytes: beyond it each costs more than it gains.
const MOST_TERMS_FOR_BYTES: u32 = 160;
/// Attempts to keep a file within its bytes, whose manifest is known only when it is written.
const MAX_WRITES: u32 = 4;

/// What an array on standard input is called.
const PIPE: &str = "standard input";

/// What to do.
#[derive(Clone, Debug)]
pub struct Options {
    /// The BTF, in any format that [`Btf::open`] knows; or `-` for an array on standard input.
    pub input: PathBuf,
    /// The directions of an array on standard input.
    pub directions: Option<PathBuf>,
    /// What the input's files do not say, or say wrongly.
    pub overrides: Overrides,
    /// Whether bad samples are filled instead of refused: see [`Btf::repaired`].
    pub repair: bool,
    /// The archive to write.
    pub output: PathBuf,
    /// Rank, memory and seed of the factorization. With a goal the rank is found.
    pub settings: Settings,
    /// Quantizer step in root mean squares of the BTF. With a goal it is found.
    pub quality: f64,
    /// What the archive shall meet, if rank and step are not given.
    pub goal: Option<Goal>,
    /// Whether the archive is compared with the BTF itself, in one more pass, instead of with the factors.
    pub verify: bool,
    /// Time between two saves of what an interrupted run continues from: in the folder OUTPUT.partial, deleted when the
    /// archive is complete.
    pub checkpoint_interval: Duration,
}

impl Options {
    /// Defaults: rank 100, [`DEFAULT_QUALITY`], a quarter of the machine's memory.
    pub fn new(input: impl Into<PathBuf>, output: impl Into<PathBuf>) -> Self {
        Self {
            input: input.into(),
            directions: None,
            overrides: Overrides::default(),
            repair: false,
            output: output.into(),
            settings: Settings::default(),
            quality: DEFAULT_QUALITY,
            goal: None,
            verify: false,
            checkpoint_interval: Checkpoint::INTERVAL,
        }
    }
}

/// Factorizes a BTF, codes it, and writes the archive. An interrupted or failed run leaves no archive; called again with
/// the same options it continues from the last block of the factorization that was saved.
///
/// # Errors
/// Those of [`Btf::open_with`], [`factorize::factorize_resumable`] and [`build::build`]; [`Error::Unreachable`] for a goal
/// that nothing meets. What can be known before the long work is checked before it: options, directions, and whether
/// the output can be written.
pub fn run(options: &Options, progress: ProgressFn<'_>) -> Result<Report> {
    if options.input == Path::new("-") {
        return run_once(std::io::stdin(), options, progress);
    }
    let btf = Btf::open_with(&options.input, &options.overrides)?;
    if !options.repair {
        return run_on(&btf, options, progress);
    }
    let (btf, repairs) = btf.repaired();
    let mut report = run_on(&btf, options, progress)?;
    report.repairs = Some(repairs.report());
    Ok(report)
}

/// [`run`] for an array that can be read only once, as from a pipe, whatever [`Options::input`] says: in a single pass,
/// whose error is estimated. It cannot be continued where it was interrupted.
///
/// # Errors
/// As [`run`]; [`Error::Invalid`] for whatever needs another pass: a number of passes, repair, comparison with the BTF,
/// an error to be met.
pub fn run_once(
    reader: impl Read + Send + 'static,
    options: &Options,
    progress: ProgressFn<'_>,
) -> Result<Report> {
    let refuse = |what, found: String| {
        Err(Error::Invalid {
            what,
            found,
            expected: "left out where the BTF comes from a pipe, which can be read once: write it into a file",
        })
    };
    if let Some(passes) = options.settings.passes.filter(|&passes| passes > 1) {
        return refuse("number of passes", passes.to_string());
    }
    if options.repair || options.verify {
        return refuse("repair or comparison with the BTF", "asked for".into());
    }
    if let Some(goal) = options.goal.filter(|goal| !matches!(goal, Goal::Bytes(_))) {
        return refuse("goal", goal.to_string());
    }
    let Some(directions) = &options.directions else {
        return Err(Error::Invalid {
            what: "file of directions",
            found: "not given".into(),
            expected: "given (--directions X.json) where the BTF comes from a pipe",
        });
    };
    let mut options = options.clone();
    options.settings.passes = Some(1);
    let btf = read_once(reader, Path::new(PIPE), directions, &options.overrides)?;
    run_on(&btf, &options, progress)
}

fn run_on(btf: &Btf, options: &Options, progress: ProgressFn<'_>) -> Result<Report> {
    let began = Instant::now();
    if let Some(goal) = options.goal {
        goal.check()?;
    }
    let settings = settings_for(btf, options);
    build::check(btf, settings.components, options.quality)?;
    drop(AtomicFile::create(&options.output)?);

    let checkpoint = Checkpoint::beside(&options.output, options.checkpoint_interval);
    // What has gone through a pipe does not come again.
    let resumable = (btf.path() != Path::new(PIPE)).then_some(&checkpoint);
    let mut factors = factorize::factorize_resumable(btf, &settings, resumable, progress)?;
    let Outcome {
        built,
        quality,
        trials,
    } = code(btf, &factors, options, progress)?;
    checkpoint.delete();

    let components = built.manifest.components as usize;
    if components < factors.components {
        factors = factors.truncated(components);
    }
    let against = if options.verify {
        Against::Btf(btf)
    } else {
        Against::Factors
    };
    let measuring = Instant::now();
    let measured = measure::archive(&options.output, &factors, against, progress)?;
    let measure_seconds = measuring.elapsed().as_secs_f64();
    Ok(report(
        options,
        &factors,
        built,
        quality,
        trials,
        measured,
        |seconds| {
            seconds.measure += measure_seconds;
            seconds.total = began.elapsed().as_secs_f64();
        },
    ))
}

/// What the factorization is asked for.
fn settings_for(btf: &Btf, options: &Options) -> Settings {
    let Options { settings, goal, .. } = options;
    let Some(goal) = goal else {
        return *settings;
    };
    // As many as an archive of this size may have.
    let mut most = MAX_COMPONENTS;
    while most > 1 && build::check(btf, most, options.quality).is_err() {
        most /= 2;
    }
    let enough = match *goal {
        Goal::RelativeError(error) => Enough::Relative(goal::rank_error_for(error)),
        Goal::Psnr(decibels) => Enough::Rms(goal::rank_error_for(goal::rms_of_psnr(decibels))),
        Goal::Bytes(bytes) => {
            let most = most.min(MOST_TERMS_FOR_BYTES);
            return Settings {
                components: goal::terms_within(bytes, btf.rows(), most),
                ..*settings
            };
        }
    };
    Settings {
        components: most,
        enough: Some(enough),
        ..*settings
    }
}

/// An archive that was written, and how it was found.
struct Outcome {
    built: Built,
    quality: f64,
    trials: u32,
}

/// Codes factors as the options ask, and writes the archive.
fn code(btf: &Btf, factors: &Factors, options: &Options, progress: ProgressFn<'_>) -> Result<Outcome> {
    let Options {
        output,
        quality,
        goal,
        ..
    } = options;
    let Some(goal) = *goal else {
        let built = build::build(btf, factors, *quality, output, progress)?;
        return Ok(Outcome {
            built,
            quality: *quality,
            trials: 1,
        });
    };
    let (mut overhead, mut trials) = (1.0, 0);
    for _ in 0..MAX_WRITES {
        let found = goal::reach(btf, factors, goal, overhead, progress)?;
        trials += found.trials;
        let quality = found.quality;
        // A file that is too large does not replace what has the name of the output.
        let path = trial_path(output);
        let built = found.encoded.write(&path)?;
        let within = !matches!(goal, Goal::Bytes(bytes) if built.bytes.archive_bytes > bytes);
        if within {
            std::fs::rename(&path, output).map_err(Error::io(output, "complete"))?;
            return Ok(Outcome {
                built,
                quality,
                trials,
            });
        }
        std::fs::remove_file(&path).map_err(Error::io(&path, "delete"))?;
        let guessed = goal::overhead_bytes(btf, built.manifest.components as usize);
        overhead = (overhead * 1.02).max(1.02 * built.bytes.manifest_bytes as f64 / guessed as f64);
    }
    Err(Error::Unreachable {
        goal: goal.to_string(),
        best: format!("the manifest takes {overhead:.2} times the bytes that were expected"),
    })
}

fn trial_path(output: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(output.file_name().unwrap_or_default());
    name.push(format!(".{}.trial", std::process::id()));
    output.with_file_name(name)
}

fn report(
    options: &Options,
    factors: &Factors,
    built: Built,
    quality: f64,
    trials: u32,
    measured: measure::Measured,
    clock: impl FnOnce(&mut Seconds),
) -> Report {
    let manifest = built.manifest;
    let ledger: Ledger = manifest.errors;
    let stage = |rms: f64| StageError::new(rms, ledger.btf_rms);
    let weighted = factors.weighted.as_ref().map(|weighted| {
        let whole = factors.rms(weighted.energy);
        WeightedError {
            weights: options.settings.weights,
            rank: StageError::new(factors.rms(weighted.residual_energy), whole),
            measured: StageError::new(factors.rms(measured.weighted_energy.unwrap_or(0.0)), whole),
        }
    });
    let quantizer_step = manifest.codec.step();
    let statistics = factors.statistics;
    let [encode, measure, write] = built.seconds;
    let mut seconds = Seconds {
        read: statistics.read_seconds,
        product: statistics.product_seconds,
        basis: statistics.basis_seconds,
        decompose: statistics.decompose_seconds,
        save: statistics.save_seconds,
        encode,
        measure,
        write,
        total: 0.0,
    };
    clock(&mut seconds);
    Report {
        generator: manifest.generator,
        input: options.input.display().to_string(),
        output: options.output.display().to_string(),
        repairs: None,
        views: manifest.views.len(),
        lights: manifest.lights.len(),
        width: manifest.width,
        height: manifest.height,
        goal: options.goal,
        trials,
        components_wanted: options.goal.is_none().then_some(options.settings.components),
        components: manifest.components,
        relative_error: ledger.total_relative(),
        psnr: goal::psnr(ledger.total_rms()),
        btf_rms: ledger.btf_rms,
        rank_error: stage(ledger.rank_rms),
        rank_estimated: factors.estimated,
        half_error: stage(ledger.half_rms),
        codec_error: stage(ledger.codec_rms),
        total_error: stage(ledger.total_rms()),
        measured_error: stage(factors.rms(measured.energy)),
        measured_against: measured.against,
        weighted,
        quality,
        quantizer_step,
        texture_scale: manifest.texture_scale,
        mean_rgb: manifest.mean_rgb,
        singular_values: manifest.singular_values,
        seconds,
        bytes_read: statistics.bytes_read,
        passes: statistics.passes,
        subspace: statistics.subspace,
        resumed_rows: statistics.resumed_rows,
        block_rows: statistics.block_rows,
        gflops: statistics.product_flops / statistics.product_seconds.max(f64::MIN_POSITIVE) * 1e-9,
        memory_limit_bytes: options.settings.memory_bytes,
        peak_rss_bytes: memory::peak_resident_bytes(),
        peak_anonymous_bytes: statistics.peak_anonymous_bytes,
        archive: built.bytes,
    }
}
