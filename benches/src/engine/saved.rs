//! The time that each kind of skipping saves, by switching it off where it can be.

use std::time::Instant;

use engine::frame::Engine;
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::median;
use crate::Result;

/// Least frames of a kind that are timed.
const LEAST_ROUNDS: usize = 5;

/// What skipping saves. Pairs are with skipping, and without.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)] // what an earlier version did not measure is zero
pub struct Saved {
    /// Bytes of the records of pages that some view of the way wants, and of all.
    pub page_bytes: [u64; 2],
    /// Pages that have a record and so are fetched and decoded, of those that some view wants, and of all.
    pub stored_pages: [u64; 2],
    /// Milliseconds of loading what the way wants from an empty cache: fetching from where the archives are, decoding, uploading, stitching; and
    /// what all pages of the scene would take at the same pace.
    pub load_ms: [f64; 2],
    /// Of these the milliseconds in which the frames' thread brings pages and columns to the GPU.
    pub upload_ms: [f64; 2],
    /// Milliseconds on the GPU of shading the pixels that show a mesh, and what all pixels would take at the same pace, where the adapter
    /// can tell.
    pub pixels_ms: [f64; 2],
    /// Milliseconds of a settled frame that is drawn with the groups that matter, and with all that are there: medians, CPU and GPU.
    pub groups_ms: [f64; 2],
    /// Milliseconds of a frame in which nothing has changed, and of the same frame drawn all the same, likewise.
    pub still_ms: [f64; 2],
    /// Milliseconds on the GPU of the feedback pass, which a settled view does without, where the adapter can tell.
    pub feedback_ms: [f64; 2],
}

impl Saved {
    /// Measures a view that has settled.
    pub(super) fn drawing(&mut self, engine: &mut Engine, camera: &Camera, rounds: usize) -> Result<()> {
        let (error, stops) = (engine.options().component_error, engine.options().exposure_stops);
        let mut times: [Vec<f64>; 3] = Default::default();
        for _ in 0..rounds.max(LEAST_ROUNDS) {
            for (which, error) in [error, 0.0].into_iter().enumerate() {
                engine.set_component_error(error)?;
                timed(engine, camera)?;
                // Another exposure than that of the frame before needs another picture, and nothing else.
                engine.set_exposure_stops(stops + (1 + which) as f32);
                times[which].push(timed(engine, camera)?);
            }
            times[2].push(timed(engine, camera)?);
        }
        engine.set_component_error(error)?;
        engine.set_exposure_stops(stops);
        let [drawn, all, still] = times.each_mut().map(|times| median(times));
        (self.groups_ms, self.still_ms) = ([drawn, all], [still, drawn]);
        Ok(())
    }
}

fn timed(engine: &mut Engine, camera: &Camera) -> Result<f64> {
    let watch = Instant::now();
    engine.frame(camera)?;
    engine.wait()?;
    Ok(watch.elapsed().as_secs_f64() * 1e3)
}
