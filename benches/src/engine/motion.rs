//! The camera flies from an empty cache: what the CPU does in a frame, by phase, and what is skipped.
//!
//! Pictures are not shaded: nothing of the CPU's work depends on them, and an adapter that draws on the CPU would take the
//! time, and the caches, of what is measured.

use std::time::Duration;

use engine::frame::{Clock, Counters, Engine, Milliseconds};
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::quantile;
use crate::Result;

/// Milliseconds of the CPU in a frame by phase, besides the submission of work to the GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

/// The processor time of this thread where the system tells it, the time that passes elsewhere.
pub(crate) fn thread_time() -> Duration {
    #[cfg(target_os = "linux")]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
    }
    #[cfg(not(target_os = "linux"))]
    wall_time()
}

/// The time that passes.
fn wall_time() -> Duration {
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    START.elapsed()
}

/// Flights.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Motion {
    /// Frames of each.
    pub frames: usize,
    /// Medians of the processor time of the frames' thread: what a frame works.
    pub cpu_ms: CpuPhases,
    /// 95th percentiles of the same.
    pub cpu_ms_95: CpuPhases,
    /// Medians of the time that passes: with waiting for a processor that others have.
    #[serde(default)]
    pub wall_ms: CpuPhases,
    /// 95th percentiles of the same.
    #[serde(default)]
    pub wall_ms_95: CpuPhases,
    /// Pages and columns that were placed.
    pub placed: u64,
    /// Most of them in one frame.
    #[serde(default)]
    pub most_placed: u32,
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
    /// Each round flies with both clocks, from engines that `start` makes. What else the machine does only adds to the
    /// times, so for each clock the flight with the least median counts.
    pub(super) fn measure(
        start: impl Fn() -> Result<Engine>,
        cameras: &[Camera],
        rounds: usize,
    ) -> Result<Self> {
        let best = |clock: Clock| {
            let mut best = Flight::measure(start()?, cameras, clock)?;
            for _ in 1..rounds {
                let next = Flight::measure(start()?, cameras, clock)?;
                if next.quantile(0.5).all < best.quantile(0.5).all {
                    best = next;
                }
            }
            Ok::<_, crate::Error>(best)
        };
        let (worked, passed) = (best(thread_time)?, best(wall_time)?);
        Ok(Self {
            frames: cameras.len(),
            cpu_ms: worked.quantile(0.5),
            cpu_ms_95: worked.quantile(0.95),
            wall_ms: passed.quantile(0.5),
            wall_ms_95: passed.quantile(0.95),
            ..worked.motion
        })
    }
}

/// One flight.
struct Flight {
    times: Vec<Milliseconds>,
    motion: Motion,
}

impl Flight {
    fn measure(mut engine: Engine, cameras: &[Camera], clock: Clock) -> Result<Self> {
        engine.time_with(clock);
        let none = CpuPhases::default();
        let mut times = Vec::with_capacity(cameras.len());
        let mut motion = Motion {
            frames: cameras.len(),
            cpu_ms: none,
            cpu_ms_95: none,
            wall_ms: none,
            wall_ms_95: none,
            placed: 0,
            most_placed: 0,
            swapped: 0,
            wire_bytes: 0,
            host_bytes: 0,
            counters: Counters::default(),
        };
        for camera in cameras {
            let stats = engine.step(camera)?;
            // A driver that works on the CPU would compete with the next frame.
            engine.wait()?;
            times.push(stats.ms);
            let placed = stats.added + stats.swapped;
            motion.placed += u64::from(placed);
            motion.most_placed = motion.most_placed.max(placed);
            motion.swapped += u64::from(stats.swapped);
            motion.wire_bytes = stats.wire_bytes_total;
            motion.host_bytes = motion.host_bytes.max(stats.host_bytes);
        }
        motion.counters = engine.counters();
        Ok(Self { times, motion })
    }

    fn quantile(&self, share: f64) -> CpuPhases {
        CpuPhases::of(&self.times, share)
    }
}
