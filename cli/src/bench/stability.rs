//! `eigentile bench stability`: BTFs that are hard on floating point numbers, against stated bounds.

use ::benches::report::Report;
use ::benches::stability::{Row, Sizes, cases, pictures, pictures_table, run as run_suite, table};
use anyhow::{Result, ensure};
use clap::Args;
use serde::Serialize;

use super::output::{Output, Shown};
use crate::progress;

/// Measure BTFs that are hard on floating point numbers, and compare with stated bounds; fails if one is broken.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Larger cases: a minute or two instead of seconds.
    #[arg(long)]
    full: bool,
    #[command(flatten)]
    output: Output,
    /// Draws the cases in views that are hard to draw, against f64 shading of samples and archives.
    #[arg(long)]
    pictures: bool,
    /// Prints all that was measured, and the bounds with their reasons, as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench stability
  eigentile bench stability --full --json
  eigentile bench stability --pictures

Columns: largest deviations of both factors from orthonormal ones; error of the best product of this rank, from an f64
decomposition; error of ours, and as we state it; what half floats lose; what the codec loses; error of the decoded
archive, and as its ledger states it. All errors are relative to the root mean square of the BTF. Each case also goes
by the bounds that are listed with --json.

With --pictures: what the archive is off by, as its ledger states it; the worst picture, and in which view; the worst pixel, in parts of
what the archive's own error at the samples that it shows explains; and the largest difference to the decoded archive in f64.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let sizes = if arguments.full { Sizes::Full } else { Sizes::Small };
    let spinner = progress::spinner("stability", arguments.json);
    if arguments.pictures {
        let rows = pictures(&cases(sizes), &|case| spinner.set_message(case.to_owned()));
        spinner.finish_and_clear();
        let rows = rows?;
        let text = pictures_table(&rows);
        let shown = Shown {
            rows: &rows,
            report: Report::new("Hard BTFs in hard views").text(format!("```\n{text}```\n")),
            text,
            device: None,
            results: &Suite { cases: &rows },
        };
        arguments.output.give(arguments.json, shown)?;
        let broken = rows.iter().filter(|row| !row.broken.is_empty()).count();
        ensure!(
            broken == 0,
            "{broken} of {} pictures break their bounds",
            rows.len()
        );
        return Ok(());
    }
    let rows = run_suite(sizes, &|case| spinner.set_message(case.to_owned()));
    spinner.finish_and_clear();
    let text = table(&rows);
    let shown = Shown {
        rows: &rows,
        report: Report::new("Hard on floating point numbers").text(format!("```\n{text}```\n")),
        text,
        device: None,
        results: &Suite { cases: &rows },
    };
    arguments.output.give(arguments.json, shown)?;
    verdict(&rows)
}

/// All that was measured.
#[derive(Serialize)]
struct Suite<'a, R> {
    cases: &'a [R],
}

/// An error if a bound is broken; what it was has been printed then.
fn verdict(rows: &[Row]) -> Result<()> {
    let broken = rows.iter().filter(|row| !row.broken.is_empty()).count();
    ensure!(broken == 0, "{broken} of {} cases break their bounds", rows.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use ::benches::stability::{Bounds, Shape};

    use super::*;

    #[test]
    fn one_broken_bound_is_a_failure() {
        let row = |broken: &[&str]| Row {
            case: "constant",
            shape: Shape {
                views: 1,
                lights: 1,
                width: 1,
                height: 1,
            },
            measured: None,
            bounds: Bounds::DEFAULT,
            reason: "none",
            broken: broken.iter().map(|&what| what.to_owned()).collect(),
        };
        assert!(verdict(&[row(&[]), row(&[])]).is_ok());
        let rows = [row(&[]), row(&["rank error is 1, more than 0"])];
        let error = verdict(&rows).unwrap_err().to_string();
        assert_eq!(error, "1 of 2 cases break their bounds");
        let table = table(&rows);
        assert!(
            table.contains("FAIL\n    ! rank error is 1, more than 0\n"),
            "{table}"
        );
    }
}
