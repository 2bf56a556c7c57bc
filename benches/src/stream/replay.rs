//! One contender, one network, one way of the camera.

use std::collections::HashSet;
use std::time::Duration;

use engine::frame::{Engine, Options};
use engine::gpu::Context;
use engine::stream::{Network, Request};
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::baseline::Baseline;
use super::line::Line;
use super::truth::Truth;
use super::{Contender, Way};
use crate::Result;
use crate::engine::Subject;

/// Frames in a second of simulated time: what the engine counts by.
pub(super) const FRAMES: u32 = 60;
/// Longest replay, simulated: five minutes.
const MOST_FRAMES: u32 = 300 * FRAMES;
/// Structural similarity that is taken for the settled picture.
pub(super) const GOAL: f64 = 0.95;
/// A picture is looked at whenever the bytes have grown by this share: of those whose similarity is up to the first, the second and so on.
const LOOKS: [(f64, f64); 3] = [(0.85, 0.1), (0.965, 0.025), (f64::INFINITY, 0.25)];
/// Frames of a round trip where round trips are counted: enough that what is decided in a few frames does not count.
const TRIP_FRAMES: u32 = 40;

/// When something was reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mark {
    /// Simulated, since the start.
    pub seconds: f64,
    /// Over the line, headers and what was lost or given up on the way included.
    pub bytes: u64,
}

/// A picture against the settled picture of its view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// When it was shown.
    pub at: Mark,
    /// Structural similarity of what the screen shows.
    pub ssim: f64,
    /// Of radiance.
    pub rmse: f64,
    /// Of what the screen shows; infinite (null) for equal pictures.
    #[serde(deserialize_with = "crate::report::infinite_if_null")]
    pub psnr_db: f64,
    /// Root mean square error of reflectance that is predicted.
    pub predicted_rms: f64,
    /// The camera was moving.
    pub moving: bool,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Replay {
    /// Name of the network.
    pub network: String,
    /// How the camera went.
    pub way: Way,
    /// Who decided.
    pub contender: Contender,
    /// The first frame in which every material of the first view shows something of its own.
    pub first: Option<Mark>,
    /// Round trips until then, where bytes take no time; the handshake is one. Only of standing views.
    pub round_trips: Option<u32>,
    /// From here on no picture was below 95 % of structural similarity, counted when the camera stood still.
    pub similar: Option<Mark>,
    /// Nothing was left to ask for.
    pub settled: Option<Mark>,
    /// The camera stopped.
    pub stopped: Option<Mark>,
    /// Mean structural similarity while it moved.
    pub moving_ssim: Option<f64>,
    /// Bytes on the line for requests that were given up, and those that giving up saved.
    pub aborted_bytes: u64,
    /// See above.
    pub saved_bytes: u64,
    /// Bytes of pages that came and that no pixel of a shown view ever wanted.
    pub unseen_bytes: u64,
    /// Bytes of records that had come before.
    pub repeated_bytes: u64,
    /// Bytes that were lost and sent again.
    pub resent_bytes: u64,
    /// The pictures that were looked at.
    pub points: Vec<Point>,
}

/// All that a replay needs besides contender and network.
pub(super) struct Stage<'a> {
    pub(super) context: &'a Context,
    pub(super) subject: &'a Subject,
    pub(super) options: &'a Options,
    /// The camera of each frame; it stays at the last.
    pub(super) cameras: &'a [Camera],
    /// Settled views at which pictures are looked at, in the order of `cameras`; the last stands for where it stays.
    pub(super) truths: &'a [Truth],
    /// That of the first camera.
    pub(super) start: &'a Truth,
    pub(super) way: Way,
}

impl Stage<'_> {
    fn engine(&self, contender: Contender, line: &Line) -> Result<Engine> {
        let (context, scene) = (self.context.clone(), &self.subject.scene);
        let (source, options) = (Box::new(line.clone()), self.options.clone());
        Ok(match contender {
            Contender::Ours => Engine::new(context, scene, source, options)?,
            _ => Engine::with_policy(
                context,
                scene,
                source,
                options,
                Box::new(Baseline::new(contender)),
            )?,
        })
    }

    fn camera(&self, frame: u32) -> &Camera {
        &self.cameras[(frame as usize).min(self.cameras.len() - 1)]
    }

    /// # Errors
    /// Those of the engine.
    pub(super) fn replay(&self, name: &str, network: Network, contender: Contender) -> Result<Replay> {
        let free_indices = contender == Contender::Bound;
        let line = Line::with_indices(self.subject.archives.source()?, network, free_indices);
        let mut engine = self.engine(contender, &line)?;
        let mut result = Replay {
            network: name.to_owned(),
            way: self.way,
            contender,
            first: None,
            round_trips: None,
            similar: None,
            settled: None,
            stopped: None,
            moving_ssim: None,
            aborted_bytes: 0,
            saved_bytes: 0,
            unseen_bytes: 0,
            repeated_bytes: 0,
            resent_bytes: 0,
            points: Vec::new(),
        };
        let mut wanted = Wanted::default();
        let mut looked = 0;
        let stop = self.cameras.len() as u32 - 1;
        let mut views = self.truths.iter();
        let mut view = views.next();
        for frame in 0..MOST_FRAMES {
            line.advance(Duration::from_secs(1) / FRAMES);
            let camera = self.camera(frame);
            let stats = engine.step(camera)?;
            let at = Mark {
                seconds: f64::from(frame + 1) / f64::from(FRAMES),
                bytes: line.bytes(),
            };
            wanted.add(&mut engine);
            let first = result.first.is_none() && shows_all(&engine, self.start);
            if first {
                result.first = Some(at);
            }
            if frame == stop && stop > 0 {
                result.stopped = Some(at);
            }
            let moving = frame < stop;
            let due = if moving {
                view.is_some_and(|truth| truth.camera == *camera)
            } else {
                view = self.truths.last();
                let last = result.points.last().filter(|point| !point.moving);
                let similar = last.map_or(0.0, |point| point.ssim);
                let share = LOOKS
                    .iter()
                    .find(|(up_to, _)| similar < *up_to)
                    .map_or(0.0, |look| look.1);
                let grown = (at.bytes - looked) as f64 >= share * looked as f64;
                first || (stats.archives_known > 0 && grown) || stats.settled || frame == stop
            };
            if let Some(truth) = view.filter(|_| due) {
                if let Some(quality) = truth.compare(&engine.show()?) {
                    result.points.push(Point {
                        at,
                        ssim: quality.ssim,
                        rmse: quality.rmse,
                        psnr_db: quality.psnr_db,
                        predicted_rms: stats.predicted_rms,
                        moving,
                    });
                }
                looked = at.bytes;
                if moving {
                    view = views.next();
                }
            }
            if stats.settled && !moving {
                result.settled = Some(at);
                break;
            }
        }
        result.count(&line, wanted.unseen(&engine, &line));
        Ok(result)
    }

    /// Round trips to the first picture: seconds of a line that takes long, and has all the room in the world.
    ///
    /// # Errors
    /// Those of the engine.
    pub(super) fn round_trips(&self, network: Network, contender: Contender) -> Result<Option<u32>> {
        let long = Network {
            bits_per_second: 0,
            round_trip: TRIP_FRAMES * Duration::from_secs(1) / FRAMES,
            jitter: Duration::ZERO,
            loss: 0.0,
            reorder: 0.0,
            ..network
        };
        let line = Line::new(self.subject.archives.source()?, long);
        let mut engine = self.engine(contender, &line)?;
        for frame in 1..=50 * TRIP_FRAMES {
            line.advance(Duration::from_secs(1) / FRAMES);
            engine.step(self.camera(0))?;
            if shows_all(&engine, self.start) {
                return Ok(Some((frame + TRIP_FRAMES / 2) / TRIP_FRAMES));
            }
        }
        Ok(None)
    }
}

impl Replay {
    fn count(&mut self, line: &Line, unseen_bytes: u64) {
        let stats = line.stats();
        self.aborted_bytes = stats.wasted_bytes;
        self.saved_bytes = stats.saved_bytes;
        self.resent_bytes = stats.resent_bytes;
        self.unseen_bytes = unseen_bytes;
        let mut seen = HashSet::new();
        let again = line
            .came()
            .into_iter()
            .filter(|(request, _)| !seen.insert(request.clone()));
        self.repeated_bytes = again.map(|(_, bytes)| bytes).sum();
        let still = || self.points.iter().filter(|point| !point.moving);
        let below = still().rfind(|point| point.ssim < GOAL);
        let since = below.map_or(f64::NEG_INFINITY, |point| point.at.seconds);
        self.similar = still()
            .find(|point| point.at.seconds > since)
            .map(|point| point.at);
        let moving: Vec<f64> = self
            .points
            .iter()
            .filter(|point| point.moving)
            .map(|point| point.ssim)
            .collect();
        self.moving_ssim = (!moving.is_empty()).then(|| moving.iter().sum::<f64>() / moving.len() as f64);
    }
}

/// Whether every material of a view shows something of its own.
fn shows_all(engine: &Engine, truth: &Truth) -> bool {
    let shown: HashSet<&str> = engine
        .shown()
        .filter(|(_, there)| *there)
        .map(|(name, _)| name)
        .collect();
    truth.visible.iter().all(|name| shown.contains(name.as_str()))
}

/// Tiles that some shown view has wanted, and those above them.
#[derive(Default)]
struct Wanted(HashSet<(u16, u32)>);

impl Wanted {
    fn add(&mut self, engine: &mut Engine) {
        let pyramids: Vec<_> = engine.material_infos().map(|info| info.pyramid).collect();
        for vote in engine.votes() {
            let Some(pyramid) = pyramids.get(usize::from(vote.material.0)) else {
                continue;
            };
            let mut at = Some(vote.tile);
            while let Some(tile) = at.filter(|tile| self.0.insert((vote.material.0, *tile))) {
                let parent = pyramid.tile_at(tile).and_then(|tile| pyramid.parent(tile));
                at = parent.and_then(|parent| pyramid.tile_index(parent));
            }
        }
    }

    fn unseen(&self, engine: &Engine, line: &Line) -> u64 {
        let names: Vec<&str> = engine.shown().map(|(name, _)| name).collect();
        let pyramids: Vec<_> = engine.material_infos().map(|info| info.pyramid).collect();
        let unseen = |request: &Request| match request {
            Request::Page { archive, page } => {
                let id = names.iter().position(|name| *name == &**archive);
                let tile = id.and_then(|id| pyramids[id].tile_index(page.tile));
                !id.zip(tile)
                    .is_some_and(|(id, tile)| self.0.contains(&(id as u16, tile)))
            }
            _ => false,
        };
        line.came()
            .iter()
            .filter(|(request, _)| unseen(request))
            .map(|(_, bytes)| bytes)
            .sum()
    }
}
