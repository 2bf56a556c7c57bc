//! `eigentile export`: an archive as plain numpy files.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;

use crate::{file, inspect, progress};

/// Decode an archive to numpy files that multiply to the BTF.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The archive.
    #[arg(value_name = "X.bsvtf")]
    archive: PathBuf,
    /// Folder for u.npy, v.npy and meta.json.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Prints what was written as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Example:
  eigentile export tiles/leather.bsvtf -o leather
  python3 -c 'import numpy as np; u = np.load(\"leather/u.npy\"); v = np.load(\"leather/v.npy\"); \\
      print(np.einsum(\"cvlr,cyx->vlryx\", u[:, :1], v).shape)'

u.npy [components][views][lights][3], v.npy [components][height][width] (decoded, finest mip), meta.json.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let phases = progress::Phases::new("", arguments.json);
    let done = ::preprocess::export(&arguments.archive, &arguments.output, &|progress| {
        phases.show(progress)
    });
    phases.finish();
    done?;
    let relative = inspect::read(&arguments.archive)?.errors.total_relative;
    if arguments.json {
        let of = |name: &str| arguments.output.join(name);
        return file::print_json(&json!({
            "u": of("u.npy"), "v": of("v.npy"), "meta": of("meta.json"), "relative_error": relative,
        }));
    }
    eprintln!(
        "{}: u.npy, v.npy, meta.json; stated relative error {:.3} %",
        arguments.output.display(),
        100.0 * relative
    );
    Ok(())
}
