//! `eigentile bench factorize`: seconds, error and memory of one factorization.

use std::path::PathBuf;

use ::preprocess::Settings;
use anyhow::Result;
use clap::Args;

use crate::{bytes, file, progress};

/// Measure one factorization: seconds by phase, error, peak memory.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The BTF.
    input: PathBuf,
    /// Terms of the factorization.
    #[arg(long, default_value_t = 100)]
    components: u32,
    /// Memory that may be used, such as 1GiB; without it a quarter of the machine's.
    #[arg(long, value_name = "BYTES", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Example:
  eigentile bench factorize leather.npy --memory 1GiB --json

Nothing is written. Machines are noisy: call it alternately with benches/peers/factorize_numpy.py, as
benches/peers/factorize_run.py does, and compare by ratio.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let mut settings = Settings {
        components: arguments.components,
        ..Settings::default()
    };
    settings.memory_bytes = arguments.memory.unwrap_or(settings.memory_bytes);
    let phases = progress::Phases::new("", arguments.json);
    let made = ::benches::factorize::run(&arguments.input, &settings, &|progress| phases.show(progress));
    phases.finish();
    let (_, _, factorized) = made?;
    if arguments.json {
        return file::print_json(&factorized);
    }
    eprintln!(
        "{}: {} components of {} x {} samples in {:.1} s, error {:.3} %, {:.0} GFLOP/s",
        arguments.input.display(),
        factorized.components,
        factorized.rows,
        factorized.columns,
        factorized.seconds,
        100.0 * factorized.relative_error,
        factorized.gflops,
    );
    Ok(())
}
