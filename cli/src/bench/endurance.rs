//! `eigentile bench endurance`: a camera at random for an hour over a line that fails.

use ::benches::endurance::{Plan, endure, table};
use ::benches::report::Report;
use anyhow::{Result, ensure};
use clap::Args;

use super::output::{Output, Shown};
use crate::progress;
use crate::render::parse_size;

/// Let a camera wander over a line that fails, in simulated time: memory, budgets, and the picture in the end; fails if one is not as it should be.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Simulated minutes; an hour takes a minute or so.
    #[arg(long, value_name = "N", default_value_t = 60.0)]
    minutes: f64,
    /// Materials of the grid of tori, made by formula.
    #[arg(long, value_name = "N", default_value_t = 12)]
    materials: usize,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "64x36", value_parser = parse_size)]
    size: (u32, u32),
    /// Of everything that happens.
    #[arg(long, value_name = "N", default_value_t = 20)]
    seed: u64,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench endurance
  eigentile bench endurance --minutes 600 --seed 7 --json

Four frames stand for a second. The connection is lost, records come damaged and twice, the server starts again, the line is slow, half of the time
each for some seconds; the same seed gives the same hour.";

/// Longest time: a week.
const MOST_MINUTES: f64 = 7.0 * 24.0 * 60.0;
/// What the last picture may differ by: slots lie elsewhere, and texture filters round their coordinates there.
const MOST_DIFFERENCE: f64 = 2e-3;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Arguments {
        minutes, materials, ..
    } = *arguments;
    ensure!(
        minutes > 0.0 && minutes <= MOST_MINUTES,
        "--minutes is {minutes}; it must be more than 0 and at most {MOST_MINUTES}"
    );
    ensure!(
        (1..=100).contains(&materials),
        "--materials is {materials}; it must be 1 to 100"
    );
    let plan = Plan {
        minutes,
        materials,
        size: arguments.size,
        seed: arguments.seed,
    };
    let spinner = progress::spinner("endurance", arguments.json);
    let endured = endure(&plan, &|what| spinner.set_message(what.to_owned()));
    spinner.finish_and_clear();
    let endured = endured?;
    let text = table(&endured);
    let shown = Shown {
        rows: std::slice::from_ref(&endured),
        report: Report::new("A camera at random over a line that fails").text(&text),
        text,
        device: Some(::engine::gpu::Context::headless()?.adapter()),
        results: &endured,
    };
    arguments.output.give(arguments.json, shown)?;
    ensure!(endured.broken.is_empty(), "{}", endured.broken.join("; "));
    ensure!(
        endured.difference < MOST_DIFFERENCE,
        "the last picture differs by {:.1e}, more than {MOST_DIFFERENCE:.0e}",
        endured.difference
    );
    Ok(())
}
