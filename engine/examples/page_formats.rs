//! Memory against quality of the formats of the page cache: `cargo run -p engine --example page_formats -- SCENE.gltf TILES`.
//!
//! The first camera of a scene, settled with caches of the same bytes in half floats and in bytes: the predicted error of
//! reflectance, and the measured one of the picture against the same renderer with all pages in half floats. Columns are
//! given to all.

use std::time::Duration;

use engine::{
    frame::{Budgets, Engine, FrameStats, Options},
    gpu::{Context, PageFormat, page_cache::SLOT_BYTES, page_format::rounding_mse},
    metrics::Picture,
    stream,
};
use scenes::{Camera, Scene};

type Failure = Box<dyn std::error::Error>;

const LIMIT: Duration = Duration::from_secs(300);
const SIZE: (u32, u32) = (480, 270);
/// Shares of what the view wants that have room as half floats.
const SHARES: [f64; 6] = [0.05, 0.1, 0.25, 0.5, 0.75, 1.0];

fn settled(
    scene: &Scene,
    camera: &Camera,
    tiles: &str,
    options: Options,
) -> Result<(Engine, Vec<FrameStats>), Failure> {
    let mut engine = Engine::new(Context::headless()?, scene, stream::open(tiles)?, options)?;
    engine.wait_for_materials(LIMIT)?;
    let frames = engine.settle(camera, LIMIT)?;
    Ok((engine, frames))
}

/// Root mean square difference where something is seen.
fn rmse(a: &Picture, b: &Picture, seen: &[[u32; 2]]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for ((a, b), _) in a
        .pixels
        .iter()
        .zip(&b.pixels)
        .zip(seen)
        .filter(|(_, ids)| ids[0] > 0)
    {
        sum += (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
        count += 3;
    }
    (sum / f64::from(count.max(1))).sqrt()
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, tiles] = arguments.as_slice() else {
        return Err("usage: page_formats SCENE.gltf TILES".into());
    };
    let scene = scenes::gltf::open(path.as_ref())?.scene;
    let camera = *scene.cameras.first().ok_or("the scene has no camera")?;
    let options = |page_format, page_cache_bytes| Options {
        size: SIZE,
        page_format,
        budgets: Budgets {
            page_cache_bytes,
            column_cache_bytes: 512 << 20,
            ..Budgets::default()
        },
        ..Default::default()
    };
    let all = options(Some(PageFormat::Half), 256 << 20);
    let (exact, frames) = settled(&scene, &camera, tiles, all)?;
    let (picture, seen) = (exact.picture()?, exact.visibility()?);
    let last = frames.last().ok_or("no frame")?;
    let nothing = frames.iter().map(|stats| stats.predicted_rms).fold(0.0, f64::max);
    let (_, bytes) = settled(&scene, &camera, tiles, options(Some(PageFormat::Byte), 256 << 20))?;
    let rounded = bytes.last().map_or(0.0, |stats| stats.format_rms);
    println!(
        "{} pages wanted; reflectance {nothing:.4}; crest factor {:.2}\n",
        last.pages_wanted,
        rounded / nothing / rounding_mse(1.0).sqrt()
    );
    println!("| MiB | format | slots | resident | predicted | of it rounding | measured | auto |");
    println!("|---:|---|---:|---:|---:|---:|---:|---|");
    for share in SHARES {
        let slots = (f64::from(last.pages_wanted) * share).ceil() as u64;
        let page_bytes = slots * SLOT_BYTES;
        let (chosen, _) = settled(&scene, &camera, tiles, options(None, page_bytes))?;
        for format in [PageFormat::Half, PageFormat::Byte] {
            let (engine, frames) = settled(&scene, &camera, tiles, options(Some(format), page_bytes))?;
            let stats = frames.last().ok_or("no frame")?;
            println!(
                "| {:.2} | {format:?} | {} | {} | {:.5} | {:.5} | {:.5} | {} |",
                page_bytes as f64 / f64::from(1 << 20),
                engine.page_slots(),
                stats.pages_resident,
                stats.predicted_rms,
                stats.format_rms,
                rmse(&engine.picture()?, &picture, &seen),
                if chosen.page_format() == format {
                    "chosen"
                } else {
                    ""
                },
            );
        }
    }
    Ok(())
}
