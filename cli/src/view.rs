//! `eigentile view`: a window onto a scene, or onto one archive.

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use clap::Args;
use engine::frame::Options;
use scenes::CameraPath;
use viewer::Link;
use window::{Save, Show};

use crate::cache::CacheArguments;
use crate::render::{budgeted, choices::Choices, parse_size, picture};
use crate::subject::{self, Named};

/// Look at a scene or a material in a window while it streams.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Scene (.gltf or .glb), or one archive (.bsvtf), which is shown on a plane, sphere, cylinder or cloth.
    #[arg(value_name = "SCENE.gltf|X.bsvtf")]
    subject: PathBuf,
    /// Tile server (http://HOST:PORT), folder of archives on any web server (http://HOST/FOLDER), or folder on disk;
    /// without it the folder of the scene or archive. With it, an archive may be just its name.
    #[arg(long, value_name = "URL|DIR")]
    tiles: Option<String>,
    #[command(flatten)]
    cache: CacheArguments,
    /// Size of the window in pixels.
    #[arg(long, default_value = "1280x800", value_parser = parse_size)]
    size: (u32, u32),
    /// Memory on the GPU for pages and columns, MiB; a slider changes it.
    #[arg(long, value_name = "N", default_value_t = 384)]
    cache_mib: u64,
    #[command(flatten)]
    choices: Choices,
    /// Camera, light, exposure, shape and overlay to begin with, as the panel's section "Link" gives it.
    #[arg(long, value_name = "LINK", default_value = "")]
    link: String,
    /// Camera path to replay with Space.
    #[arg(long, value_name = "PATH.json")]
    camera: Option<PathBuf>,
    /// Folder for pictures, videos and recorded camera paths.
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    output: PathBuf,
    /// Begins without the panel; P opens it.
    #[arg(long)]
    no_panel: bool,
    /// Tells on standard output what happens, a JSON object a line: opened, first_picture, settled, connection, command,
    /// written, closed.
    #[arg(long)]
    events: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile view scene.gltf --tiles tiles
  eigentile view scene.gltf --tiles http://127.0.0.1:8080 --cache default
  eigentile view tiles/leather.bsvtf --link shape=cloth
  eigentile view leather --tiles http://127.0.0.1:8080 --link 'shape=sphere&overlay=mip&ev=0.5'
  xvfb-run eigentile view scene.gltf --events    (on a machine without a screen)

In the window:
  drag            turn around the middle        right drag    move sideways
  wheel           nearer, further               L+drag        turn the light
  W A S D Q E     move                          F             orbit or fly
  M  next shape   O  next overlay   [ ]  exposure   B  beside the picture with all resident
  V  record, Space  replay a camera path        T  turntable
  C  picture to PNG   X  radiance to EXR        P  panel   ?  all keys

If the host of the archives does not answer, the window says so and goes on showing what it has; F5 asks again.";

/// Writes pictures as the other commands do.
const SAVE: Save = Save {
    png: picture::write_png,
    exr: picture::write_exr,
};

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Named {
        subject,
        name,
        tiles,
        notes,
    } = subject::open(&arguments.subject, arguments.tiles.as_deref())?;
    notes.iter().for_each(|note| eprintln!("note: {note}"));
    let cache_bytes = arguments
        .cache_mib
        .checked_mul(1 << 20)
        .context("--cache-mib is too large")?;
    let options = Options {
        wait: false,
        ..arguments.choices.apply(budgeted(arguments.size, cache_bytes))
    };
    let path = arguments.camera.as_deref().map(CameraPath::load).transpose()?;
    let link = Link::parse(&arguments.link).context("--link")?;
    let open_options = arguments.cache.open_options()?;
    let open = move || engine::stream::open_with(&tiles, &open_options);
    // What is wrong with what was typed is said before a window opens.
    drop(open()?);
    window::run(Show {
        title: name,
        subject,
        open: Box::new(open),
        options,
        link,
        path,
        folder: arguments.output.clone(),
        save: SAVE,
        panel: !arguments.no_panel,
        events: arguments.events,
    })
}
