//! `eigentile convert`: any BTF to the exchange format.

use std::path::PathBuf;

use ::preprocess::Btf;
use ::preprocess::npy::Dtype;
use ::preprocess::source::{Conversion, convert};
use anyhow::Result;
use clap::Args;
use serde_json::json;

use crate::input::InputArguments;
use crate::{bytes, file, progress};

/// Convert any BTF to numpy: X.npy with its samples and X.json with its directions.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// A folder or zip of images, a table of directions beside images, a .btf or .npy file.
    input: PathBuf,
    /// Where the samples go; the directions go to X.json beside it.
    #[arg(short, long, value_name = "X.npy")]
    output: PathBuf,
    /// Writes single floats; without it half floats.
    #[arg(long)]
    float: bool,
    /// Writes half floats, as without it.
    #[arg(long, conflicts_with = "float")]
    half: bool,
    /// Only the view of this index, from 0.
    #[arg(long, value_name = "INDEX")]
    view: Option<usize>,
    /// Only the light of this index, from 0.
    #[arg(long, value_name = "INDEX")]
    light: Option<usize>,
    #[command(flatten)]
    input_arguments: InputArguments,
    /// Prints what was written as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile convert WOOL.zip -o wool.npy
  eigentile convert captures/directions.csv -o capture.npy --float --cosine
  eigentile convert WOOL.zip -o wool-from-above.npy --view 0";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let btf = Btf::open_with(&arguments.input, &arguments.input_arguments.overrides())?;
    let dtype = if arguments.float { Dtype::F32 } else { Dtype::F16 };
    let conversion = Conversion {
        dtype,
        view: arguments.view,
        light: arguments.light,
    };
    file::make_folder_of(&arguments.output)?;
    let bar = progress::bar("convert", btf.image_count() as u64, arguments.json);
    let converted = convert(&btf, &arguments.output, conversion, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    converted?;
    let written = std::fs::metadata(&arguments.output)?.len();
    let views = arguments.view.map_or(btf.views().len(), |_| 1);
    let lights = arguments.light.map_or(btf.lights().len(), |_| 1);
    if arguments.json {
        return file::print_json(&json!({
            "output": arguments.output, "format": btf.format(), "bytes": written, "dtype": dtype.descr(),
            "views": views, "lights": lights, "width": btf.width(), "height": btf.height(),
            "wrap": btf.wrap(), "cosine": btf.cosine(), "notes": btf.notes(),
        }));
    }
    for note in btf.notes() {
        eprintln!("note: {note}");
    }
    eprintln!(
        "{}: {views} views x {lights} lights x {}x{} texels, {}",
        arguments.output.display(),
        btf.width(),
        btf.height(),
        bytes::text(written)
    );
    Ok(())
}
