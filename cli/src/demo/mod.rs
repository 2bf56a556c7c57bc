//! `eigentile demo`: everything once, and a page that shows it.

mod materials;
mod page;
mod report;
mod server;
mod shots;

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result};
use clap::Args;
use engine::gpu::Context;
use engine::stream::OpenOptions;
use scenes::showcase;

use crate::render::{self, Ledgers, reference};
use crate::{file, preprocess, serve};
use materials::Recipe;
use report::{Flight, Report};
use server::Server;
use shots::Studio;

/// Synthesize, preprocess, serve and render a scene of four materials; leaves pictures, a table and a page.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Folder for everything.
    #[arg(short, long, default_value = "eigentile-demo", value_name = "DIR")]
    output: PathBuf,
    /// Texels along each side of the materials.
    #[arg(long, default_value_t = 128)]
    material_size: u32,
    /// Terms of the factorization.
    #[arg(long, default_value_t = 100)]
    components: u32,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "960x540", value_parser = render::parse_size)]
    size: (u32, u32),
    /// Frames of the flight.
    #[arg(long, default_value_t = 40)]
    frames: usize,
    /// Prints the report as JSON, and no progress.
    #[arg(long)]
    json: bool,
    /// Serves the materials, the scene and the viewer for browsers in the end, until interrupted.
    #[arg(long)]
    serve: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile demo
  eigentile demo -o /tmp/demo --size 1280x720
  eigentile demo --material-size 256 --json
  eigentile demo --serve

Look at index.html in the folder. What is complete there is used again; remove the folder to start anew.";

/// Caches that the settled pictures are shown for, as shares of what everything in view takes.
const CACHE_SHARES: [f64; 3] = [0.12, 0.35, 1.0];
/// Share for the flight.
const FLIGHT_SHARE: f64 = 0.35;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let start = Instant::now();
    let folder = &arguments.output;
    let pictures = folder.join("pictures");
    for part in ["npy", "tiles", "pictures"] {
        file::make_folder(&folder.join(part))?;
    }
    let quiet = arguments.json;
    let recipe = Recipe {
        size: arguments.material_size,
        job: preprocess::Job {
            components: arguments.components,
            quality: None,
            memory: None,
        },
    };
    let made: Vec<_> = showcase::ARCHIVES
        .iter()
        .map(|name| {
            let made = materials::make(folder, name, &recipe, quiet)?;
            say(
                quiet,
                start,
                &format!(
                    "{name}: {} in the archive",
                    crate::bytes::text(made.archive_bytes)
                ),
            );
            Ok(made)
        })
        .collect::<Result<_>>()?;

    let (scene_path, camera_path) = showcase::save(folder)?;
    // Beside the archives, where the tile server finds it.
    let tiles = folder.join("tiles");
    showcase::save(&tiles)?;
    let scene = scenes::gltf::load(&scene_path)?;
    let path = scenes::CameraPath::load(&camera_path)?;
    let server = Server::start(&folder.join("tiles"))?;
    say(quiet, start, &format!("serving on {}", server.address()));

    let studio = Studio {
        context: Context::headless()?,
        scene: &scene,
        camera: *scene.cameras.first().context("the scene has no camera")?,
        size: arguments.size,
        address: server.address(),
        folder: &pictures,
        quiet,
    };
    let adapter = studio.context.adapter();
    let references = reference::References::open(&scene, &folder.join("npy"))?;
    let ledgers = Ledgers::fetch(server.address(), &OpenOptions::default(), &scene)?;

    // The picture with everything in it comes first: it tells what 100 % is.
    let ample_bytes = ledgers.ample_bytes();
    let mut engine = studio.engine(ample_bytes, Box::new(studio.http()?), arguments.size)?;
    let settled = render::settle(&mut engine, &studio.camera)?;
    let full = *settled.last().context("no frame was drawn")?;
    let request = reference::Request {
        scene: &scene,
        camera: &studio.camera,
        exposure_stops: 0.0,
        residency_rms: full.predicted_rms,
        quiet,
    };
    let (quality, truth) = reference::compare(&engine, &request, &ledgers, &references, &pictures)?;
    let whole_bytes = ledgers.cache_bytes(full.pages_resident, full.columns_resident);
    drop(engine);
    say(quiet, start, &quality.text());

    let refinement = studio.refinement(ample_bytes, full.wire_bytes_total, &truth)?;
    say(quiet, start, "refinement");
    let caches = CACHE_SHARES
        .iter()
        .enumerate()
        .map(|(number, share)| {
            let bytes = ((whole_bytes as f64 * share) as u64).max(1 << 20);
            studio.settled(bytes, &truth, &format!("cache_{}.png", number + 1))
        })
        .collect::<Result<_>>()?;
    say(quiet, start, "caches");
    let flight_bytes = ((whole_bytes as f64 * FLIGHT_SHARE) as u64).max(1 << 20);
    let flight_start = Instant::now();
    let flight_size = (arguments.size.0 / 3 * 2, arguments.size.1 / 3 * 2);
    let frames = studio.flight(&path, arguments.frames, flight_size, flight_bytes)?;
    let flight = Flight::new(frames, flight_bytes, flight_start.elapsed());
    studio.thumbnails(&tiles)?;
    server.stop()?;

    let report = Report {
        adapter,
        triangles: scene.triangle_count(),
        size: arguments.size,
        material_size: arguments.material_size,
        components: arguments.components,
        materials: made,
        quality,
        refinement,
        caches,
        flight,
        seconds: start.elapsed().as_secs_f64(),
    };
    file::write_json(&folder.join("report.json"), &report)?;
    file::write(&folder.join("report.md"), report.markdown().as_bytes())?;
    file::write(&folder.join("index.html"), page::html(&report).as_bytes())?;
    if arguments.json {
        file::print_json(&report)?;
    } else {
        use std::io::Write;
        let mut text = format!(
            "{}\nLook at {}\n",
            report.markdown(),
            folder.join("index.html").display()
        );
        if !arguments.serve {
            text += &format!(
                "In a browser: `eigentile serve {}`, then http://127.0.0.1:8080/#scene/scene\n",
                tiles.display()
            );
        }
        std::io::stdout().lock().write_all(text.as_bytes())?;
    }
    if arguments.serve {
        say(
            quiet,
            start,
            "open the address below in a browser; its #scene/scene is the scene",
        );
        return serve::folder(&tiles);
    }
    Ok(())
}

fn say(quiet: bool, start: Instant, what: &str) {
    if !quiet {
        eprintln!("{:6.1} s  {}", start.elapsed().as_secs_f64(), what.trim_end());
    }
}
