//! A settled view that stands still: nothing should be left to do.

use engine::frame::{Engine, FrameStats};
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::motion::{CpuPhases, thread_time};
use crate::Result;

/// Frames of a settled view.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Stand {
    /// Frames.
    pub frames: usize,
    /// Frames that drew.
    pub drawn: usize,
    /// Frames that asked the GPU for votes, of this view or of one ahead.
    pub asked: u64,
    /// Bytes of votes that came back.
    pub vote_bytes: u64,
    /// Medians over the frames, of the processor time of their thread; `submit` is what it takes to find that there is nothing to submit.
    pub cpu_ms: CpuPhases,
    /// 95th percentiles.
    pub cpu_ms_95: CpuPhases,
}

impl Stand {
    /// Of an engine that has settled on this view. Also gives the last frame.
    pub(super) fn measure(engine: &mut Engine, camera: &Camera, frames: usize) -> Result<(Self, FrameStats)> {
        let (counters, vote_bytes) = (engine.counters(), engine.vote_bytes());
        engine.time_with(thread_time);
        let mut last = engine.frame(camera)?;
        let mut times = vec![last.ms];
        let mut drawn = usize::from(last.drawn);
        for _ in 1..frames.max(1) {
            last = engine.frame(camera)?;
            times.push(last.ms);
            drawn += usize::from(last.drawn);
        }
        let after = engine.counters();
        let without = after.feedback_skipped - counters.feedback_skipped;
        let ahead = after.looks_ahead - counters.looks_ahead;
        let stand = Self {
            frames: times.len(),
            drawn,
            asked: times.len() as u64 - without + ahead,
            vote_bytes: engine.vote_bytes() - vote_bytes,
            cpu_ms: CpuPhases::of(&times, 0.5),
            cpu_ms_95: CpuPhases::of(&times, 0.95),
        };
        Ok((stand, last))
    }
}
