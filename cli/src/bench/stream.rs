//! `eigentile bench stream`: what is seen after how many bytes and seconds, under networks.

use std::path::PathBuf;
use std::time::Duration;

use ::benches::engine::Subject;
use ::benches::report::Report;
use ::benches::stream::{
    NamedNetwork, Plan, close_up, measure, middles, plot, table, views, views_of_middles,
};
use ::engine::stream::Network;
use anyhow::{Result, ensure};
use clap::Args;
use scenes::paper::PaperScene;

use super::output::{Plotted, Shown};
use super::viewed::{Viewed, cache_bytes};
use crate::render::parse_size;
use crate::{progress, scene};

/// Measure pictures over bytes and seconds under networks, beside other orders of asking.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Scene: .gltf or .glb; without one fifteen objects with as many materials are made once, in a minute or two.
    #[arg(value_name = "SCENE.gltf")]
    scene: Option<PathBuf>,
    /// A network: 3g, 4g, dsl, wifi, lan, or megabits a second, milliseconds of a round trip, and the chance that a segment
    /// is lost; again for more. All that have names without it.
    #[arg(long = "network", value_name = "NAME|MBIT,MS[,LOSS]", value_parser = parse_network)]
    networks: Vec<NamedNetwork>,
    /// Connections of each network, instead of as many as the client has to a tile server.
    #[arg(long, value_name = "N")]
    connections: Option<usize>,
    /// Requests under way on a connection, instead of the one of HTTP/1.1: more are HTTP/2.
    #[arg(long, value_name = "N")]
    streams: Option<usize>,
    /// Records of one archive in one answer, instead of as many as the client asks of a tile server; 1 is without batches.
    #[arg(long, value_name = "N")]
    batch: Option<usize>,
    /// Width and height of the pictures, pixels.
    #[arg(long, default_value = "640x360", value_parser = parse_size)]
    size: (u32, u32),
    /// Folder of the scene that is made; what is there is used again.
    #[arg(
        long,
        value_name = "DIR",
        default_value = "eigentile-scenes/measured",
        conflicts_with = "scene"
    )]
    made: PathBuf,
    /// Measures a grid of tori with so many materials made by formula instead, which takes seconds.
    #[arg(long, value_name = "N", conflicts_with_all = ["scene", "made"])]
    materials: Option<usize>,
    /// Seconds that the camera takes along its path; with 0 it does not move.
    #[arg(long, value_name = "S", default_value_t = 6.0)]
    seconds: f64,
    /// Standing views: in the middles of so many parts of the path that take equal times.
    #[arg(long, value_name = "N", default_value_t = 4)]
    stands: usize,
    /// Memory on the GPU for pages and columns, MiB, of every order.
    #[arg(long, value_name = "N", default_value_t = 384)]
    cache_mib: u64,
    #[command(flatten)]
    output: Plotted,
    #[command(flatten)]
    viewed: Viewed,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench stream --plot stream.svg
  eigentile bench stream --materials 4 --size 256x144 --network 4g
  eigentile bench stream --network dsl --network 2,300,0.02
  eigentile bench stream scenes/tori/scene.gltf --tiles scenes/tiles --camera scenes/tori/camera.json --network 4g --json

Time is simulated, a sixtieth of a second in each frame, so results are the same on every machine. First picture: the first
frame in which every material in view shows something of its own; its round trips are counted where bytes take no time, and
the handshake is one. 95 % SSIM: from there on no picture was further from the settled one of its view. Bytes are those
on the line, with headers, what was lost, and what was given up on the way. Every order has the same budgets, cancels what
it does not want any more, and asks for children before their parents are there. Breadth first: all groups and tiles of a mip
before the next. Demand: the tiles that pixels want now, least recently wanted go. 2013: Schwartz, Ruiters, Klein, P = w·v.
Bound: no order but what none can do, with indices for nothing and the exact best schedule. Standing views begin with empty
caches each; their figures are means, and bytes of the best baseline those of the order that takes fewest in all of them.";

/// Longest way of the camera, seconds.
const MOST_SECONDS: f64 = 120.0;
/// Most connections, requests on one, and records in an answer.
const MOST_STREAMS: usize = 256;
/// Most standing views.
const MOST_STANDS: usize = 100;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    ensure!(
        (0.0..=MOST_SECONDS).contains(&arguments.seconds),
        "--seconds is {}; it must be 0 to {MOST_SECONDS}",
        arguments.seconds
    );
    for (name, value) in [
        ("--connections", arguments.connections.unwrap_or(1)),
        ("--streams", arguments.streams.unwrap_or(1)),
        ("--batch", arguments.batch.unwrap_or(1)),
        ("--materials", arguments.materials.unwrap_or(1)),
    ] {
        ensure!(
            (1..=MOST_STREAMS).contains(&value),
            "{name} is {value}; it must be 1 to {MOST_STREAMS}"
        );
    }
    ensure!(
        arguments.stands <= MOST_STANDS && (arguments.stands > 0 || arguments.seconds > 0.0),
        "--stands is {}; it must be at most {MOST_STANDS}, and 1 at least if the camera does not move",
        arguments.stands
    );
    let [page_cache_bytes, column_cache_bytes] = cache_bytes(arguments.cache_mib)?;
    let spinner = progress::spinner("stream", arguments.viewed.json);
    let (moving, middle) = (views(arguments.seconds), views_of_middles(arguments.stands));
    let mut subject = match &arguments.scene {
        Some(path) => arguments.viewed.subject(path, arguments.size, moving, middle)?,
        None => match arguments.materials {
            Some(materials) => Subject {
                flight: close_up(materials, middle)?.cameras,
                ..close_up(materials, moving)?
            },
            None => made(arguments, moving, middle)?,
        },
    };
    let stands = middles(&std::mem::take(&mut subject.flight));
    let plan = Plan {
        size: arguments.size,
        networks: networks(arguments),
        page_cache_bytes,
        column_cache_bytes,
    };
    let results = measure(&subject, &stands, &plan, &|what| {
        spinner.set_message(what.to_owned())
    });
    spinner.finish_and_clear();
    let results = results?;
    let svg = plot(&results);
    let text = table(&results);
    let shown = Shown {
        rows: &results.replays,
        report: Report::new(format!("Under networks: {}", results.name))
            .plots(vec![svg.clone()])
            .text(&text),
        text,
        device: Some(::engine::gpu::Context::headless()?.adapter()),
        results: &results,
    };
    arguments.output.give(arguments.viewed.json, &svg, shown)
}

/// The objects of the paper's second scene and their flight.
fn made(arguments: &Arguments, moving: usize, middle: usize) -> Result<Subject> {
    let (path, tiles) = scene::objects_to_measure(&arguments.made, arguments.viewed.json)?;
    let flight = PaperScene::Objects.flight();
    Ok(Subject {
        name: "objects".into(),
        scene: scenes::gltf::open(&path)?.scene,
        cameras: flight.frames(moving).collect(),
        flight: flight.frames(middle).collect(),
        archives: arguments.viewed.archives(tiles.display().to_string())?,
    })
}

fn networks(arguments: &Arguments) -> Vec<NamedNetwork> {
    let named = Network::NAMES.iter().filter_map(|name| {
        let network = Network::named(name)?;
        let name = (*name).to_owned();
        Some(NamedNetwork { name, network })
    });
    let mut networks = match arguments.networks.is_empty() {
        true => named.collect(),
        false => arguments.networks.clone(),
    };
    for NamedNetwork { network, .. } in &mut networks {
        network.connections = arguments.connections.unwrap_or(network.connections);
        network.streams = arguments.streams.unwrap_or(network.streams);
        network.batch = arguments.batch.unwrap_or(network.batch);
    }
    networks
}

/// A name, or megabits a second, milliseconds, and loss.
pub(super) fn parse_network(text: &str) -> Result<NamedNetwork, String> {
    if let Some(network) = Network::named(text) {
        let name = text.to_owned();
        return Ok(NamedNetwork { name, network });
    }
    let wrong = || {
        format!(
            "one of {}, or MBIT,MS[,LOSS], for example 8,50,0.01: more than 0 and at most 100000 megabits a second, 0 to \
             10000 milliseconds, a loss of 0 to 0.5",
            Network::NAMES.join(", ")
        )
    };
    let parts = text.split(',').map(|part| part.trim().parse::<f64>());
    let parts: Vec<f64> = parts.collect::<Result<_, _>>().map_err(|_| wrong())?;
    let (mbit, milliseconds, loss) = match parts[..] {
        [mbit, milliseconds] => (mbit, milliseconds, 0.0),
        [mbit, milliseconds, loss] => (mbit, milliseconds, loss),
        _ => return Err(wrong()),
    };
    let bits = (mbit * 1e6).round();
    let fits =
        (1.0..=1e11).contains(&bits) && (0.0..=1e4).contains(&milliseconds) && (0.0..=0.5).contains(&loss);
    if !fits {
        return Err(wrong());
    }
    Ok(NamedNetwork {
        name: text.to_owned(),
        network: Network::line(bits as u64, Duration::from_secs_f64(milliseconds / 1e3), loss),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_have_names_or_figures() {
        assert_eq!(
            parse_network("dsl").unwrap().network,
            Network::named("dsl").unwrap()
        );
        let line = Network::line(1_600_000, Duration::from_millis(150), 0.01);
        assert_eq!(parse_network("1.6, 150, 0.01").unwrap().network, line);
        for text in [
            "", "5g", "8", "0,50", "8,-1", "8,50,1", "NaN,1", "8,50,0,0", "inf,5",
        ] {
            let error = parse_network(text).unwrap_err();
            assert!(error.contains("MBIT,MS"), "{text}: {error}");
        }
    }
}
