//! Each view of the way with and without virtual textures, alternately.

use std::time::Instant;

use engine::frame::Engine;
use engine::gpu::GpuMilliseconds;
use scenes::Camera;
use serde::{Deserialize, Serialize};

use super::median;
use crate::Result;

/// Milliseconds of a frame by pass, means over the way; of each view the least of all rounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Passes {
    /// From the call to the end of all work, CPU and GPU.
    pub frame: f64,
    /// Rasterizing ids.
    pub visibility: f64,
    /// Counting votes.
    pub feedback: f64,
    /// Materials by tile of the picture.
    pub classify: f64,
    /// Shading.
    pub shade: f64,
    /// Tone mapping.
    pub tonemap: f64,
}

/// The same way twice.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Duel {
    /// [`Engine::frame`].
    pub virtual_ms: Passes,
    /// [`Engine::draw_resident`].
    pub resident_ms: Passes,
    /// Whether the passes are known by timestamps; otherwise they are zero.
    pub timestamps: bool,
    /// Whether the resident one did without a page table; with one where the pages of all materials are more than can be
    /// laid out: see [`Engine::lay_out_resident`].
    pub without_table: bool,
    /// Ratio of frame times, virtual over resident.
    pub ratio: f64,
    /// The same as the median of the ratios of all pairs.
    pub median_ratio: f64,
    /// Frames a second, virtual.
    pub frames_per_second: f64,
}

impl Duel {
    /// Measures an engine that has all that the way wants. Also gives the bytes of votes of a virtual frame, mean.
    pub(super) fn measure(engine: &mut Engine, cameras: &[Camera], rounds: usize) -> Result<(Self, f64)> {
        let without_table = match engine.lay_out_resident() {
            Ok(()) => true,
            Err(engine::Error::Budget(_)) => false,
            Err(error) => return Err(error.into()),
        };
        let mut best = vec![[Passes::infinite(); 2]; cameras.len()];
        let mut ratios = Vec::new();
        let mut timestamps = true;
        let bytes_before = engine.vote_bytes();
        let mut frames = 0u32;
        for round in 0..rounds.max(1) {
            for (number, camera) in cameras.iter().enumerate() {
                let mut times = [0.0; 2];
                // Who goes first changes from view to view and from round to round.
                let first = (number + round) % 2;
                for which in [first, 1 - first] {
                    let watch = Instant::now();
                    if which == 0 {
                        engine.frame(camera)?;
                        frames += 1;
                    } else {
                        engine.draw_resident(camera)?;
                    }
                    let gpu = engine.wait()?;
                    times[which] = watch.elapsed().as_secs_f64() * 1e3;
                    timestamps &= gpu.is_some();
                    best[number][which].keep_least(times[which], gpu.unwrap_or_default());
                }
                ratios.push(times[0] / times[1]);
            }
        }
        let [virtual_ms, resident_ms] = [0, 1].map(|which| Passes::mean(best.iter().map(|best| best[which])));
        let duel = Self {
            virtual_ms,
            resident_ms,
            timestamps,
            without_table,
            ratio: virtual_ms.frame / resident_ms.frame,
            median_ratio: median(&mut ratios),
            frames_per_second: 1e3 / virtual_ms.frame,
        };
        let bytes = engine.vote_bytes() - bytes_before;
        Ok((duel, bytes as f64 / f64::from(frames.max(1))))
    }
}

impl Passes {
    fn infinite() -> Self {
        Self::default().map(Self::default(), |_, _| f64::INFINITY)
    }

    fn keep_least(&mut self, frame: f64, gpu: GpuMilliseconds) {
        let new = Self {
            frame,
            visibility: gpu.visibility,
            feedback: gpu.feedback,
            classify: gpu.classify,
            shade: gpu.shade,
            tonemap: gpu.tonemap,
        };
        // The passes of one frame: each by itself, a clock that stood still once would win.
        if new.frame < self.frame {
            *self = new;
        }
    }

    fn mean(all: impl ExactSizeIterator<Item = Self>) -> Self {
        let count = all.len().max(1) as f64;
        let sum = all.fold(Self::default(), |sum, one| sum.map(one, |a, b| a + b));
        sum.map(sum, |value, _| value / count)
    }

    fn map(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            frame: of(self.frame, other.frame),
            visibility: of(self.visibility, other.visibility),
            feedback: of(self.feedback, other.feedback),
            classify: of(self.classify, other.classify),
            shade: of(self.shade, other.shade),
            tonemap: of(self.tonemap, other.tonemap),
        }
    }
}
