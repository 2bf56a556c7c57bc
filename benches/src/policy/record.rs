//! Traces of real scenes, recorded with the engine.

use engine::frame::{Budgets, Engine, Options};
use engine::gpu::Context;
use engine::stream::TileSource;
use scenes::{Camera, Scene};
use std::time::Duration;

use super::{Trace, TraceMaterial};
use crate::Result;

/// Longest time for the indices of all archives.
const LIMIT: Duration = Duration::from_secs(60);
/// The caches of the recording: votes do not depend on what is resident, so they may be small.
const CACHE_BYTES: u64 = 16 << 20;

/// Records the votes of each view as residency would see them: sums over the newest votes of each phase of the jitter. The
/// first view is looked at until all of its pixels have voted.
///
/// # Errors
/// Those of the engine.
pub fn record(
    name: &str,
    scene: &Scene,
    source: Box<dyn TileSource>,
    size: (u32, u32),
    cameras: &[Camera],
    progress: &dyn Fn(&str),
) -> Result<Trace> {
    let options = Options {
        size,
        budgets: Budgets {
            page_cache_bytes: CACHE_BYTES,
            column_cache_bytes: CACHE_BYTES,
            ..Budgets::default()
        },
        ..Options::default()
    };
    let phases = options.feedback_stride * options.feedback_stride;
    let mut engine = Engine::new(Context::headless()?, scene, source, options)?;
    engine.wait_for_materials(LIMIT)?;
    if let Some(first) = cameras.first() {
        for _ in 0..phases {
            engine.frame(first)?;
        }
    }
    let mut frames = Vec::with_capacity(cameras.len());
    for camera in cameras {
        progress(&format!(
            "recording frame {} of {}",
            frames.len() + 1,
            cameras.len()
        ));
        engine.frame(camera)?;
        frames.push(engine.votes().to_vec());
    }
    let materials = engine.material_infos().map(|info| {
        let (width, height) = info.pyramid.mip_size(0);
        TraceMaterial {
            width,
            height,
            wrap: info.pyramid.wrap(),
            groups: info.groups,
            weights: info.weights,
        }
    });
    Ok(Trace {
        name: name.into(),
        materials: materials.collect(),
        frames,
    })
}
