//! `eigentile bench serve`: the tile server under load, beside nginx.

use std::path::PathBuf;

use ::benches::report::Report;
use ::benches::serve::{Plan, measure, plot, table};
use anyhow::{Context, Result};
use clap::Args;

use super::output::{Plotted, Shown};
use crate::progress;

/// Measure the tile server beside nginx: requests per second, latency, and many connections held.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The archive whose pages are asked for.
    #[arg(value_name = "ARCHIVE.bsvtf")]
    archive: PathBuf,
    /// Rounds of each host, by turns.
    #[arg(long, value_name = "N", default_value_t = 5)]
    rounds: usize,
    /// Length of a round.
    #[arg(long, value_name = "N", default_value_t = 3)]
    seconds: u32,
    /// Connections that ask in a round.
    #[arg(long, value_name = "N", default_value_t = 64)]
    connections: usize,
    /// Connections that are held without asking.
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    idle: usize,
    /// Connections that ask beside these.
    #[arg(long, value_name = "N", default_value_t = 1_000)]
    busy: usize,
    /// Requests of the busy ones; 0 leaves this part out.
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    requests: u64,
    #[command(flatten)]
    output: Plotted,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench serve cloth.bsvtf --plot serve.svg
  eigentile bench serve cloth.bsvtf --requests 0
  eigentile bench serve cloth.bsvtf --idle 100 --busy 100 --requests 100000 --json

nginx must be installed. wrk asks in the rounds if it is installed, and else this program, as it does for the connections that are held.";

/// Files beside connections.
const SPARE_FILES: u64 = 64;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let needed = (arguments.idle + arguments.busy) as u64 + SPARE_FILES;
    let possible = tileserver::raise_open_files();
    if let Some(possible) = possible.filter(|possible| *possible < needed && arguments.requests > 0) {
        anyhow::bail!(
            "{needed} open files are needed and the system allows {possible}: fewer --idle and --busy, or raise the hard limit"
        );
    }
    let plan = Plan {
        rounds: arguments.rounds,
        seconds: arguments.seconds,
        connections: arguments.connections,
        idle: arguments.idle,
        busy: arguments.busy,
        requests: arguments.requests,
    };
    let program = std::env::current_exe().context("cannot find this program")?;
    let spinner = progress::spinner("serve", arguments.json);
    let results = measure(&program, &arguments.archive, &plan, &|what| {
        spinner.set_message(what.to_owned())
    });
    spinner.finish_and_clear();
    let results = results?;
    let svg = plot(&results);
    let text = table(&results);
    let shown = Shown {
        rows: &results.races,
        report: Report::new("The tile server beside nginx")
            .plots(vec![svg.clone()])
            .text(&text),
        text,
        device: None,
        results: &results,
    };
    arguments.output.give(arguments.json, &svg, shown)
}
