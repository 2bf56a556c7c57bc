//! `eigentile bench decode`: how fast one core decodes archives.

use std::path::PathBuf;

use ::benches::codec::Pages;
use anyhow::Result;
use clap::Args;
use serde_json::json;

use crate::file;

/// Measure how fast one core decodes all pages of archives.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The archives.
    #[arg(required = true, value_name = "X.bsvtf")]
    archives: Vec<PathBuf>,
    /// Times that all pages are decoded; the median counts.
    #[arg(long, value_name = "N", default_value_t = 5)]
    runs: usize,
    /// Prints what was measured as JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Example:
  eigentile bench decode tiles/leather.bsvtf tiles/cloth.bsvtf --runs 9

From records in memory to half floats in slots; nothing is read from the disk meanwhile. Counted are four bytes for each
sample of the payloads of all mips, and, as `finest_mb_per_s`, of the finest mip alone.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let mut archives = Vec::new();
    for path in &arguments.archives {
        let pages = Pages::read(path)?;
        let speed = pages.speed(arguments.runs)?;
        if !arguments.json {
            eprintln!(
                "{}: {:.0} MB/s of f32 on one core",
                path.display(),
                speed.mb_per_s
            );
        }
        let codec = pages.index().manifest.codec;
        archives.push(json!({ "archive": path, "codec": codec, "decode": speed }));
    }
    if arguments.json {
        return file::print_json(&archives);
    }
    Ok(())
}
