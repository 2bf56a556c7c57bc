//! Where results go: the terminal, JSON, CSV, a report. The same for all measurements.

use std::io::Write;
use std::path::PathBuf;

use ::benches::report::{Origin, Report, csv};
use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::file;

/// Arguments of all measurements.
#[derive(Args, Default)]
pub(super) struct Output {
    /// Writes a page with tables, plots and pictures, complete in itself.
    #[arg(long, visible_alias = "html", value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Writes text and tables as Markdown.
    #[arg(long, value_name = "FILE.md")]
    markdown: Option<PathBuf>,
    /// Writes a line for each row of what was measured, with all its digits.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
}

/// Arguments of measurements that draw a plot.
#[derive(Args, Default)]
pub(super) struct Plotted {
    /// Draws a plot of what was measured.
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

/// What was measured, in all its forms.
pub(super) struct Shown<'a, T, R> {
    /// All of it.
    pub(super) results: &'a T,
    /// Lines of the CSV.
    pub(super) rows: &'a [R],
    /// For the terminal.
    pub(super) text: String,
    /// To read.
    pub(super) report: Report,
    /// Adapter and driver, if pictures were drawn.
    pub(super) device: Option<String>,
}

/// JSON of results, and where they are from.
#[derive(Serialize)]
struct Kept<'a, T> {
    #[serde(flatten)]
    origin: &'a Origin,
    #[serde(flatten)]
    results: &'a T,
}

impl Plotted {
    /// Writes the plot, if it is asked for, and all else as [`Output::give`].
    pub(super) fn give<T: Serialize, R: Serialize>(
        &self,
        json: bool,
        svg: &str,
        shown: Shown<'_, T, R>,
    ) -> Result<()> {
        if let Some(path) = &self.plot {
            file::write(path, svg.as_bytes())?;
        }
        self.output.give(json, shown)
    }
}

impl Output {
    /// Writes what is asked for, and prints the text, or JSON.
    pub(super) fn give<T: Serialize, R: Serialize>(&self, json: bool, shown: Shown<'_, T, R>) -> Result<()> {
        let origin = Origin::here(shown.device);
        if let Some(path) = &self.report {
            file::write(path, shown.report.html(&origin).as_bytes())?;
        }
        if let Some(path) = &self.markdown {
            file::write(path, shown.report.markdown(&origin).as_bytes())?;
        }
        if let Some(path) = &self.csv {
            file::write(path, csv(shown.rows)?.as_bytes())?;
        }
        if json {
            return file::print_json(&Kept {
                origin: &origin,
                results: shown.results,
            });
        }
        Ok(write!(std::io::stdout().lock(), "{}", shown.text)?)
    }
}
