//! `eigentile bench tables`: kept results into the tables and plots of a document.

use std::fs;
use std::path::PathBuf;

use ::benches::results::{fill, open};
use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::file;

/// Write tables and plots of a document from results that were kept as JSON.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Results, each as KIND.json, as --json prints them.
    #[arg(long, value_name = "DIR", default_value = "benches/results")]
    results: PathBuf,
    /// The document.
    #[arg(value_name = "FILE.md", default_value = "docs/results.md")]
    document: PathBuf,
    /// Writes nothing, and fails if something would change.
    #[arg(long)]
    check: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench policy --json > benches/results/policy.json && eigentile bench tables
  eigentile bench tables --check

A table goes between the lines <!-- table: NAME --> and <!-- end -->. NAME is the kind of results, or the kind and a part: codec,
engine-frames, engine-processor, engine-skipped, engine-saved, engine-memory, factorize, memory-quality, policy, scale,
serve-races, serve-held, stream-standing, stream-moving, time-error. Plots are written where the document names them: KIND.svg.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.document;
    let document = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let results = open(&arguments.results)?;
    let mut files = vec![(path.clone(), fill(&document, &results)?)];
    let folder = path.parent().unwrap_or_else(|| "".as_ref());
    for (name, svg) in results.iter().flat_map(|kept| &kept.plots) {
        // Of a picture `![…](images/policy.svg)` the place is told beside the document.
        let place = document
            .split(['(', ')'])
            .find(|place| place.rsplit('/').next() == Some(name.as_str()));
        if let Some(place) = place {
            files.push((folder.join(place), svg.clone()));
        }
    }
    let changes = files.iter().filter(|(path, text)| {
        fs::read_to_string(path).ok().as_ref() != Some(text) // what cannot be read has to be written
    });
    let changes: Vec<_> = changes.collect();
    for (path, text) in &changes {
        ensure!(
            !arguments.check,
            "{} is not what the results in {} give; run `cargo xtask report`",
            path.display(),
            arguments.results.display()
        );
        file::make_folder_of(path)?;
        file::write(path, text.as_bytes())?;
        eprintln!("{}", path.display());
    }
    Ok(())
}
