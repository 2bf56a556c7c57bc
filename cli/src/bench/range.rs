//! `eigentile bench range`: weights of rows and compression of the range of samples at equal rank.

use std::io::Write;
use std::path::PathBuf;

use ::benches::range::{run as run_ways, table};
use ::preprocess::Settings;
use anyhow::Result;
use clap::Args;

use crate::{file, progress};

/// Measure what weights and compressed samples do to errors, as numbers and as the eye sees them, at equal rank.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The BTF.
    input: PathBuf,
    /// Terms of the factorization.
    #[arg(long, default_value_t = 32)]
    components: u32,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Example:
  eigentile bench range cloth.npy --components 32

Columns: root mean square error relative to that of the BTF; the same of sRGB values of clamped samples; mean CIELAB
difference of these colours. Every seventh image is judged.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let settings = Settings {
        components: arguments.components,
        ..Settings::default()
    };
    let spinner = progress::spinner("range", arguments.json);
    let rows = run_ways(&arguments.input, &settings, &|way| {
        spinner.set_message(way.to_owned());
    });
    spinner.finish_and_clear();
    let rows = rows?;
    if arguments.json {
        return file::print_json(&rows);
    }
    Ok(write!(std::io::stdout().lock(), "{}", table(&rows))?)
}
