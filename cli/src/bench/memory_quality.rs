//! `eigentile bench memory-quality`: how good pictures are with how much memory on the GPU.

use std::path::{Path, PathBuf};

use ::benches::engine::{Subject, built_in};
use ::benches::memory_quality::{Plan, Truth, measure, plot, report, side_by_side, table};
use ::engine::gpu::PageFormat;
use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use scenes::Camera;

use super::output::{Plotted, Shown};
use super::viewed::Viewed;
use crate::render::parse_size;
use crate::render::reference::References;
use crate::{file, progress};

/// Measure pictures over memory on the GPU, by format of the page cache and by rank, against full residency and the BTFs.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Scene: .gltf or .glb; without one a grid of tori with a few materials is made.
    #[arg(value_name = "SCENE.gltf")]
    scene: Option<PathBuf>,
    /// Also compares with the uncompressed BTFs NPY_DIR/ARCHIVE.npy, shaded in f64.
    #[arg(long, value_name = "NPY_DIR", requires = "scene")]
    reference: Option<PathBuf>,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "320x180", value_parser = parse_size)]
    size: (u32, u32),
    /// Materials of the scene that is made.
    #[arg(long, value_name = "N", default_value_t = 4, conflicts_with = "scene")]
    materials: usize,
    /// Formats of the page cache; chosen pictures are of the first.
    #[arg(long, value_delimiter = ',', default_value = "half,byte")]
    formats: Vec<Format>,
    /// Shares of the components of each material that are used.
    #[arg(
        long,
        value_name = "SHARE,…",
        value_delimiter = ',',
        default_value = "1,0.5,0.25"
    )]
    ranks: Vec<f64>,
    /// Budgets of each format and rank, from one page for each material to all that the view wants.
    #[arg(long, value_name = "N", default_value_t = 8)]
    steps: usize,
    /// Most memory on the GPU for pages and columns, MiB.
    #[arg(long, value_name = "N", default_value_t = 2048)]
    most_mib: u64,
    /// Writes the chosen pictures as PNG, numbered in the order of the report, and as figure.png too small, right, low rank and full
    /// side by side, above their error maps.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    #[command(flatten)]
    output: Plotted,
    #[command(flatten)]
    viewed: Viewed,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench memory-quality --report memory.html
  eigentile bench memory-quality scene.gltf --tiles tiles --reference npy --report memory.html --csv memory.csv
  eigentile bench memory-quality scene.gltf --tiles http://127.0.0.1:8080 --ranks 1,0.5 --formats half --json

One view settles under each budget. RMSE and HDR-FLIP are of radiance, before tone mapping; PSNR, SSIM, FLIP and ΔE of what a
screen shows. Memory is that of the page cache and of the resident columns. The knee is where the curve of FLIP over the
logarithm of memory lies farthest below the line between its ends (Satopää and others, 2011).";

#[derive(ValueEnum, Clone, Copy, PartialEq, Eq)]
enum Format {
    Half,
    Byte,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let most_bytes = arguments
        .most_mib
        .checked_mul(1 << 20)
        .context("--most-mib is too large")?;
    let mut shares = arguments.ranks.clone();
    shares.sort_by(|a, b| b.total_cmp(a));
    shares.dedup();
    let mut formats = Vec::new();
    for format in &arguments.formats {
        let format = match format {
            Format::Half => PageFormat::Half,
            Format::Byte => PageFormat::Byte,
        };
        if !formats.contains(&format) {
            formats.push(format);
        }
    }
    let plan = Plan {
        size: arguments.size,
        formats,
        shares,
        steps: arguments.steps,
        most_bytes,
    };
    let spinner = progress::spinner("memory and quality", arguments.viewed.json);
    let subject = match &arguments.scene {
        Some(scene) => subject(arguments, scene)?,
        None => built_in(arguments.materials, 1, 0)?,
    };
    let references = arguments
        .reference
        .as_deref()
        .map(|folder| References::open(&subject.scene, folder))
        .transpose()?;
    let (scene, size) = (&subject.scene, plan.size);
    let shade = references.as_ref().map(|references| {
        move |camera: &Camera, ids: &[[u32; 2]]| references.shade(scene, camera, size, ids)
    });
    let truth = shade.as_ref().map(|shade| shade as Truth<'_>);
    let results = measure(&subject, &plan, truth, &|what| {
        spinner.set_message(what.to_owned())
    });
    spinner.finish_and_clear();
    let results = results?;
    if let Some(folder) = &arguments.pictures {
        file::make_folder(folder)?;
        for (number, shot) in results.shots.iter().enumerate() {
            save(
                &folder.join(format!("{number}.png")),
                shot.size,
                shot.shown.as_flattened(),
            )?;
        }
        if let Some(figure) = side_by_side(&results) {
            save(&folder.join("figure.png"), figure.size, &figure.rgb)?;
        }
    }
    let shown = Shown {
        rows: &results.points,
        text: table(&results),
        report: report(&results),
        device: Some(results.adapter.clone()),
        results: &results,
    };
    arguments
        .output
        .give(arguments.viewed.json, &plot(&results), shown)
}

/// sRGB, `[y][x][rgb]`.
fn save(path: &Path, (width, height): (u32, u32), rgb: &[u8]) -> Result<()> {
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(rgb, width, height, ExtendedColorType::Rgb8)?;
    file::write(path, &png)
}

/// The first view of a path; without one the scene's own, or one that shows everything.
fn subject(arguments: &Arguments, path: &Path) -> Result<Subject> {
    let mut subject = arguments.viewed.subject(path, arguments.size, 1, 0)?;
    if let Some(camera) = subject.scene.cameras.first()
        && !arguments.viewed.has_path()
    {
        subject.cameras = vec![*camera];
    }
    Ok(subject)
}
