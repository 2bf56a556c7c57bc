//! `eigentile bench engine`: what virtual textures cost in a frame, and what is skipped.

use std::io::Write;
use std::path::PathBuf;
use std::process::Command;

use ::benches::engine::{Case, Plan, built_in, measure, table};
use anyhow::{Result, ensure};
use clap::Args;
use serde::Serialize;

use super::viewed::{Viewed, cache_bytes};
use crate::render::parse_size;
use crate::{file, progress};

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

/// All that was measured, and where.
#[derive(Serialize)]
struct Report {
    device: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    commit: Option<String>,
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
    let report = Report {
        device: ::engine::gpu::Context::headless()?.adapter(),
        commit: commit(),
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
    if arguments.viewed.json {
        return file::print_json(&report);
    }
    let (width, height) = plan.size;
    let on = format!("{width}×{height} on {}", report.device);
    Ok(write!(
        std::io::stdout().lock(),
        "{on}\n\n{}",
        table(&report.cases)
    )?)
}

/// What git says of the working folder, if it is there.
fn commit() -> Option<String> {
    let output = Command::new("git")
        .args(["describe", "--always", "--dirty"])
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !text.is_empty()).then_some(text)
}
