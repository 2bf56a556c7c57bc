//! `eigentile bench replay`: camera and network, recorded, and replayed exactly.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::PathBuf;

use ::benches::replay::{Footage, Trace, replay, table};
use ::benches::stream::{NamedNetwork, close_up, views};
use anyhow::{Context, Result, ensure};
use clap::Args;

use super::stream::parse_network;
use super::viewed::{Viewed, cache_bytes};
use crate::render::{own_folder, parse_size};
use crate::{file, progress};

/// Record a way of the camera over a network, and replay it exactly; fails if something else comes of it than when it was recorded.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The trace: read, or with --record written.
    #[arg(value_name = "TRACE.json")]
    trace: PathBuf,
    /// Records the trace: the arguments below say of what.
    #[arg(long)]
    record: bool,
    /// Times that it is replayed: counts must be the same, times are not.
    #[arg(long, value_name = "N", default_value_t = 1)]
    rounds: usize,
    /// Says what differs from when it was recorded, and does not fail.
    #[arg(long, conflicts_with = "record")]
    changed: bool,
    /// Scene to record: .gltf or .glb; without one a grid of tori.
    #[arg(long, value_name = "SCENE.gltf", requires = "record")]
    scene: Option<PathBuf>,
    /// Materials of the grid of tori, made by formula.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 8,
        requires = "record",
        conflicts_with = "scene"
    )]
    materials: usize,
    /// Seconds that the camera takes along its path.
    #[arg(long, value_name = "S", default_value_t = 2.0, requires = "record")]
    seconds: f64,
    /// The network: 3g, 4g, dsl, wifi, lan, or megabits a second, milliseconds of a round trip, and the chance that a segment is
    /// lost.
    #[arg(long, value_name = "NAME|MBIT,MS[,LOSS]", default_value = "4g", value_parser = parse_network, requires = "record")]
    network: NamedNetwork,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "640x360", value_parser = parse_size, requires = "record")]
    size: (u32, u32),
    /// Memory on the GPU for pages and columns, MiB.
    #[arg(long, value_name = "N", default_value_t = 384, requires = "record")]
    cache_mib: u64,
    #[command(flatten)]
    viewed: Viewed,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench replay flight.json --record --materials 8 --network 3g
  eigentile bench replay flight.json --rounds 5 --json > before.json
  eigentile bench replay flight.json --rounds 5 --json --changed > after.json
  eigentile bench compare before.json after.json
  eigentile bench replay tori.json --record --scene scenes/tori/scene.gltf --tiles scenes/tiles --camera scenes/tori/camera.json

A trace is the camera of each frame, the network, budgets, where scene and archives are, and what came of it: records, bytes, what was
placed, and a hash of the order in which records came. Time is simulated, a sixtieth of a second in each frame, so that a replay by
the same program on the same adapter is exact.";

/// Most materials, seconds and rounds.
const MOST_MATERIALS: usize = 100;
const MOST_SECONDS: f64 = 3600.0;
const MOST_ROUNDS: usize = 1000;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Arguments {
        trace: path,
        rounds,
        materials,
        seconds,
        ..
    } = arguments;
    ensure!(
        (1..=MOST_ROUNDS).contains(rounds),
        "--rounds is {rounds}; it must be 1 to {MOST_ROUNDS}"
    );
    ensure!(
        (1..=MOST_MATERIALS).contains(materials),
        "--materials is {materials}; it must be 1 to {MOST_MATERIALS}"
    );
    ensure!(
        (0.0..=MOST_SECONDS).contains(seconds),
        "--seconds is {seconds}; it must be 0 to {MOST_SECONDS}"
    );
    let spinner = progress::spinner("replay", arguments.viewed.json);
    let mut trace = if arguments.record {
        recorded(arguments)?
    } else {
        let opened = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
        Trace::read(BufReader::new(opened)).with_context(|| path.display().to_string())?
    };
    let replayed = replay(&trace, *rounds, &|what| spinner.set_message(what.to_owned()));
    spinner.finish_and_clear();
    let replayed = replayed?;
    if arguments.record {
        trace.counts = Some(replayed.counts.clone());
        let created = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut to = BufWriter::new(created);
        trace.write(&mut to)?;
        to.flush()
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    if arguments.viewed.json {
        file::print_json(&replayed)?;
    } else {
        write!(std::io::stdout().lock(), "{}", table(&replayed))?;
    }
    let differences = replayed.differences.unwrap_or_default();
    ensure!(
        arguments.changed || differences.is_empty(),
        "{}: not as it was recorded: {}",
        path.display(),
        differences.join(", ")
    );
    Ok(())
}

/// What the arguments say, not yet replayed.
fn recorded(arguments: &Arguments) -> Result<Trace> {
    let count = views(arguments.seconds);
    let (name, footage, cameras) = match &arguments.scene {
        Some(path) => {
            let subject = arguments.viewed.subject(path, arguments.size, count, 0)?;
            let tiles = arguments.viewed.tiles().map_or_else(|| own_folder(path), Ok)?;
            let footage = Footage::Scene {
                path: path.display().to_string(),
                tiles,
            };
            (subject.name, footage, subject.cameras)
        }
        None => {
            let subject = close_up(arguments.materials, count)?;
            let footage = Footage::Made {
                materials: arguments.materials,
            };
            (subject.name, footage, subject.cameras)
        }
    };
    ensure!(!cameras.is_empty(), "nothing to look at: the scene has no mesh");
    let NamedNetwork { name: line, network } = &arguments.network;
    let [page_cache_bytes, column_cache_bytes] = cache_bytes(arguments.cache_mib)?;
    let name = format!("{name} over {line}");
    Ok(Trace {
        page_cache_bytes,
        column_cache_bytes,
        ..Trace::new(name, footage, arguments.size, *network, cameras)
    })
}
