//! The camera flies from an empty cache: what the CPU does in a frame, by phase, and what is skipped.

use engine::frame::{Counters, Engine, Milliseconds};
use scenes::Camera;
use serde::Serialize;

use super::quantile;
use crate::Result;

/// Milliseconds of the CPU in a frame by phase, besides the submission of work to the GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CpuPhases {
    /// Taking votes.
    pub votes: f64,
    /// Deciding.
    pub residency: f64,
    /// Requests and answers.
    pub source: f64,
    /// Handing records to the decoder and taking back pages.
    pub decode: f64,
    /// Slots, page table, what of borders is to be stitched.
    pub upload: f64,
    /// The phases together; of the 95th percentile this is not the sum of theirs.
    pub all: f64,
    /// Recording commands and handing them to the driver.
    pub submit: f64,
}

impl CpuPhases {
    /// What a share of the frames stays under.
    pub(super) fn of(frames: &[Milliseconds], share: f64) -> Self {
        let at = |phase: &dyn Fn(&Milliseconds) -> f64| {
            let mut values: Vec<f64> = frames.iter().map(phase).collect();
            quantile(&mut values, share)
        };
        Self {
            votes: at(&|ms| ms.votes),
            residency: at(&|ms| ms.residency),
            source: at(&|ms| ms.source),
            decode: at(&|ms| ms.decode),
            upload: at(&|ms| ms.upload),
            all: at(&|ms| ms.votes + ms.residency + ms.source + ms.decode + ms.upload),
            submit: at(&|ms| ms.draw),
        }
    }
}

/// A flight.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Motion {
    /// Frames.
    pub frames: usize,
    /// Medians over the frames.
    pub cpu_ms: CpuPhases,
    /// 95th percentiles.
    pub cpu_ms_95: CpuPhases,
    /// Pages and columns that were placed.
    pub placed: u64,
    /// Those of them that others gave way for.
    pub swapped: u64,
    /// Bytes that crossed the wire.
    pub wire_bytes: u64,
    /// Largest use of the host.
    pub host_bytes: u64,
    /// Work that was not needed: records from the host, empty pages, cancelled requests, frames without feedback.
    pub counters: Counters,
}

impl Motion {
    pub(super) fn measure(engine: &mut Engine, cameras: &[Camera]) -> Result<Self> {
        let mut times = Vec::with_capacity(cameras.len());
        let mut motion = Self {
            frames: cameras.len(),
            cpu_ms: CpuPhases::default(),
            cpu_ms_95: CpuPhases::default(),
            placed: 0,
            swapped: 0,
            wire_bytes: 0,
            host_bytes: 0,
            counters: Counters::default(),
        };
        for camera in cameras {
            let stats = engine.frame(camera)?;
            // A driver that draws on the CPU would compete with the next frame.
            engine.wait()?;
            times.push(stats.ms);
            motion.placed += u64::from(stats.added) + u64::from(stats.swapped);
            motion.swapped += u64::from(stats.swapped);
            motion.wire_bytes = stats.wire_bytes_total;
            motion.host_bytes = motion.host_bytes.max(stats.host_bytes);
        }
        motion.cpu_ms = CpuPhases::of(&times, 0.5);
        motion.cpu_ms_95 = CpuPhases::of(&times, 0.95);
        motion.counters = engine.counters();
        Ok(motion)
    }
}
