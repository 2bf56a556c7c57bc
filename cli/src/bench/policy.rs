//! `eigentile bench policy`: ways to choose what is resident, replayed.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use ::benches::policy::{Plan, Synthetic, Trace, generate, plot, record, run as replay, table};
use ::benches::report::Report;
use anyhow::{Context, Result};
use clap::Args;

use super::output::{Plotted, Shown};
use super::viewed::Viewed;
use crate::progress;
use crate::render::parse_size;

/// Measure the choice of what is resident: predicted error over cache size, of ours and of others.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// A trace of votes, or a scene (.gltf, .glb) of which one is recorded; without it one is made: a camera over 100
    /// materials.
    #[arg(value_name = "TRACE|SCENE.gltf")]
    scene: Option<PathBuf>,
    /// Width and height of the pictures whose pixels vote.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    size: (u32, u32),
    /// Slots of the page cache, each.
    #[arg(
        long,
        value_name = "N,N,…",
        value_delimiter = ',',
        default_value = "25,50,100,200,400,800,1600,3200,6400,12800"
    )]
    pages: Vec<usize>,
    /// Pages that can be loaded in a frame.
    #[arg(long, value_name = "N", default_value_t = 64)]
    loads: usize,
    /// Frames of the trace at which the camera stops until all is settled.
    #[arg(long, value_name = "N", default_value_t = 4)]
    stops: usize,
    /// Frames of the trace that is made or recorded.
    #[arg(long, value_name = "N", default_value_t = 180)]
    frames: u32,
    /// Keeps the trace that is made or recorded.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    output: Plotted,
    #[command(flatten)]
    viewed: Viewed,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench policy --plot policy.svg
  eigentile bench policy --record flight.jsonl --pages 400
  eigentile bench policy flight.jsonl --pages 100,1000 --json
  eigentile bench policy scenes/tori/scene.gltf --tiles scenes/tiles --camera scenes/tori/camera.json --record tori.jsonl

Columns: error predicted for what is resident (root mean square of reflectance) when the camera stands still and all is
settled, of the best choice that there is, of ours, of the formulas of Schwartz, Ruiters and Klein 2013 as they stand,
and of the least recently used; the same over all frames of the moving camera; and pages loaded on the way. Columns of
eigen-ABRDFs are given to all. A trace is a line of JSON with the materials, and one for each frame: [[material, tile, pixels], …].";

/// Most slots that a cache is measured with: the exact optimum takes time and memory by it.
const MOST_PAGES: usize = 1 << 17;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(pages) = arguments.pages.iter().find(|pages| **pages > MOST_PAGES) {
        anyhow::bail!("--pages {pages}: at most {MOST_PAGES}");
    }
    anyhow::ensure!(
        arguments.loads > 0,
        "--loads 0: nothing would ever be there, at least 1 is needed"
    );
    let spinner = progress::spinner("policy", arguments.viewed.json);
    let trace = trace(arguments, &|what| spinner.set_message(what.to_owned()))?;
    let plan = Plan {
        budgets: arguments.pages.clone(),
        stops: arguments.stops,
        loads_per_frame: arguments.loads,
    };
    let results = replay(&trace, &plan, &|what| spinner.set_message(what.to_owned()));
    spinner.finish_and_clear();
    let results = results?;
    let svg = plot(&results);
    let text = table(&results);
    let shown = Shown {
        rows: &results.points,
        report: Report::new(format!("What is resident: {}", results.name))
            .plots(vec![svg.clone()])
            .text(&text),
        text,
        device: None,
        results: &results,
    };
    arguments.output.give(arguments.viewed.json, &svg, shown)
}

fn trace(arguments: &Arguments, progress: &dyn Fn(&str)) -> Result<Trace> {
    let trace = match &arguments.scene {
        Some(path) if is_scene(path) => recorded(arguments, path, progress)?,
        Some(path) => {
            let opened = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
            Trace::read(BufReader::new(opened)).with_context(|| path.display().to_string())?
        }
        None => generate(&Synthetic {
            frames: arguments.frames,
            ..Synthetic::default()
        }),
    };
    if let Some(path) = &arguments.record {
        let created = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut to = BufWriter::new(created);
        trace.write(&mut to)?;
        to.flush()
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(trace)
}

fn is_scene(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| extension == "gltf" || extension == "glb")
}

/// The votes of a scene along its camera path.
fn recorded(arguments: &Arguments, path: &Path, progress: &dyn Fn(&str)) -> Result<Trace> {
    let frames = arguments.frames as usize;
    let subject = arguments.viewed.subject(path, arguments.size, frames, 0)?;
    anyhow::ensure!(
        !subject.cameras.is_empty(),
        "{}: nothing to look at: the scene has no mesh, or --frames is 0",
        path.display()
    );
    let name = format!("{}, {} frames", subject.name, subject.cameras.len());
    let source = subject.archives.source()?;
    Ok(record(
        &name,
        &subject.scene,
        source,
        arguments.size,
        &subject.cameras,
        progress,
    )?)
}
