//! All contenders over all networks, on two ways of the camera.

use engine::frame::{Budgets, Options};
use engine::gpu::{Context, PageFormat};
use engine::stream::Network;
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::replay::{FRAMES, Stage};
use super::{Contender, Replay, truth};
use crate::engine::{Subject, built_in};
use crate::{Error, Result};

/// Most views that are compared while the camera moves.
const MOVING_VIEWS: usize = 16;

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
    /// It stays at the standing view of this number, from an empty cache on.
    Standing(usize),
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
    /// Standing views.
    pub stands: usize,
    /// Views of the path, one in each sixtieth of a second; one if the camera never moved.
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

    /// The replays of a network and contender at the standing views.
    pub fn standing<'a>(
        &'a self,
        network: &'a str,
        contender: Contender,
    ) -> impl Iterator<Item = &'a Replay> + Clone {
        let replays = self.replays.iter();
        replays.filter(move |replay| {
            let stands = matches!(replay.way, Way::Standing(_));
            stands && replay.network == network && replay.contender == contender
        })
    }

    /// Bytes that a contender takes to 95 % of structural similarity, all standing views together; `None` if it does not
    /// get there in all of them.
    pub fn similar_bytes(&self, network: &str, contender: Contender) -> Option<f64> {
        let marks = self.standing(network, contender).map(|replay| replay.similar);
        marks.map(|mark| Some(mark?.bytes as f64)).sum()
    }

    /// The baseline that takes the fewest bytes to 95 % of structural similarity, and how many: all standing views together.
    pub fn best_baseline(&self, network: &str) -> Option<(Contender, f64)> {
        let bytes = Contender::BASELINES
            .into_iter()
            .filter_map(|contender| Some((contender, self.similar_bytes(network, contender)?)));
        bytes
            .filter(|(_, bytes)| *bytes > 0.0)
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Bytes to 95 % of structural similarity in parts of those of the best baseline: all standing views together.
    pub fn share_of_best(&self, network: &str, contender: Contender) -> Option<f64> {
        let (_, best) = self.best_baseline(network)?;
        Some(self.similar_bytes(network, contender)? / best)
    }

    /// The same of the standing view in which it is least, and of that in which it is most.
    pub fn share_by_view(&self, network: &str, contender: Contender) -> Option<[f64; 2]> {
        let (best, _) = self.best_baseline(network)?;
        let bytes = |contender| {
            let marks = self.standing(network, contender).map(|replay| replay.similar);
            marks.map(|mark| mark.map_or(f64::NAN, |mark| mark.bytes as f64))
        };
        let shares = bytes(contender).zip(bytes(best)).map(|(ours, best)| ours / best);
        shares
            .map(|share| [share, share])
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }
}

/// Measures a scene from standing views, each from an empty cache on, and, if it has more than one, along its cameras, which
/// are a sixtieth of a second apart. `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Invalid`] for a scene without views and materials that do not come; those of the engine.
pub fn measure(
    subject: &Subject,
    stands: &[Camera],
    plan: &Plan,
    progress: &dyn Fn(&str),
) -> Result<Results> {
    if stands.is_empty() && subject.cameras.is_empty() {
        return Err(Error::Invalid {
            what: "the way of the camera",
            found: "without a view".into(),
            expected: "one view or more; give a camera path, or a scene with a mesh",
        });
    }
    let context = Context::headless()?;
    let options = repeatable(plan.size, plan.page_cache_bytes, plan.column_cache_bytes);
    progress("settled views");
    let path = match subject.cameras.len() {
        0 | 1 => &[],
        _ => &subject.cameras[..],
    };
    let truths = truth::settle(&context, subject, &options, stands)?;
    let moving = truth::settle(&context, subject, &options, &compared(path))?;
    let mut results = Results {
        name: subject.name.clone(),
        materials: subject.scene.archives().len(),
        stands: stands.len(),
        views: path.len().max(1),
        plan: plan.clone(),
        replays: Vec::new(),
    };
    let stage = |way| match way {
        Way::Standing(at) => Stage {
            context: &context,
            subject,
            options: &options,
            cameras: &stands[at..=at],
            truths: &truths[at..=at],
            start: &truths[at],
            way,
        },
        Way::Moving => Stage {
            context: &context,
            subject,
            options: &options,
            cameras: path,
            truths: &moving[1..],
            start: &moving[0],
            way,
        },
    };
    let ways = (0..stands.len()).map(Way::Standing);
    for way in ways.chain((!path.is_empty()).then_some(Way::Moving)) {
        let stage = stage(way);
        for contender in Contender::ALL {
            // Bytes take no time there, so it is the same on all networks.
            let first = plan.networks.first().map(|named| named.network);
            let trips = match (way, first) {
                (Way::Standing(_), Some(network)) => stage.round_trips(network, contender)?,
                _ => None,
            };
            for NamedNetwork { name, network } in &plan.networks {
                let what = match way {
                    Way::Standing(at) => format!("view {} of {}", at + 1, stands.len()),
                    Way::Moving => "moving".to_owned(),
                };
                progress(&format!("{name}, {what}: {}", contender.name()));
                let mut replay = stage.replay(name, *network, contender)?;
                replay.round_trips = trips;
                results.replays.push(replay);
            }
        }
    }
    Ok(results)
}

/// Views of a path at which pictures are compared: the first, some at equal distances, and the last.
fn compared(path: &[Camera]) -> Vec<Camera> {
    let (Some(&first), Some(&last)) = (path.first(), path.last()) else {
        return Vec::new();
    };
    let mut cameras = vec![first];
    let step = path.len().div_ceil(MOVING_VIEWS).max(1);
    // Not the first, in which nothing can be there, nor the last, where the camera stays.
    let moving = path.len().saturating_sub(1);
    cameras.extend(path[..moving].iter().skip(step / 2).step_by(step));
    cameras.push(last);
    cameras
}

/// Views along a path for so many seconds.
pub fn views(seconds: f64) -> usize {
    ((seconds * f64::from(FRAMES)).round() as usize).max(1)
}

/// Views by which [`middles`] gives so many.
pub fn views_of_middles(parts: usize) -> usize {
    2 * parts + 1
}

/// The middles of equal parts of a path, of which ends and middles are given in turn.
pub fn middles(cameras: &[Camera]) -> Vec<Camera> {
    cameras.iter().skip(1).step_by(2).copied().collect()
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
