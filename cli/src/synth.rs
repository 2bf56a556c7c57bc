//! `eigentile synth`: a procedural material, ray traced to a BTF.

use std::path::{Path, PathBuf};

use ::preprocess::npy::{BtfWriter, Dtype, Sampling as NpySampling};
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use scenes::synth::{Sampling, Style, SynthOptions, SynthReport, materials, synthesize};
use serde_json::{Value, json};

use crate::{file, progress};

/// Ray trace a procedural material to a BTF: X.npy and X.json.
#[derive(Args)]
#[command(after_help = examples())]
pub(crate) struct Arguments {
    /// Which material; see below.
    material: String,
    /// Where the samples go: X.npy; the directions go to X.json beside it.
    #[arg(short, long, value_name = "X.npy")]
    output: PathBuf,
    /// Texels along each side.
    #[arg(long, default_value_t = 256)]
    size: u32,
    /// Directions of views and lights.
    #[arg(long, value_enum, default_value_t = Directions::Bonn81)]
    sampling: Directions,
    /// Which one of all materials of this kind.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Style: pattern, colours, gloss and relief; 0 is the plain one.
    #[arg(long, default_value_t = 0)]
    variant: u32,
    /// Rays through each texel.
    #[arg(long, default_value_t = SynthOptions::default().samples_per_texel)]
    rays: u32,
    /// Leaves out light that arrives by way of another point of the surface.
    #[arg(long)]
    no_interreflection: bool,
    /// Prints what was done as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

/// Sets of directions.
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Directions {
    /// 31 × 31 up to 75 degrees, for drafts
    Sparse31,
    /// 81 × 81 up to 75 degrees, as UBO2003 and ATRIUM
    Bonn81,
    /// 151 × 151 up to 75 degrees, as UBO2014
    Ubo151,
}

impl Directions {
    pub(crate) fn sampling(self) -> Sampling {
        match self {
            Directions::Sparse31 => Sampling::Sparse31,
            Directions::Bonn81 => Sampling::Bonn81,
            Directions::Ubo151 => Sampling::Ubo151,
        }
    }
}

fn examples() -> String {
    let width = materials()
        .iter()
        .map(|material| material.name.len())
        .max()
        .unwrap_or(0);
    let list = materials()
        .iter()
        .map(|material| format!("  {:width$}  {}\n", material.name, material.description));
    format!(
        "Materials:\n{}\nExamples:\n  eigentile synth leather -o leather.npy\n  \
         eigentile synth cloth -o small.npy --size 64 --seed 7 --variant 12\n  \
         eigentile synth gravel -o gravel.npy --sampling ubo151 --json",
        list.collect::<String>()
    )
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let directions = arguments.sampling.sampling().directions();
    let options = SynthOptions {
        size: arguments.size,
        views: directions.clone(),
        lights: directions,
        seed: arguments.seed,
        style: Style::variant(arguments.variant),
        samples_per_texel: arguments.rays,
        interreflection: !arguments.no_interreflection,
        ..SynthOptions::default()
    };
    let report = synthesize_to(&arguments.material, &options, &arguments.output, arguments.json)?;
    if arguments.json {
        return file::print_json(&summary(&arguments.material, &options, &report));
    }
    eprintln!(
        "{}: {} views x {} lights x {}x{} texels in {:.1} s, {:.1} million rays a second",
        arguments.output.display(),
        options.views.len(),
        options.lights.len(),
        options.size,
        options.size,
        report.seconds,
        report.rays_per_second() / 1e6,
    );
    Ok(())
}

/// Synthesizes to a file of half floats, which gets its name when it is complete.
pub(crate) fn synthesize_to(
    material: &str,
    options: &SynthOptions,
    path: &Path,
    quiet: bool,
) -> Result<SynthReport> {
    // Before a file is begun: what does not exist or is out of range.
    if !materials().iter().any(|known| known.name == material) {
        let names: Vec<_> = materials().iter().map(|known| known.name).collect();
        anyhow::bail!(
            "there is no material {material:?}; there are {}",
            names.join(", ")
        );
    }
    let sampling = NpySampling {
        views: options.views.clone(),
        lights: options.lights.clone(),
        wrap: true,
        cosine: true,
    };
    file::make_folder_of(path)?;
    let mut writer = BtfWriter::create(path, sampling, options.size, options.size, Dtype::F16)?;
    let bar = progress::bar(&format!("synth {material}"), options.views.len() as u64, quiet);
    let mut sink = |_view: usize, block: &[half::f16]| writer.write_f16(block).map_err(std::io::Error::other);
    let report = synthesize(material, options, &mut sink, &|done, _total| {
        bar.set_position(done as u64)
    });
    bar.finish_and_clear();
    let report = report?;
    writer
        .finish()
        .with_context(|| format!("cannot complete {}", path.display()))?;
    Ok(report)
}

fn summary(material: &str, options: &SynthOptions, report: &SynthReport) -> Value {
    json!({
        "material": material,
        "seed": options.seed,
        "width": options.size,
        "height": options.size,
        "views": options.views.len(),
        "lights": options.lights.len(),
        "seconds": report.seconds,
        "build_seconds": report.build_seconds,
        "rays_per_second": report.rays_per_second(),
        "samples_per_second": report.samples_per_second(),
        "primary_rays": report.primary_rays,
        "shadow_rays": report.shadow_rays,
        "bounce_rays": report.bounce_rays,
        "max_value": report.max_value,
        "mean_rgb": report.mean_rgb,
    })
}
