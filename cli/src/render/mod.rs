//! `eigentile render`: pictures of a scene whose materials are streamed.

pub(crate) mod choices;
mod ledger;
mod overlays;
pub(crate) mod picture;
pub(crate) mod reference;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};
use clap::Args;
use engine::angular::Angular;
use engine::frame::{Budgets, Counters, Engine, FrameStats, Options};
use engine::gpu::{Context, PageFormat};
use engine::stream::{self, SourceStats};
use scenes::{Camera, CameraPath, Scene, Shape};
use serde::Serialize;
use viewer::Subject;

use crate::cache::CacheArguments;
use crate::subject::{self, Named};
use crate::{bytes, file, progress};
pub(crate) use ledger::Ledgers;
pub(crate) use reference::Quality;

/// Render a scene, streaming its materials from a folder or over HTTP.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Scene (.gltf or .glb; docs/scenes.md says how materials name BTFs), or one archive (.bsvtf).
    #[arg(value_name = "SCENE.gltf|X.bsvtf")]
    scene: PathBuf,
    /// Tile server (http://HOST:PORT), folder of archives on any web server (http://HOST/FOLDER), or folder on disk;
    /// without it the folder of the scene or archive. With it, an archive may be just its name.
    #[arg(long, value_name = "URL|DIR")]
    tiles: Option<String>,
    /// What a lone archive is shown on: plane, sphere, cylinder or cloth.
    #[arg(long, value_name = "SHAPE", default_value = "plane", value_parser = parse_shape)]
    shape: Shape,
    #[command(flatten)]
    cache: CacheArguments,
    /// Camera path; without it the scene's first camera, or one that shows everything.
    #[arg(long, value_name = "PATH.json")]
    camera: Option<PathBuf>,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    size: (u32, u32),
    /// Frames to render while materials arrive; without it 60 along a path, and one without a path.
    #[arg(long)]
    frames: Option<usize>,
    /// Memory on the GPU for pages and columns, MiB.
    #[arg(long, value_name = "N", default_value_t = 384)]
    cache_mib: u64,
    #[command(flatten)]
    choices: choices::Choices,
    /// Brightens (or darkens) the pictures by so many stops.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,
    /// Also draws the settled view covered with what is known of its pages: mip, components, borders, age, error or skipped;
    /// again, or separated by commas, for more.
    #[arg(long = "overlay", value_name = "NAME", value_delimiter = ',', value_parser = overlays::parse)]
    overlays: Vec<engine::Overlay>,
    /// Folder for the pictures.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Writes what each frame did as JSON.
    #[arg(long, value_name = "S.json")]
    stats: Option<PathBuf>,
    /// Compares with the uncompressed BTFs NPY_DIR/ARCHIVE.npy, shaded in f64.
    #[arg(long, value_name = "NPY_DIR")]
    reference: Option<PathBuf>,
    /// Prints the statistics as JSON, and no progress.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile render scene.gltf --tiles tiles -o pictures
  eigentile render scene.gltf --tiles http://127.0.0.1:8080 --camera flight.json --frames 120 -o pictures
  eigentile render scene.gltf --tiles http://example.org/btf/ --cache default -o pictures
  eigentile render tiles/leather.bsvtf --shape cloth -o pictures
  eigentile render scene.gltf --tiles tiles --cache-mib 16 -o pictures --reference npy --stats stats.json
  eigentile render scene.gltf --tiles tiles --cache-mib 4 --overlay mip,error -o pictures
  eigentile render scene.gltf --tiles tiles --cache-mib 4 --page-format byte --angular hemisphere -o pictures

Leaves frame_0000.png and so on as they were while materials arrived, and settled.png and settled.exr (linear
radiance) of the last view with all that the cache can hold; with --reference also reference.png and error.png, with
--overlay also overlay_NAME.png.";

/// Frames along a path if the user does not say.
const PATH_FRAMES: usize = 60;
/// Most frames, and pixels along a side.
const MAX_FRAMES: usize = 1_000_000;
const MAX_SIDE: u32 = 16_384;
/// Longest time for the manifests of the materials.
const MANIFESTS: Duration = Duration::from_secs(60);
/// Longest time until the last view has settled.
pub(crate) const SETTLE: Duration = Duration::from_secs(600);

/// What was rendered.
#[derive(Serialize)]
struct Statistics {
    adapter: String,
    scene: PathBuf,
    triangles: usize,
    tiles: String,
    width: u32,
    height: u32,
    cache_bytes: u64,
    /// What texels of the page cache were in the end, and how many slots there were.
    page_format: PageFormat,
    page_slots: u32,
    angular: Angular,
    frames: Vec<FrameStats>,
    /// Frames until the last view had settled.
    settling: Vec<FrameStats>,
    /// Work that was not needed, and work that went wrong.
    counters: Counters,
    /// What was asked of the source, and what it took.
    source: SourceStats,
    /// What went wrong without stopping the picture.
    problems: Vec<String>,
    /// Pictures under overlays.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    overlays: Vec<overlays::Overlaid>,
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Named {
        subject,
        tiles,
        notes,
        ..
    } = subject::open(&arguments.scene, arguments.tiles.as_deref())?;
    if !arguments.json {
        notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
    let scene = match subject {
        Subject::Scene(scene) => scene,
        Subject::Archive(name) => scenes::lone::lone(&name, arguments.shape),
    };
    let cameras = cameras(arguments, &scene)?;
    let cache_bytes = arguments
        .cache_mib
        .checked_mul(1 << 20)
        .context("--cache-mib is too large")?;
    let options = Options {
        exposure_stops: arguments.exposure,
        ..arguments.choices.apply(budgeted(arguments.size, cache_bytes))
    };
    file::make_folder(&arguments.output)?;
    let context = Context::headless()?;
    let adapter = context.adapter();
    let open_options = arguments.cache.open_options()?;
    let source = stream::open_with(&tiles, &open_options)?;
    let mut engine = Engine::new(context, &scene, source, options)?;
    engine.wait_for_materials(MANIFESTS)?;
    if engine.source_stats().offline > 0 && !arguments.json {
        eprintln!("note: offline: {tiles} cannot be reached; what the cache on disk has is shown");
    }

    let mut frames = Vec::with_capacity(cameras.len());
    let bar = progress::bar("rendering", cameras.len() as u64, arguments.json);
    for (number, camera) in cameras.iter().enumerate() {
        frames.push(engine.frame(camera)?);
        let picture = arguments.output.join(format!("frame_{number:04}.png"));
        picture::write_png(&picture, arguments.size, &engine.tonemapped()?)?;
        bar.inc(1);
    }
    bar.finish_and_clear();

    let last = cameras.last().context("there is no camera")?;
    let bar = progress::spinner("settling", arguments.json);
    let settling = settle(&mut engine, last);
    bar.finish_and_clear();
    let settling = settling?;
    picture::write_png(
        &arguments.output.join("settled.png"),
        arguments.size,
        &engine.tonemapped()?,
    )?;
    picture::write_exr(&arguments.output.join("settled.exr"), &engine.picture()?)?;
    let overlays = overlays::write(&mut engine, last, &arguments.overlays, &arguments.output)?;

    let quality = match &arguments.reference {
        Some(folder) => {
            let residency_rms = settling.last().map_or(0.0, |stats| stats.predicted_rms);
            let request = reference::Request {
                scene: &scene,
                camera: last,
                exposure_stops: arguments.exposure,
                residency_rms,
                quiet: arguments.json,
            };
            let ledgers = Ledgers::fetch(&tiles, &open_options, &scene)?;
            let references = reference::References::open(&scene, folder)?;
            Some(reference::compare(&engine, &request, &ledgers, &references, &arguments.output)?.0)
        }
        None => None,
    };
    let statistics = Statistics {
        adapter,
        scene: arguments.scene.clone(),
        triangles: scene.triangle_count(),
        tiles,
        width: arguments.size.0,
        height: arguments.size.1,
        cache_bytes,
        page_format: engine.page_format(),
        page_slots: engine.page_slots(),
        angular: engine.angular(),
        frames,
        settling,
        counters: engine.counters(),
        source: engine.source_stats(),
        problems: engine.problems().map(str::to_owned).collect(),
        overlays,
        quality,
    };
    if let Some(path) = &arguments.stats {
        file::write_json(path, &statistics)?;
    }
    if arguments.json {
        return file::print_json(&statistics);
    }
    eprint!("{}", statistics.text(&arguments.output));
    Ok(())
}

/// Frames until nothing moves any more.
///
/// # Errors
/// If that takes longer than [`SETTLE`].
pub(crate) fn settle(engine: &mut Engine, camera: &Camera) -> Result<Vec<FrameStats>> {
    let frames = engine.settle(camera, SETTLE)?;
    let settled = frames.last().is_some_and(|stats| stats.settled);
    let problem = engine
        .problems()
        .last()
        .unwrap_or("does the tile server answer?")
        .to_owned();
    ensure!(
        settled,
        "the picture has not settled within {} s: {problem}",
        SETTLE.as_secs()
    );
    Ok(frames)
}

/// Budgets for a cache of this size: columns are large and few, pages small and many.
pub(crate) fn budgeted(size: (u32, u32), cache_bytes: u64) -> Options {
    let column_cache_bytes = cache_bytes / 3;
    Options {
        size,
        budgets: Budgets {
            page_cache_bytes: cache_bytes - column_cache_bytes,
            column_cache_bytes,
            ..Budgets::default()
        },
        ..Options::default()
    }
}

fn cameras(arguments: &Arguments, scene: &Scene) -> Result<Vec<Camera>> {
    let frames = arguments.frames.unwrap_or(if arguments.camera.is_some() {
        PATH_FRAMES
    } else {
        1
    });
    ensure!(
        (1..=MAX_FRAMES).contains(&frames),
        "--frames is {frames}; it must be 1 to {MAX_FRAMES}"
    );
    if let Some(path) = &arguments.camera {
        return Ok(CameraPath::load(path)?.frames(frames).collect());
    }
    let camera = match (scene.cameras.first(), scene.bounds()) {
        (Some(camera), _) => *camera,
        (None, Some((min, max))) => {
            Camera::framing(min, max, arguments.size.0 as f32 / arguments.size.1 as f32)
        }
        (None, None) => bail!(
            "{}: has neither a camera nor a mesh to look at",
            arguments.scene.display()
        ),
    };
    Ok(vec![camera; frames])
}

/// The folder of the scene, where archives are looked for without --tiles.
pub(crate) fn own_folder(scene: &Path) -> Result<String> {
    let folder = scene
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    Ok(folder
        .to_str()
        .context("the scene's folder has a name that is not UTF-8; give --tiles")?
        .to_owned())
}

pub(crate) fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let sides = text
        .split_once(['x', 'X'])
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    match sides {
        Some((width, height)) if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) => {
            Ok((width, height))
        }
        _ => Err(format!(
            "write WIDTHxHEIGHT such as 1280x720, each from 1 to {MAX_SIDE}"
        )),
    }
}

fn parse_shape(text: &str) -> Result<Shape, String> {
    Shape::named(text).ok_or_else(|| format!("write {}", Shape::ALL.map(Shape::name).join(", ")))
}

impl Statistics {
    /// For people.
    fn text(&self, output: &Path) -> String {
        let mut text = format!(
            "{} frames in {}, on {}\n",
            self.frames.len(),
            output.display(),
            self.adapter
        );
        if let Some(last) = self.settling.last() {
            text += &format!(
                "settled after {} more: {} of {} wanted pages and {} columns resident, {} over the wire, {} on the GPU, predicted error {:.5}\n",
                self.settling.len(),
                last.pages_resident.min(last.pages_wanted),
                last.pages_wanted,
                last.columns_resident,
                bytes::text(last.wire_bytes_total),
                bytes::text(last.gpu_bytes),
                last.predicted_rms,
            );
            if last.format_rms > 0.0 {
                text += &format!(
                    "pages are bytes in {} slots: {:.5} of the predicted error\n",
                    self.page_slots, last.format_rms
                );
            }
        }
        for overlaid in &self.overlays {
            text += &overlaid.text();
        }
        for problem in &self.problems {
            text += &format!("problem: {problem}\n");
        }
        if let Some(quality) = &self.quality {
            text += &quality.text();
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_two_sides() {
        assert_eq!(parse_size("1280x720"), Ok((1280, 720)));
        for text in ["", "1280", "0x4", "4x0", "1280x720x3", "-1x5", "99999x5", "axb"] {
            assert!(parse_size(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_whole_cache_is_given_to_pages_and_columns() {
        for cache in [1, 16 << 20, u64::MAX] {
            let options = budgeted((1, 1), cache);
            assert_eq!(
                options.budgets.page_cache_bytes + options.budgets.column_cache_bytes,
                cache
            );
        }
    }
}
