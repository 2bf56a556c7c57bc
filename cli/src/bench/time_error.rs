//! `eigentile bench time-error`: run time over error, of every setting that trades one for the other.

use std::path::PathBuf;

use ::benches::time_error::{Input, Plan, measure, plot, report, table};
use ::preprocess::Settings;
use anyhow::{Context, Result, ensure};
use clap::Args;

use super::output::{Plotted, Shown};
use super::viewed::Viewed;
use crate::progress;
use crate::render::parse_size;

/// Measure run time against error, of every setting that trades one for the other, and whether the defaults are among the best.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Scene: .gltf or .glb; without one a grid of tori with a small cloth is made.
    #[arg(value_name = "SCENE.gltf")]
    scene: Option<PathBuf>,
    /// BTF, or folder of factors that `bench codec` has kept: its factors are coded with several steps, and the BTF is factorized in
    /// several numbers of passes. Without a scene that of the scene that is made.
    #[arg(long, value_name = "X.npy|FOLDER", requires = "scene")]
    btf: Option<PathBuf>,
    /// Terms of the factorization.
    #[arg(long, value_name = "N", default_value_t = 32)]
    components: u32,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "320x180", value_parser = parse_size)]
    size: (u32, u32),
    /// Texels along a side of the cloth that is made.
    #[arg(long, value_name = "N", default_value_t = 128, conflicts_with = "scene")]
    texels: u32,
    /// Views along the path.
    #[arg(long, value_name = "N", default_value_t = 4)]
    frames: usize,
    /// Times that each setting runs, by turns with the default.
    #[arg(long, value_name = "N", default_value_t = 7)]
    rounds: usize,
    /// Most memory on the GPU for pages and columns, MiB, of each of two engines.
    #[arg(long, value_name = "N", default_value_t = 1024)]
    most_mib: u64,
    #[command(flatten)]
    output: Plotted,
    #[command(flatten)]
    viewed: Viewed,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench time-error --report time.html
  eigentile bench time-error scene.gltf --tiles tiles --camera path.json --btf cloth.npy --report time.html --csv time.csv

Knobs: component groups, their cut-off, interpolation of directions, format of the page cache (a frame of settled views, against the best
picture of the same archives); step of the quantizer (decoding, against V'); passes of the factorization (against the BTF).
A setting is dominated if another one of its knob is surely no slower, no larger and no worse, and better in one of these. Work is
a count that does not depend on the machine.";

/// Most views, and rounds.
const MOST: usize = 10_000;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    for (name, value, least) in [
        ("--frames", arguments.frames, 2),
        ("--rounds", arguments.rounds, 1),
    ] {
        ensure!(
            (least..=MOST).contains(&value),
            "{name} is {value}; it must be {least} to {MOST}"
        );
    }
    let plan = Plan {
        size: arguments.size,
        rounds: arguments.rounds,
        most_bytes: arguments
            .most_mib
            .checked_mul(1 << 20)
            .context("--most-mib is too large")?,
    };
    let settings = Settings {
        components: arguments.components,
        ..Settings::default()
    };
    let input = match &arguments.scene {
        Some(scene) => {
            let subject = arguments
                .viewed
                .subject(scene, arguments.size, arguments.frames, 0)?;
            Input::Given(Box::new(subject), arguments.btf.clone())
        }
        None => Input::Made {
            texels: arguments.texels,
            frames: arguments.frames,
        },
    };
    let spinner = progress::spinner("time and error", arguments.viewed.json);
    let results = measure(input, &plan, &settings, &|what| {
        spinner.set_message(what.to_owned())
    });
    spinner.finish_and_clear();
    let results = results?;
    let shown = Shown {
        rows: &results.settings(),
        text: table(&results),
        report: report(&results),
        device: Some(::engine::gpu::Context::headless()?.adapter()),
        results: &results,
    };
    arguments
        .output
        .give(arguments.viewed.json, &plot(&results), shown)
}
