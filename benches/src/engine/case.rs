//! All measurements of one scene.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use engine::frame::{Budgets, Engine, FrameStats, Options};
use engine::gpu::page_cache::SLOT_BYTES;
use engine::gpu::{Context, PageFormat, ShadingWork};
use engine::residency::MaterialId;
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::{Duel, Motion, Saved, Stand, Subject};
use crate::{Error, Result};

/// Longest time until a view has settled.
const LIMIT: Duration = Duration::from_secs(300);
/// Views whose shading is counted.
const COUNTED_VIEWS: usize = 4;
/// The cache of the flight from an empty one, in parts of what the whole way wants: some of it has to be swapped.
const FLIGHT_SHARE: f64 = 0.5;

/// How to measure.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Plan {
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Bytes of the page cache; must hold all that the way wants.
    pub page_cache_bytes: u64,
    /// Bytes of the column cache, likewise.
    pub column_cache_bytes: u64,
    /// Times that the way is gone with and without virtual textures, and in flight.
    pub rounds: usize,
    /// Frames in which the camera stands still.
    pub static_frames: usize,
}

impl Plan {
    /// Nothing waits within a frame, as in programs with a window.
    pub(super) fn options(&self) -> Options {
        Options {
            size: self.size,
            budgets: Budgets {
                page_cache_bytes: self.page_cache_bytes,
                column_cache_bytes: self.column_cache_bytes,
                ..Budgets::default()
            },
            // Budgets are slots of half floats, and all that is wanted has room.
            page_format: Some(PageFormat::Half),
            wait: false,
            ..Options::default()
        }
    }
}

/// What was measured of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Case {
    /// The subject's.
    pub name: String,
    /// Archives, and triangles.
    pub materials: usize,
    /// Of all instances.
    pub triangles: usize,
    /// Views on the way.
    pub views: usize,
    /// Largest predicted error of a view with the caches of the plan: 0 if all that it wants is resident.
    pub resident_rms: f64,
    /// With and without virtual textures.
    pub duel: Duel,
    /// The camera stands still.
    pub still: Stand,
    /// From an empty cache that holds half of what the way wants.
    pub motion: Motion,
    /// Work that was not needed.
    pub skipped: Skipped,
    /// What that saves.
    #[serde(default)]
    pub saved: Saved,
    /// Bytes on the GPU with all resident: caches, tables, meshes, targets.
    pub gpu_bytes: u64,
    /// Bytes of records and decoded pages on the host, likewise.
    pub host_bytes: u64,
}

/// Work that was not needed, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Skipped {
    /// Pages of all materials, all groups, all mips.
    pub pages: u64,
    /// Pages that some view of the way wants.
    pub pages_wanted: u64,
    /// Pages with votes in a view, mean.
    pub pages_wanted_in_a_view: f64,
    /// Pixels of the counted views, and those that show no mesh.
    pub pixels: u64,
    /// See above.
    pub pixels_empty: u64,
    /// Component groups of the pixels of the counted views: fetched, left out for the small error they make, absent.
    pub groups: [u64; 3],
    /// Workgroups of 64 pixels that shading started in the counted views, and those that all pixels would take.
    pub workgroups: [u64; 2],
    /// Bytes of votes read back in a moving frame, mean, and those of all counters.
    pub vote_bytes: [f64; 2],
}

/// Measures a scene. `progress` gets words on what is next.
///
/// # Errors
/// [`Error::Invalid`] for a way without views or materials that do not come; those of the engine.
pub fn measure(subject: &Subject, plan: &Plan, progress: &dyn Fn(&str)) -> Result<Case> {
    let (Some(&last), false) = (subject.cameras.last(), subject.flight.is_empty()) else {
        return Err(Error::Invalid {
            what: "the way of the camera",
            found: "without a view".into(),
            expected: "one view or more; give a camera path, or a scene with a mesh",
        });
    };
    let context = Context::headless()?;
    let mut engine = start(context.clone(), subject, plan)?;
    let mut skipped = Skipped::default();
    let (mut resident_rms, mut saved) = (0f64, Saved::default());
    let (watch, mut upload_ms) = (Instant::now(), 0.0);
    for (number, camera) in subject.cameras.iter().enumerate() {
        progress(&format!("{}: loading view {}", subject.name, number + 1));
        let frames = frames(&mut engine, camera)?;
        upload_ms += frames.iter().map(|stats| stats.ms.upload).sum::<f64>();
        resident_rms = frames
            .last()
            .map_or(0.0, |stats| stats.predicted_rms)
            .max(resident_rms);
    }
    let load_ms = watch.elapsed().as_secs_f64() * 1e3;
    pages(&mut engine, &subject.cameras, &mut skipped, &mut saved)?;
    let all = skipped.pages as f64 / skipped.pages_wanted.max(1) as f64;
    saved.load_ms = [load_ms, load_ms * all];
    saved.upload_ms = [upload_ms, upload_ms * all];
    progress(&format!("{}: with and without", subject.name));
    let (duel, vote_bytes) = Duel::measure(&mut engine, &subject.cameras, plan.rounds)?;
    let tiles: u32 = engine
        .material_infos()
        .map(|info| info.pyramid.tile_count())
        .sum();
    skipped.vote_bytes = [vote_bytes, f64::from(tiles) * 4.0];
    settle(&mut engine, &last)?;
    progress(&format!("{}: standing still", subject.name));
    let (still, stats) = Stand::measure(&mut engine, &last, plan.static_frames)?;
    saved.drawing(&mut engine, &last, plan.rounds)?;
    saved.feedback_ms = [0.0, duel.virtual_ms.feedback];
    let step = subject.cameras.len().div_ceil(COUNTED_VIEWS);
    for camera in subject.cameras.iter().step_by(step) {
        settle(&mut engine, camera)?;
        count(&mut engine, &mut skipped)?;
    }
    let seen = (skipped.pixels - skipped.pixels_empty).max(1);
    let shade_ms = duel.virtual_ms.shade;
    saved.pixels_ms = [shade_ms, shade_ms * skipped.pixels as f64 / seen as f64];
    drop(engine);
    progress(&format!("{}: in flight", subject.name));
    // At least a page for each material, so that the flight is one.
    let columns = plan.column_cache_bytes;
    let page_bytes = (skipped.pages_wanted as f64 * FLIGHT_SHARE) as u64 * SLOT_BYTES;
    let small = Plan {
        page_cache_bytes: page_bytes.max(subject.scene.archives().len() as u64 * SLOT_BYTES),
        column_cache_bytes: columns,
        ..*plan
    };
    let start = || start(context.clone(), subject, &small);
    let motion = Motion::measure(start, &subject.flight, plan.rounds)?;
    Ok(Case {
        name: subject.name.clone(),
        materials: subject.scene.archives().len(),
        triangles: subject.scene.triangle_count(),
        views: subject.cameras.len(),
        resident_rms,
        duel,
        still,
        motion,
        skipped,
        saved,
        gpu_bytes: stats.gpu_bytes,
        host_bytes: stats.host_bytes,
    })
}

fn start(context: Context, subject: &Subject, plan: &Plan) -> Result<Engine> {
    let mut engine = Engine::new(
        context,
        &subject.scene,
        subject.archives.source()?,
        plan.options(),
    )?;
    engine.wait_for_materials(LIMIT)?;
    Ok(engine)
}

/// Settles a view.
fn settle(engine: &mut Engine, camera: &Camera) -> Result<()> {
    frames(engine, camera).map(|_| ())
}

/// The frames until a view has settled.
fn frames(engine: &mut Engine, camera: &Camera) -> Result<Vec<FrameStats>> {
    let frames = engine.settle(camera, LIMIT)?;
    match frames.last() {
        Some(stats) if stats.settled => Ok(frames),
        _ => Err(Error::Invalid {
            what: "a view",
            found: engine.problems().last().unwrap_or("still loading").to_owned(),
            expected: "settled within five minutes; are all archives there?",
        }),
    }
}

/// Which pages the way wants.
fn pages(engine: &mut Engine, cameras: &[Camera], skipped: &mut Skipped, saved: &mut Saved) -> Result<()> {
    let materials: Vec<_> = engine.material_infos().collect();
    let mut wanted = HashSet::new();
    let mut sum = 0u64;
    for camera in cameras {
        settle(engine, camera)?;
        sum += u64::from(engine.summary().pages_wanted);
        for vote in engine.votes() {
            let pyramid = &materials[usize::from(vote.material.0)].pyramid;
            let mut at = pyramid.tile_at(vote.tile);
            while let Some(tile) = at {
                wanted.insert((vote.material, tile));
                at = pyramid.parent(tile);
            }
        }
    }
    let groups = |material: usize| u64::from(materials[material].groups);
    skipped.pages_wanted = wanted
        .iter()
        .map(|(material, _)| groups(usize::from(material.0)))
        .sum();
    skipped.pages = materials
        .iter()
        .map(|info| u64::from(info.groups) * u64::from(info.pyramid.tile_count()))
        .sum();
    for (id, info) in materials.iter().enumerate() {
        let tiles = info.pyramid.tile_count() as usize;
        for (at, &bytes) in info.page_bytes.iter().enumerate() {
            let tile = info.pyramid.tile_at((at % tiles) as u32);
            let is_wanted = tile.is_some_and(|tile| wanted.contains(&(MaterialId(id as u16), tile)));
            // Of those that are wanted, and of all.
            for which in usize::from(!is_wanted)..2 {
                saved.page_bytes[which] += u64::from(bytes);
                saved.stored_pages[which] += u64::from(bytes > 0);
            }
        }
    }
    skipped.pages_wanted_in_a_view = sum as f64 / cameras.len() as f64;
    Ok(())
}

/// Adds up what shading the settled view takes.
fn count(engine: &mut Engine, skipped: &mut Skipped) -> Result<()> {
    let ShadingWork {
        items,
        groups_fetched,
        groups_left_out,
        groups_absent,
    } = engine.shading_work()?;
    let seen = engine.visibility()?;
    skipped.pixels += seen.len() as u64;
    skipped.pixels_empty += seen.iter().filter(|ids| ids[0] == 0).count() as u64;
    let more = [groups_fetched, groups_left_out, groups_absent];
    for (sum, more) in skipped.groups.iter_mut().zip(more) {
        *sum += u64::from(more);
    }
    let (width, height) = engine.size();
    skipped.workgroups[0] += items.iter().map(|items| u64::from(*items)).sum::<u64>();
    skipped.workgroups[1] += u64::from(width.div_ceil(8)) * u64::from(height.div_ceil(8));
    Ok(())
}
