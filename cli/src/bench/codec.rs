//! `eigentile bench codec`: bytes, error and speed of whole archives.

use std::path::{Path, PathBuf};

use ::benches::KeptFactors;
use ::benches::codec::{Material, Plan, Point, measure};
use ::benches::report::Report;
use ::preprocess::Settings;
use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;

use super::output::{Output, Shown};
use crate::{bytes, file, progress};

/// Measure the page codec: bytes by kind and decoding speed of archives that meet given errors.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// BTFs, which are factorized once; or folders of factors that an earlier run has kept.
    #[arg(required = true, value_name = "X.npy|FOLDER")]
    inputs: Vec<PathBuf>,
    /// Folder for factors and archives, one folder in it for each input.
    #[arg(long, value_name = "DIR")]
    keep: PathBuf,
    /// Terms of the factorization; kept factors have theirs.
    #[arg(long, default_value_t = 100)]
    components: u32,
    /// Errors to meet: of the decoded finest mips, relative to the root mean square of the eigen-textures.
    #[arg(
        long,
        value_name = "E,E,…",
        value_delimiter = ',',
        default_value = "0.12,0.05,0.015"
    )]
    targets: Vec<f64>,
    /// Quantizer steps to measure instead, as shares of the BTF's root mean square.
    #[arg(long, value_name = "S,S,…", value_delimiter = ',', conflicts_with = "targets")]
    steps: Vec<f64>,
    /// Times that all pages are decoded; the median counts.
    #[arg(long, value_name = "N", default_value_t = 5)]
    runs: usize,
    /// Memory that the factorization may use, such as 2GiB; without it a quarter of the machine's.
    #[arg(long, value_name = "BYTES", value_parser = bytes::parse)]
    memory: Option<u64>,
    #[command(flatten)]
    output: Output,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench codec leather.npy cloth.npy --keep kept
  eigentile bench codec kept/leather --keep kept --targets 0.05 --json
  eigentile bench codec kept/leather --keep kept --steps 0.1,0.02

DIR/NAME then holds u.npy, v.npy and factors.json, so that the next run need not factorize, and the archives. v.npy, f32,
[component][y][x], is what other codecs are given (benches/peers/codec_peers.py).

Of an archive are told: bytes of pages (all mips), of columns, and of the rest (header, manifest, directory); bits of pages
and rest for each sample of the finest mip; seconds from factors to archive on all cores; megabytes of f32 that one core
decodes in a second.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let quiet = arguments.json;
    let plan = Plan {
        targets: if arguments.steps.is_empty() {
            arguments.targets.clone()
        } else {
            Vec::new()
        },
        steps: arguments.steps.clone(),
        runs: arguments.runs,
    };
    let mut materials = Vec::new();
    for input in &arguments.inputs {
        let (kept, folder) = factors(arguments, input)?;
        let phases = progress::Phases::new(&format!("{} ", kept.name), quiet);
        let measured = measure(&kept, &plan, &folder, &|progress| phases.show(progress));
        phases.finish();
        let material = measured.with_context(|| input.display().to_string())?;
        materials.push(material);
    }
    let text: String = materials.iter().map(text).collect();
    let rows: Vec<Row<'_>> = materials
        .iter()
        .flat_map(|material| material.points.iter().map(move |point| (material, point)))
        .map(|(material, point)| Row {
            material: &material.name,
            point,
        })
        .collect();
    let shown = Shown {
        rows: &rows,
        report: Report::new("Whole archives").text(format!("```\n{text}```\n")),
        text,
        device: None,
        results: &Results {
            generator: concat!("eigentile ", env!("CARGO_PKG_VERSION")),
            materials: &materials,
        },
    };
    arguments.output.give(quiet, shown)
}

/// A line of the CSV.
#[derive(Serialize)]
struct Row<'a> {
    material: &'a str,
    #[serde(flatten)]
    point: &'a Point,
}

/// All that was measured.
#[derive(Serialize)]
struct Results<'a> {
    generator: &'static str,
    materials: &'a [Material],
}

/// The factors of an input, and the folder where they and the archives are.
fn factors(arguments: &Arguments, input: &Path) -> Result<(KeptFactors, PathBuf)> {
    if KeptFactors::is_kept(input) {
        let kept = KeptFactors::load(input)?;
        let folder = arguments.keep.join(&kept.name);
        file::make_folder(&folder)?;
        return Ok((kept, folder));
    }
    let mut settings = Settings {
        components: arguments.components,
        ..Settings::default()
    };
    settings.memory_bytes = arguments.memory.unwrap_or(settings.memory_bytes);
    let phases = progress::Phases::new("", arguments.json);
    let made = ::benches::factorize::run(input, &settings, &|progress| phases.show(progress));
    phases.finish();
    let (btf, factors, factorized) = made?;
    let kept = KeptFactors::new(&btf, factors, Some(factorized));
    let folder = arguments.keep.join(&kept.name);
    kept.save(&folder)?;
    Ok((kept, folder))
}

/// For people.
fn text(material: &Material) -> String {
    let mut text = format!(
        "{}: {} components of {}x{} texels\n{:>9} {:>9} {:>10} {:>10} {:>10} {:>7} {:>9} {:>9}\n",
        material.name,
        material.components,
        material.width,
        material.height,
        "error",
        "step",
        "pages",
        "columns",
        "rest",
        "bits",
        "archive",
        "decode",
    );
    for point in &material.points {
        text += &format!(
            "{:>8.3}% {:>9.5} {:>10} {:>10} {:>10} {:>7.3} {:>7.2} s {:>4.0} MB/s\n",
            100.0 * point.relative_error,
            point.quality,
            bytes::text(point.page_bytes),
            bytes::text(point.column_bytes),
            bytes::text(point.table_bytes),
            point.bits_per_sample,
            point.archive_seconds,
            point.decode.mb_per_s,
        );
    }
    text
}
