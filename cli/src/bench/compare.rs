//! `eigentile bench compare`: two reports of one measurement.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use ::benches::compare::{Figures, compare, table};
use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::file;

/// Compare two JSON reports of one measurement, figure by figure: ratios, noise, and what changed beyond it.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Report of the one version; several of repeated runs, with commas between.
    #[arg(
        value_name = "A.json[,…]",
        value_delimiter = ',',
        num_args = 1,
        required = true
    )]
    before: Vec<PathBuf>,
    /// Report of the other version, likewise.
    #[arg(
        value_name = "B.json[,…]",
        value_delimiter = ',',
        num_args = 1,
        required = true
    )]
    after: Vec<PathBuf>,
    /// Fails if a figure became worse by more than this share and more than noise, for example 5%.
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    fail_over: Option<f64>,
    /// Prints all figures as JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench compare before.json after.json
  eigentile bench compare a1.json,a2.json,a3.json b1.json,b2.json,b3.json --fail-over 5%

Noise is the range of repeated runs: of several reports, and of lists whose names end in \"rounds\"; and, where a median stands beside its
95th percentile, the distance of the two. Less is better of times, bytes and errors, more of similarity, speed, and what is saved or
skipped; of other figures the change is told, and none of them fails.";

/// Longest report.
const MOST_BYTES: u64 = 256 << 20;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let comparison = compare(&figures(&arguments.before)?, &figures(&arguments.after)?);
    ensure!(
        !comparison.figures.is_empty(),
        "the reports have no figure in common: are they of the same measurement?"
    );
    if arguments.json {
        file::print_json(&comparison)?;
    } else {
        write!(std::io::stdout().lock(), "{}", table(&comparison))?;
    }
    if let Some(share) = arguments.fail_over {
        let worse: Vec<&str> = comparison.failures(share).map(|change| &*change.place).collect();
        ensure!(
            worse.is_empty(),
            "{} figures became worse by more than {} %: {}",
            worse.len(),
            100.0 * share,
            worse[..worse.len().min(5)].join(", ")
        );
    }
    Ok(())
}

fn figures(paths: &[PathBuf]) -> Result<Figures> {
    let mut figures = Figures::default();
    for path in paths {
        figures.add(&read(path)?);
    }
    Ok(figures)
}

fn read(path: &Path) -> Result<serde_json::Value> {
    let opened = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
    serde_json::from_reader(BufReader::new(opened).take(MOST_BYTES))
        .with_context(|| format!("{}: not a report in JSON", path.display()))
}

/// "5%" or "0.05".
fn parse_share(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.trim().strip_suffix('%') {
        Some(percent) => (percent.trim(), 0.01),
        None => (text.trim(), 1.0),
    };
    let share = number.parse::<f64>().ok().map(|number| number * unit);
    let share = share.filter(|share| share.is_finite() && *share >= 0.0);
    share.ok_or_else(|| "a share of 0 or more, for example 5% or 0.05".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_percent_or_parts() {
        assert_eq!(parse_share("5%"), Ok(0.05));
        assert_eq!(parse_share("0.25"), Ok(0.25));
        for text in ["", "%", "-1%", "NaN", "five"] {
            assert!(parse_share(text).unwrap_err().contains("5%"), "{text}");
        }
    }
}
