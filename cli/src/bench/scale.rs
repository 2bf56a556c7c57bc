//! `eigentile bench scale`: what grows with the number of materials and their size.

use ::benches::report::Report;
use ::benches::scale::{Plan, measure, table};
use anyhow::{Result, ensure};
use clap::Args;

use super::output::{Output, Shown};
use super::viewed::cache_bytes;
use crate::progress;
use crate::render::parse_size;

/// Measure memory, start-up and the CPU of a frame over the number of materials and their size, with virtual archives.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Materials, each a row, of 256² texels.
    #[arg(
        long,
        value_name = "N,N,…",
        value_delimiter = ',',
        default_value = "1,10,100,1000"
    )]
    materials: Vec<usize>,
    /// Texels along a side, each a row of ten materials.
    #[arg(
        long,
        value_name = "N,N,…",
        value_delimiter = ',',
        default_value = "256,512,1024,2048,4096,8192"
    )]
    sides: Vec<u32>,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "320x180", value_parser = parse_size)]
    size: (u32, u32),
    /// Frames of the moving camera.
    #[arg(long, value_name = "N", default_value_t = 60)]
    frames: usize,
    /// Memory on the GPU for pages and columns, MiB.
    #[arg(long, value_name = "N", default_value_t = 96)]
    cache_mib: u64,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench scale
  eigentile bench scale --materials 1,1000 --sides 8192 --json

A virtual archive is one archive under many names, whose pages are all the same record. Index: what is read first of each archive. Known:
until all of them were. CPU: processor time of the frames' thread besides the submission of work to the GPU, medians.";

/// Materials of the rows by size, and texels of those by number.
const MATERIALS: usize = 10;
const SIDE: u32 = 256;
/// Most materials, texels along a side, and frames.
const MOST_MATERIALS: usize = 10_000;
const MOST_SIDE: u32 = 1 << 14;
const MOST_FRAMES: usize = 100_000;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    for materials in &arguments.materials {
        ensure!(
            (1..=MOST_MATERIALS).contains(materials),
            "--materials {materials}: 1 to {MOST_MATERIALS}"
        );
    }
    for side in &arguments.sides {
        ensure!(
            side.is_power_of_two() && (32..=MOST_SIDE).contains(side),
            "--sides {side}: a power of two from 32 to {MOST_SIDE}"
        );
    }
    ensure!(
        (1..=MOST_FRAMES).contains(&arguments.frames),
        "--frames is {}; it must be 1 to {MOST_FRAMES}",
        arguments.frames
    );
    let counts = arguments.materials.iter().map(|materials| (*materials, SIDE));
    let sides = arguments.sides.iter().map(|side| (MATERIALS, *side));
    let plan = Plan {
        cases: counts.chain(sides).collect(),
        size: arguments.size,
        frames: arguments.frames,
        cache_bytes: cache_bytes(arguments.cache_mib)?,
    };
    let spinner = progress::spinner("scale", arguments.json);
    let results = measure(&plan, &|what| spinner.set_message(what.to_owned()));
    spinner.finish_and_clear();
    let results = results?;
    let text = table(&results);
    let shown = Shown {
        rows: &results.rows,
        report: Report::new("What grows with the number of materials and their size").text(&text),
        text,
        device: Some(::engine::gpu::Context::headless()?.adapter()),
        results: &results,
    };
    arguments.output.give(arguments.json, shown)
}
