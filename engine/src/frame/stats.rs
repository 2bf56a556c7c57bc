//! What a frame did, and what was saved.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::gpu::GpuMilliseconds;

/// Milliseconds of one frame, by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Milliseconds {
    /// Taking the votes that have come back; with [`super::Options::wait`] waiting for them.
    pub votes: f64,
    /// Deciding.
    pub residency: f64,
    /// Polling the source.
    pub source: f64,
    /// Handing records to the decoder and taking back what is decoded; decoding itself where it is part of the frame.
    pub decode: f64,
    /// Writing slots and page tables, finding borders to stitch.
    pub upload: f64,
    /// Visibility, feedback, stitching and shading: submitted and waited for, where that is known.
    pub draw: f64,
    /// The passes on the GPU, of the newest frame whose times are known.
    pub gpu: Option<GpuMilliseconds>,
}

/// What one frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FrameStats {
    /// Frames before this one.
    pub frame: u64,
    /// Archives of the scene.
    pub archives: u32,
    /// Archives whose index is here; their materials show their mean colour at least.
    pub archives_known: u32,
    /// Archives that were given up; [`super::Engine::problems`] tells why.
    pub archives_failed: u32,
    /// Pages with votes.
    pub pages_wanted: u32,
    /// Pages in the cache.
    pub pages_resident: u32,
    /// Columns in the cache.
    pub columns_resident: u32,
    /// Items placed in free slots in this frame.
    pub added: u32,
    /// Items placed by evicting another in this frame.
    pub swapped: u32,
    /// Items that are asked for and not placed after this frame; the source has some of them.
    pub in_flight: u32,
    /// Border texels copied on the GPU between neighbouring pages in this frame; bounded by the pages it placed.
    pub texels_stitched: u64,
    /// Bytes that crossed the wire in this frame.
    pub wire_bytes: u64,
    /// Bytes that crossed the wire since the start.
    pub wire_bytes_total: u64,
    /// Bytes allocated on the GPU: caches, tables, meshes, targets.
    pub gpu_bytes: u64,
    /// Bytes of records and decoded pages on the host, waiting ones included.
    pub host_bytes: u64,
    /// Root mean square reflectance error that is predicted against full residency in half floats.
    pub predicted_rms: f64,
    /// The part of it that the format of the page cache makes; 0 for half floats.
    pub format_rms: f64,
    /// All archives are known or given up, every pixel has voted, nothing is in flight and nothing would lower the error.
    pub settled: bool,
    /// The picture was drawn; otherwise nothing had changed and the last one stands.
    pub drawn: bool,
    /// Time by phase.
    pub ms: Milliseconds,
}

/// Work that was not needed, and work that went wrong, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Counters {
    /// Frames that were not drawn because nothing had changed.
    pub draws_skipped: u64,
    /// Frames without a feedback pass because every pixel had voted.
    pub feedback_skipped: u64,
    /// Requests given up because the camera left them behind.
    pub requests_cancelled: u64,
    /// Records that the host still had.
    pub records_from_host: u64,
    /// Records that were here before they were asked for, because what is above their pages was on its way.
    pub records_early: u64,
    /// Pages that equal their up-sampled parent and were never asked for.
    pub pages_not_stored: u64,
    /// Arrived items that were not worth a slot any more.
    pub arrivals_dropped: u64,
    /// Records of ancestors asked for again because the host had dropped them.
    pub ancestors_again: u64,
    /// Views ahead of the camera, and views to be prefetched, for which votes were asked.
    pub looks_ahead: u64,
    /// Records that did not match the directory.
    pub records_damaged: u64,
    /// Requests that failed.
    pub requests_failed: u64,
}

/// A clock: the time since some moment that stays the same.
pub type Clock = fn() -> Duration;

/// The time that passes.
#[cfg(not(target_arch = "wasm32"))]
pub(super) fn wall_clock() -> Duration {
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    START.elapsed()
}

/// The time that passes since the page began; browsers round it to a tenth of a millisecond or so.
#[cfg(target_arch = "wasm32")]
pub(super) fn wall_clock() -> Duration {
    use wasm_bindgen::prelude::*;
    #[wasm_bindgen]
    extern "C" {
        #[wasm_bindgen(js_namespace = performance)]
        fn now() -> f64;
    }
    Duration::from_secs_f64(now().max(0.0) / 1e3)
}

/// Measures phases.
pub(super) struct Stopwatch {
    clock: Clock,
    start: Duration,
}

impl Stopwatch {
    pub(super) fn start() -> Self {
        Self::by(wall_clock)
    }

    pub(super) fn by(clock: Clock) -> Self {
        Self {
            clock,
            start: clock(),
        }
    }

    pub(super) fn elapsed(&self) -> Duration {
        (self.clock)().saturating_sub(self.start)
    }

    /// Milliseconds since the start or the last lap.
    pub(super) fn lap(&mut self) -> f64 {
        let now = (self.clock)();
        let lap = now.saturating_sub(std::mem::replace(&mut self.start, now));
        lap.as_secs_f64() * 1e3
    }
}
