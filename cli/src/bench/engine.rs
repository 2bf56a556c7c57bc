//! `eigentile bench engine`: what virtual textures cost in a frame, and what is skipped.

use std::path::PathBuf;

use ::benches::engine::{Case, Plan, built_in, measure, table};
use ::benches::report::Report;
use anyhow::{Result, ensure};
use clap::Args;
use serde::Serialize;

use super::output::{Output, Shown};
use super::viewed::{Viewed, cache_bytes};
use crate::progress;
use crate::render::parse_size;

/// Measure frames with virtual textures against frames with all resident, the CPU by phase, and work that is skipped.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Scene: .gltf or .glb; without one a grid of tori with 1, 10 and 100 materials is made.
    #[arg(value_name = "SCENE.gltf")]
    scene: Option<PathBuf>,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "320x180", value_parser = parse_size)]
    size: (u32, u32),
    /// Views along the path.
    #[arg(long, value_name = "N", default_value_t = 12)]
    frames: usize,
    /// Views along the path in flight, where the CPU is measured.
    #[arg(long, value_name = "N", default_value_t = 240)]
    flight: usize,
    /// Times that the path is gone, with and without virtual textures, and in flight.
    #[arg(long, value_name = "N", default_value_t = 3)]
    rounds: usize,
    /// Frames in which the camera stands still.
    #[arg(long, value_name = "N", default_value_t = 200)]
    still: usize,
    /// Memory on the GPU for pages and columns, MiB; all that the path wants should fit.
    #[arg(long, value_name = "N", default_value_t = 512)]
    cache_mib: u64,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    viewed: Viewed,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench engine
  eigentile bench engine --json > benches/results/engine.json
  eigentile bench engine scenes/tori/scene.gltf --tiles scenes/tiles --camera scenes/tori/camera.json --size 1280x720

Virtual is a whole frame. Resident is the same renderer with a copy of the same pages and columns, all that the path wants,
where the shader computes their places: without page table, feedback, votes, decisions, streaming and border stitching.
Where all pages of the scene take more than 1 GiB, it reads the page table instead, and the table says so. Both are drawn
alternately; of each view the fastest of all rounds counts. In flight the cache is empty at first and holds half of what the path
wants; times of the CPU are those that the frames' thread has worked, and beside them those that have passed. Passes are timed on the GPU where it has timestamps.";

/// Materials of the scenes that are made.
const MATERIALS: [usize; 3] = [1, 10, 100];
/// Most views, rounds and still frames.
const MOST: usize = 100_000;

/// All that was measured.
#[derive(Serialize)]
struct Results {
    settings: Plan,
    cases: Vec<Case>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    for (name, value) in [
        ("--frames", arguments.frames),
        ("--flight", arguments.flight),
        ("--rounds", arguments.rounds),
        ("--still", arguments.still),
    ] {
        ensure!(
            (1..=MOST).contains(&value),
            "{name} is {value}; it must be 1 to {MOST}"
        );
    }
    let [page_cache_bytes, column_cache_bytes] = cache_bytes(arguments.cache_mib)?;
    let plan = Plan {
        size: arguments.size,
        page_cache_bytes,
        column_cache_bytes,
        rounds: arguments.rounds,
        static_frames: arguments.still,
    };
    let spinner = progress::spinner("engine", arguments.viewed.json);
    let subjects = match &arguments.scene {
        Some(scene) => {
            let Arguments {
                viewed,
                size,
                frames,
                flight,
                ..
            } = arguments;
            vec![viewed.subject(scene, *size, *frames, *flight)?]
        }
        None => {
            spinner.set_message("making materials");
            let of = |materials| built_in(materials, arguments.frames, arguments.flight);
            MATERIALS.map(of).into_iter().collect::<::benches::Result<_>>()?
        }
    };
    let results = Results {
        settings: plan,
        cases: subjects
            .iter()
            .map(|subject| {
                Ok(measure(subject, &plan, &|what| {
                    spinner.set_message(what.to_owned())
                })?)
            })
            .collect::<Result<_>>()?,
    };
    spinner.finish_and_clear();
    let device = ::engine::gpu::Context::headless()?.adapter();
    let (width, height) = plan.size;
    let text = format!("{width}×{height} on {device}\n\n{}", table(&results.cases));
    let shown = Shown {
        rows: &results.cases,
        report: Report::new("Frames with and without virtual textures").text(&text),
        text,
        device: Some(device),
        results: &results,
    };
    arguments.output.give(arguments.viewed.json, shown)
}
