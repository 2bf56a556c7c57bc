//! `eigentile preprocess`: from a BTF to an archive.

use std::path::{Path, PathBuf};
use std::time::Duration;

use ::preprocess::{Goal, Options, Report, Weights};
use anyhow::{Result, ensure};
use clap::{ArgGroup, Args, ValueEnum};

use crate::input::InputArguments;
use crate::{bytes, file, progress};

/// Factorize, tile and compress a BTF into an archive.
///
/// Rank and quantizer step are given (--components, --quality), or found so that the archive meets one goal. An
/// interrupted run continues where it was when it is called again.
#[derive(Args)]
#[command(after_help = EXAMPLES, group(ArgGroup::new("goal").conflicts_with_all(["components", "quality"])))]
pub(crate) struct Arguments {
    /// BTF: X.npy of shape (views, lights, 3, height, width), f16 or f32, and X.json with its directions; or any
    /// other format that `eigentile inspect` knows; or - for the .npy on standard input, read in a single pass.
    input: PathBuf,
    /// The directions of a BTF on standard input.
    #[arg(long, value_name = "X.json")]
    directions: Option<PathBuf>,
    #[command(flatten)]
    input_arguments: InputArguments,
    /// Fills bad samples (NaN, infinities) from their neighbours instead of refusing them, and says how many.
    #[arg(long)]
    repair: bool,
    /// The archive.
    #[arg(short, long, value_name = "X.bsvtf")]
    output: PathBuf,
    /// Terms of the factorization; 100 if there is no goal.
    #[arg(long)]
    components: Option<u32>,
    /// Quantizer step, as a share of the BTF's root mean square; larger is smaller and coarser.
    #[arg(long, value_name = "STEP")]
    quality: Option<f64>,
    /// Goal: the fewest bytes with at most this relative error (root mean square over that of the BTF), such as 0.05.
    #[arg(long, value_name = "E", group = "goal")]
    target_error: Option<f64>,
    /// Goal: the fewest bytes with at least this PSNR; its peak is 1, the reflectance of a white Lambertian surface.
    #[arg(long, value_name = "DB", group = "goal")]
    target_psnr: Option<f64>,
    /// Goal: the least error in a file of at most this size, such as 10MB.
    #[arg(long, value_name = "BYTES", value_parser = bytes::parse, group = "goal")]
    max_bytes: Option<u64>,
    /// What the squares of the error are weighted by when textures are chosen.
    #[arg(long, value_enum, default_value_t)]
    weights: Weighting,
    /// Passes over the samples: 1 for input that is slow to read, whose error is only estimated; more are more exact.
    /// Without it as many as are worth it, usually 4, or as the goal needs.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    passes: Option<u32>,
    /// Measures the archive's error against the BTF itself in one more pass, not against the factors.
    #[arg(long)]
    verify: bool,
    /// Memory that may be used, such as 2GiB; without it a quarter of the machine's.
    #[arg(long, value_name = "BYTES", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Seconds between two saves of what an interrupted run continues from.
    #[arg(long, value_name = "SECONDS", default_value_t = 20.0, value_parser = seconds)]
    save_every: f64,
    /// Writes a report: errors by stage, seconds by phase, bytes.
    #[arg(long, value_name = "R.json")]
    report: Option<PathBuf>,
    /// Prints the report as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

/// Weights on the command line.
#[derive(Clone, Copy, Default, ValueEnum)]
enum Weighting {
    /// Every sample counts the same
    #[default]
    Uniform,
    /// A direction counts as the solid angle that is nearest to it
    SolidAngle,
    /// Images brighter than the median count as if they were as bright as it: for highlights of high dynamic range
    Robust,
}

impl From<Weighting> for Weights {
    fn from(weighting: Weighting) -> Self {
        match weighting {
            Weighting::Uniform => Weights::Uniform,
            Weighting::SolidAngle => Weights::SolidAngle,
            Weighting::Robust => Weights::Robust,
        }
    }
}

const EXAMPLES: &str = "\
Examples:
  eigentile preprocess leather.npy -o tiles/leather.bsvtf
  eigentile preprocess leather.npy -o tiles/leather.bsvtf --target-error 0.2
  eigentile preprocess leather.npy -o small.bsvtf --max-bytes 2MB
  eigentile preprocess leather.npy -o small.bsvtf --components 32 --quality 0.05
  make-btf | eigentile preprocess - -o made.bsvtf --directions made.json
  eigentile preprocess huge.npy -o huge.bsvtf --memory 2GiB --report huge-report.json";

/// How to make an archive; `None` stands for the defaults of the library.
#[derive(Clone, Copy)]
pub(crate) struct Job {
    pub(crate) components: u32,
    pub(crate) quality: Option<f64>,
    pub(crate) memory: Option<u64>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(path) = &arguments.report {
        ensure!(
            *path != arguments.input.with_extension("json"),
            "--report {} would overwrite the directions of the BTF: choose another name",
            path.display()
        );
        file::make_folder_of(path)?;
    }
    let piped = arguments.input == Path::new("-");
    ensure!(
        piped || arguments.directions.is_none(),
        "--directions belongs to a BTF on standard input, -; that of {} stands beside it",
        arguments.input.display()
    );
    if piped && !arguments.json {
        eprintln!("standard input can be read once: a single pass, whose error is larger, and estimated");
    }
    let report = carry_out(&options(arguments), "", arguments.json)?;
    if let Some(path) = &arguments.report {
        file::write_json(path, &report)?;
    }
    if arguments.json {
        return file::print_json(&report);
    }
    eprint!("{}", text(&report));
    Ok(())
}

fn options(arguments: &Arguments) -> Options {
    let mut options = Options::new(&arguments.input, &arguments.output);
    options.directions = arguments.directions.clone();
    options.overrides = arguments.input_arguments.overrides();
    options.repair = arguments.repair;
    let settings = &mut options.settings;
    settings.components = arguments.components.unwrap_or(settings.components);
    settings.memory_bytes = arguments.memory.unwrap_or(settings.memory_bytes);
    settings.weights = arguments.weights.into();
    settings.passes = arguments.passes;
    options.quality = arguments.quality.unwrap_or(options.quality);
    // The command line takes one of these at most.
    options.goal = (arguments.target_error.map(Goal::RelativeError))
        .or(arguments.target_psnr.map(Goal::Psnr))
        .or(arguments.max_bytes.map(Goal::Bytes));
    options.verify = arguments.verify;
    options.checkpoint_interval = Duration::from_secs_f64(arguments.save_every);
    options
}

/// A time that is finite and not negative.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err(format!("{text:?} is no number of seconds from 0 to 1e6")),
    }
}

/// Makes an archive. `label` goes before the names of the phases.
pub(crate) fn build(input: &Path, output: &Path, job: &Job, label: &str, quiet: bool) -> Result<Report> {
    let mut options = Options::new(input, output);
    options.settings.components = job.components;
    options.settings.memory_bytes = job.memory.unwrap_or(options.settings.memory_bytes);
    options.quality = job.quality.unwrap_or(options.quality);
    carry_out(&options, label, quiet)
}

fn carry_out(options: &Options, label: &str, quiet: bool) -> Result<Report> {
    file::make_folder_of(&options.output)?;
    let phases = progress::Phases::new(label, quiet);
    let report = ::preprocess::run(options, &|progress| phases.show(progress));
    phases.finish();
    Ok(report?)
}

/// For people.
fn text(report: &Report) -> String {
    let percent = |relative: f64| format!("{:.3} %", 100.0 * relative);
    let resumed = match report.resumed_rows {
        0 => "",
        _ => ", continued from an interrupted run",
    };
    let psnr = report
        .psnr
        .map_or(String::new(), |psnr| format!(" ({psnr:.1} dB)"));
    let mut text = format!(
        "{}: {} of {} components of {}x{} texels in {:.1} s, {} passes{resumed}\n\
         error {}{psnr}: rank {}, half floats {}, codec {}; measured {}\n",
        report.output,
        bytes::text(report.archive.archive_bytes),
        report.components,
        report.width,
        report.height,
        report.seconds.total,
        report.passes,
        percent(report.relative_error),
        percent(report.rank_error.relative),
        percent(report.half_error.relative),
        percent(report.codec_error.relative),
        percent(report.measured_error.relative),
    );
    if let Some(repairs) = &report.repairs {
        text += &format!("{repairs}\n");
    }
    if let Some(weighted) = &report.weighted {
        text += &format!(
            "weighted error {}: rank {}\n",
            percent(weighted.measured.relative),
            percent(weighted.rank.relative)
        );
    }
    text
}
