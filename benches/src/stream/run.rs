//! All contenders over all networks, on two ways of the camera.

use engine::frame::{Budgets, Options};
use engine::gpu::{Context, PageFormat};
use engine::stream::Network;
use scenes::Camera;
use scenes::paper::PaperScene;
use serde::{Deserialize, Serialize};

use super::replay::{FRAMES, Stage};
use super::{Contender, Replay, truth};
use crate::engine::{Subject, built_in};
use crate::{Error, Result};

/// Most views that are compared while the camera moves.
const MOVING_VIEWS: usize = 8;

/// A network with its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NamedNetwork {
    /// How it is called in results.
    pub name: String,
    /// What it is like.
    pub network: Network,
}

/// How the camera goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Way {
    /// It stays at the first view.
    Static,
    /// Along the path, a view each sixtieth of a second; then it stays at the last.
    Moving,
}

/// How to measure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Networks.
    pub networks: Vec<NamedNetwork>,
    /// Bytes of the page cache.
    pub page_cache_bytes: u64,
    /// Bytes of the column cache.
    pub column_cache_bytes: u64,
}

/// All that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// The scene.
    pub name: String,
    /// Its archives.
    pub materials: usize,
    /// Views of the path, one in each sixtieth of a second.
    pub views: usize,
    /// Settings.
    pub plan: Plan,
    /// By network, way and contender.
    pub replays: Vec<Replay>,
}

impl Results {
    /// The replays of a network and way, ours first.
    pub fn of<'a>(&'a self, network: &'a str, way: Way) -> impl Iterator<Item = &'a Replay> + Clone {
        let replays = self.replays.iter();
        replays.filter(move |replay| replay.network == network && replay.way == way)
    }

    /// Bytes that ours takes to 95 % of structural similarity, in parts of those of the best baseline; `None` if one of
    /// them does not get there.
    pub fn share_of_best(&self, network: &str, way: Way) -> Option<f64> {
        let bytes = |replay: &Replay| replay.similar.map(|mark| mark.bytes as f64);
        let mut replays = self.of(network, way);
        let ours = replays
            .find(|replay| replay.contender == Contender::Ours)
            .and_then(bytes)?;
        let baselines = self
            .of(network, way)
            .filter(|replay| replay.contender != Contender::Ours);
        let best = baselines.filter_map(bytes).min_by(f64::total_cmp)?;
        (best > 0.0).then_some(ours / best)
    }
}

/// Measures a scene, whose cameras are a sixtieth of a second apart. `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Invalid`] for a way without views and materials that do not come; those of the engine.
pub fn measure(subject: &Subject, plan: &Plan, progress: &dyn Fn(&str)) -> Result<Results> {
    let (Some(&first), Some(&last)) = (subject.cameras.first(), subject.cameras.last()) else {
        return Err(Error::Invalid {
            what: "the way of the camera",
            found: "without a view".into(),
            expected: "one view or more; give a camera path, or a scene with a mesh",
        });
    };
    let context = Context::headless()?;
    let options = repeatable(plan.size, plan.page_cache_bytes, plan.column_cache_bytes);
    progress("settled views");
    let mut cameras = vec![first];
    let step = subject.cameras.len().div_ceil(MOVING_VIEWS).max(1);
    // Not the first, in which nothing can be there, nor the last, where the camera stays.
    let moving = subject.cameras.len().saturating_sub(1);
    cameras.extend(subject.cameras[..moving].iter().skip(step / 2).step_by(step));
    cameras.push(last);
    let truths = truth::settle(&context, subject, &options, &cameras)?;
    let mut results = Results {
        name: subject.name.clone(),
        materials: subject.scene.archives().len(),
        views: subject.cameras.len(),
        plan: plan.clone(),
        replays: Vec::new(),
    };
    let mut ways = vec![(Way::Static, &subject.cameras[..1], &truths[..1])];
    if subject.cameras.len() > 1 {
        ways.push((Way::Moving, &subject.cameras[..], &truths[1..]));
    }
    for (way, cameras, truths) in &ways {
        let stage = Stage {
            context: &context,
            subject,
            options: &options,
            cameras,
            truths,
            start: &truths[0],
            way: *way,
        };
        for NamedNetwork { name, network } in &plan.networks {
            for contender in Contender::ALL {
                let what = if *way == Way::Static { "standing" } else { "moving" };
                progress(&format!("{name}, {what}: {}", contender.name()));
                let mut replay = stage.replay(name, *network, contender)?;
                if *way == Way::Static {
                    replay.round_trips = stage.round_trips(*network, contender)?;
                }
                results.replays.push(replay);
            }
        }
    }
    Ok(results)
}

/// Views along a path for so many seconds.
pub fn views(seconds: f64) -> usize {
    ((seconds * f64::from(FRAMES)).round() as usize).max(1)
}

/// Part of the flight over the objects in which it is near them, as times from 0 to 1.
const NEAR_TIMES: [f32; 2] = [0.6, 0.85];

/// Views of the objects of the paper's second scene, from the part of its flight that is near them: some fill the picture, others are
/// small behind them.
pub fn near_objects(views: usize) -> Vec<Camera> {
    let flight = PaperScene::Objects.flight();
    let ([from, to], first) = (NEAR_TIMES, flight.keys()[0].time);
    let steps = views.saturating_sub(1).max(1) as f32;
    let time = |view: usize| first + flight.duration() * (from + (to - from) * view as f32 / steps);
    (0..views).map(|view| flight.sample(time(view))).collect()
}

/// Share of the way from what the camera looks at to where it is on its flight over the tori.
const NEAR: f32 = 0.3;

/// The grid of tori of [`built_in`], so near that pixels want its finest mips.
///
/// # Errors
/// None that is expected.
pub fn close_up(materials: usize, views: usize) -> Result<Subject> {
    let mut subject = built_in(materials, views, 0)?;
    for camera in &mut subject.cameras {
        camera.eye = camera.target + NEAR * (camera.eye - camera.target);
    }
    Ok(subject)
}

/// Options with which the same happens in every frame, by the same clock, however fast the machine is.
pub(crate) fn repeatable(size: (u32, u32), page_cache_bytes: u64, column_cache_bytes: u64) -> Options {
    Options {
        size,
        budgets: Budgets {
            page_cache_bytes,
            column_cache_bytes,
            ..Budgets::default()
        },
        page_format: Some(PageFormat::Half),
        wait: true,
        ..Options::default()
    }
}
