//! `eigentile preprocess`: from a BTF to an archive.

use std::path::{Path, PathBuf};

use ::preprocess::{Options, Report};
use anyhow::{Result, ensure};
use clap::Args;

use crate::{bytes, file, progress};

/// Factorize, tile and compress a BTF into an archive.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// BTF: X.npy of shape (views, lights, 3, height, width), f16 or f32, and X.json with its directions.
    input: PathBuf,
    /// The archive.
    #[arg(short, long, value_name = "X.bsvtf")]
    output: PathBuf,
    /// Terms of the factorization.
    #[arg(long, default_value_t = 100)]
    components: u32,
    /// Quantizer step, as a share of the BTF's root mean square; larger is smaller and coarser.
    #[arg(long, value_name = "STEP")]
    quality: Option<f64>,
    /// Memory that may be used, such as 2GiB; without it a quarter of the machine's.
    #[arg(long, value_name = "BYTES", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Writes a report: errors by stage, seconds by phase, bytes.
    #[arg(long, value_name = "R.json")]
    report: Option<PathBuf>,
    /// Prints the report as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile preprocess leather.npy -o tiles/leather.bsvtf
  eigentile preprocess leather.npy -o small.bsvtf --components 32 --quality 0.05
  eigentile preprocess huge.npy -o huge.bsvtf --memory 2GiB --report huge-report.json";

/// How to make an archive; `None` stands for the defaults of the library.
#[derive(Clone, Copy)]
pub(crate) struct Job {
    pub(crate) components: u32,
    pub(crate) quality: Option<f64>,
    pub(crate) memory: Option<u64>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Arguments {
        components,
        quality,
        memory,
        ..
    } = *arguments;
    let job = Job {
        components,
        quality,
        memory,
    };
    if let Some(path) = &arguments.report {
        ensure!(
            *path != arguments.input.with_extension("json"),
            "--report {} would overwrite the directions of the BTF: choose another name",
            path.display()
        );
        file::make_folder_of(path)?;
    }
    let report = build(&arguments.input, &arguments.output, &job, "", arguments.json)?;
    if let Some(path) = &arguments.report {
        file::write_json(path, &report)?;
    }
    if arguments.json {
        return file::print_json(&report);
    }
    eprint!("{}", text(&report));
    Ok(())
}

/// Makes an archive. `label` goes before the names of the phases.
pub(crate) fn build(input: &Path, output: &Path, job: &Job, label: &str, quiet: bool) -> Result<Report> {
    let mut options = Options::new(input, output);
    options.settings.components = job.components;
    options.settings.memory_bytes = job.memory.unwrap_or(options.settings.memory_bytes);
    options.quality = job.quality.unwrap_or(options.quality);
    file::make_folder_of(output)?;
    let phases = progress::Phases::new(label, quiet);
    let report = ::preprocess::run(&options, &|progress| phases.show(progress));
    phases.finish();
    Ok(report?)
}

/// For people.
fn text(report: &Report) -> String {
    let percent = |relative: f64| format!("{:.3} %", 100.0 * relative);
    format!(
        "{}: {} components of {}x{} texels in {:.1} s\n\
         error {}: rank {}, half floats {}, codec {}\n",
        report.output,
        report.components,
        report.width,
        report.height,
        report.seconds.total,
        percent(report.relative_error),
        percent(report.rank_error.relative),
        percent(report.half_error.relative),
        percent(report.codec_error.relative),
    )
}
