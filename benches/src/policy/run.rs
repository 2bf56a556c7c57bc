//! Replaying.

use engine::residency::{MaterialInfo, Vote};
use serde::{Deserialize, Serialize};

use super::{
    Trace, optimum,
    ours::Ours,
    paper::Paper,
    recency::Recency,
    view::{Forest, View},
};
use crate::{Error, Result};

/// A way to choose what is resident.
pub(super) trait Replay {
    /// One frame: its votes, and at most this many pages that can be loaded. Returns how many were.
    fn frame(&mut self, votes: &[Vote], loads: usize) -> usize;
    /// Whether a page can be shown.
    fn resident(&self, material: usize, group: usize, tile: usize) -> bool;
    /// Pages loaded since the start.
    fn loads(&self) -> u64;
}

/// What is measured.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Slots of the page cache.
    pub budgets: Vec<usize>,
    /// Frames at which the camera stops, for what is settled; of as many, evenly spread.
    pub stops: usize,
    /// Pages that can be loaded in one frame while the camera moves.
    pub loads_per_frame: usize,
}

/// A policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// `engine::residency`.
    Ours,
    /// Least recently wanted.
    Recency,
    /// The plain formulas of Schwartz, Ruiters, Klein 2013.
    Paper,
    /// The best closed set of pages for each stop, all of it loaded.
    Optimum,
}

/// One policy with one budget.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    /// Which.
    pub policy: Policy,
    /// Slots of the page cache.
    pub pages: usize,
    /// Root mean square error of reflectance that is predicted once settled, over all stops.
    pub settled_rms: f64,
    /// Pages loaded until settled, from an empty cache, mean over the stops.
    pub settled_loads: f64,
    /// The same error over all frames of the moving camera; none for the optimum.
    pub moving_rms: Option<f64>,
    /// Pages loaded in all these frames.
    pub moving_loads: Option<u64>,
}

/// All that was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// The trace's.
    pub name: String,
    /// Pages with votes, mean over the stops: what a cache needs to hold all.
    pub pages_wanted: f64,
    /// Root mean square of reflectance with nothing resident.
    pub empty_rms: f64,
    /// As [`Plan::loads_per_frame`].
    pub loads_per_frame: usize,
    /// By budget, then by policy.
    pub points: Vec<Point>,
}

const POLICIES: [Policy; 3] = [Policy::Ours, Policy::Recency, Policy::Paper];
/// Frames without an end to loading after which a policy is taken as settled all the same.
const MOST_ROUNDS: usize = 10_000;

fn start(policy: Policy, materials: &[MaterialInfo], pages: usize, loads: usize) -> Box<dyn Replay> {
    match policy {
        Policy::Recency => Box::new(Recency::new(materials, pages)),
        Policy::Paper => Box::new(Paper::new(materials, pages)),
        Policy::Ours | Policy::Optimum => Box::new(Ours::new(materials, pages, loads)),
    }
}

/// Lets a policy settle on static votes.
pub(super) fn settle(replay: &mut dyn Replay, votes: &[Vote], loads: usize) {
    for _ in 0..MOST_ROUNDS {
        if replay.frame(votes, loads) == 0 {
            return;
        }
    }
}

/// Replays a trace. `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Trace`] if the trace has no frames, or materials that cannot be.
pub fn run(trace: &Trace, plan: &Plan, progress: &dyn Fn(&str)) -> Result<Results> {
    if trace.frames.is_empty() {
        return Err(Error::Trace("no frames: at least one is needed".into()));
    }
    let materials = trace
        .materials
        .iter()
        .map(super::TraceMaterial::info)
        .collect::<Result<Vec<_>>>()?;
    let forest = Forest::new(&materials);
    let stops = plan.stops.clamp(1, trace.frames.len());
    let stops: Vec<&[Vote]> = (0..stops)
        .map(|stop| trace.frames[stop * trace.frames.len() / stops].as_slice())
        .collect();
    let views: Vec<View> = stops.iter().map(|votes| View::new(&forest, votes)).collect();
    let mean = |values: &mut dyn Iterator<Item = f64>, count: usize| values.sum::<f64>() / count as f64;
    progress("optimum");
    let most = plan.budgets.iter().copied().max().unwrap_or(0);
    let bests: Vec<Vec<f64>> = views
        .iter()
        .map(|view| optimum::best(&forest, view, most))
        .collect();
    let mut points = Vec::new();
    for &pages in &plan.budgets {
        for policy in POLICIES {
            progress(&format!("{policy:?} with {pages} pages"));
            let mut settled_mse = 0.0;
            let mut loads = 0;
            for (votes, view) in stops.iter().zip(&views) {
                let mut replay = start(policy, &materials, pages, plan.loads_per_frame);
                settle(&mut *replay, votes, plan.loads_per_frame);
                settled_mse += view.mse(&forest, |material, group, tile| {
                    replay.resident(material, group, tile)
                });
                loads += replay.loads();
            }
            let mut replay = start(policy, &materials, pages, plan.loads_per_frame);
            let mut moving = trace.frames.iter().map(|votes| {
                replay.frame(votes, plan.loads_per_frame);
                View::new(&forest, votes).mse(&forest, |material, group, tile| {
                    replay.resident(material, group, tile)
                })
            });
            let moving_mse = mean(&mut moving, trace.frames.len());
            points.push(Point {
                policy,
                pages,
                settled_rms: (settled_mse / stops.len() as f64).sqrt(),
                settled_loads: loads as f64 / stops.len() as f64,
                moving_rms: Some(moving_mse.sqrt()),
                moving_loads: Some(replay.loads()),
            });
        }
        points.push(Point {
            policy: Policy::Optimum,
            pages,
            settled_rms: mean(&mut bests.iter().map(|best| best[pages]), stops.len()).sqrt(),
            settled_loads: mean(
                &mut views.iter().map(|view| view.pages(&forest).min(pages) as f64),
                stops.len(),
            ),
            moving_rms: None,
            moving_loads: None,
        });
    }
    Ok(Results {
        name: trace.name.clone(),
        pages_wanted: mean(
            &mut views.iter().map(|view| view.pages(&forest) as f64),
            stops.len(),
        ),
        empty_rms: mean(
            &mut views.iter().map(|view| view.mse(&forest, |_, _, _| false)),
            stops.len(),
        )
        .sqrt(),
        loads_per_frame: plan.loads_per_frame,
        points,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::{Synthetic, generate};

    /// Ours is at most 2 % above the exact optimum in 19 of 20 small instances,
    /// and never more than 10 %. The exceptions are budgets that end within a set of pages which are worth something only
    /// together, as above the structure of a weave.
    #[test]
    fn ours_settles_next_to_the_optimum() {
        let mut ratios = Vec::new();
        for seed in 0..24 {
            let trace = generate(&Synthetic {
                materials: 4,
                side_texels: 256,
                groups: 4,
                frames: 1,
                seed,
            });
            let materials: Vec<_> = trace
                .materials
                .iter()
                .map(|material| material.info().unwrap())
                .collect();
            let forest = Forest::new(&materials);
            let view = View::new(&forest, &trace.frames[0]);
            let best = optimum::best(&forest, &view, 192);
            for pages in (1..=16).map(|step| step * 12) {
                let mut ours = Ours::new(&materials, pages, 16);
                settle(&mut ours, &trace.frames[0], 16);
                let mse = view.mse(&forest, |material, group, tile| {
                    ours.resident(material, group, tile)
                });
                assert!(
                    mse >= best[pages] * (1.0 - 1e-9),
                    "seed {seed}: {mse} where {} is the least",
                    best[pages]
                );
                if best[pages] > 1e-9 * best[0] {
                    ratios.push((mse / best[pages]).sqrt());
                }
            }
        }
        ratios.sort_by(f64::total_cmp);
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        let above = ratios.iter().filter(|ratio| **ratio > 1.02).count();
        let worst = ratios.last().copied().unwrap_or(f64::INFINITY);
        assert!(
            ratios.len() > 60 && mean <= 1.005 && above * 20 <= ratios.len() && worst <= 1.1,
            "mean {mean}, worst {worst}, {above} of {} above 2 %",
            ratios.len()
        );
    }

    #[test]
    fn every_policy_has_no_error_left_with_room_for_all() {
        let trace = generate(&Synthetic {
            materials: 4,
            side_texels: 128,
            groups: 2,
            frames: 2,
            seed: 1,
        });
        let plan = Plan {
            budgets: vec![0, 1000],
            stops: 2,
            loads_per_frame: 3,
        };
        let results = run(&trace, &plan, &|_| {}).unwrap();
        for point in &results.points {
            let expected = if point.pages == 0 { results.empty_rms } else { 0.0 };
            assert!(
                (point.settled_rms - expected).abs() < 1e-6,
                "{point:?} {expected}"
            );
        }
    }
}
