//! What the demo measured: one table of bytes, memory and error.

use std::fmt::Write;
use std::time::Duration;

use engine::frame::FrameStats;
use serde::Serialize;

use super::materials::Made;
use super::shots::Shot;
use crate::bytes::text as size;
use crate::render::Quality;

/// Everything.
#[derive(Serialize)]
pub(crate) struct Report {
    pub(crate) adapter: String,
    pub(crate) triangles: usize,
    pub(crate) size: (u32, u32),
    pub(crate) material_size: u32,
    pub(crate) components: u32,
    pub(crate) materials: Vec<Made>,
    /// The settled picture with everything resident against the reference.
    pub(crate) quality: Quality,
    pub(crate) refinement: Vec<Shot>,
    pub(crate) caches: Vec<Shot>,
    pub(crate) flight: Flight,
    pub(crate) seconds: f64,
}

/// The flight.
#[derive(Serialize)]
pub(crate) struct Flight {
    pub(crate) cache_bytes: u64,
    pub(crate) wire_bytes: u64,
    pub(crate) gpu_bytes: u64,
    /// Largest number of bytes on the wire in one frame.
    pub(crate) largest_frame_bytes: u64,
    pub(crate) seconds: f64,
    pub(crate) frames: Vec<FrameStats>,
}

impl Flight {
    pub(crate) fn new(frames: Vec<FrameStats>, cache_bytes: u64, time: Duration) -> Self {
        let most = |value: fn(&FrameStats) -> u64| frames.iter().map(value).max().unwrap_or(0);
        Self {
            cache_bytes,
            wire_bytes: most(|stats| stats.wire_bytes_total),
            gpu_bytes: most(|stats| stats.gpu_bytes),
            largest_frame_bytes: most(|stats| stats.wire_bytes),
            seconds: time.as_secs_f64(),
            frames,
        }
    }
}

impl Report {
    /// The tables, readable as they are.
    pub(crate) fn markdown(&self) -> String {
        let mut text = format!(
            "# Eigentile demo\n\n{}x{} pixels, {} triangles, {}, {:.0} s in all\n\n",
            self.size.0, self.size.1, self.triangles, self.adapter, self.seconds
        );
        // Writing to a string does not fail.
        let _ = self.shots(&mut text);
        let _ = self.materials(&mut text);
        let Quality {
            measured,
            predicted_rmse,
            ..
        } = &self.quality;
        let _ = writeln!(
            text,
            "With everything resident the picture differs from the reference (uncompressed BTFs, shaded in f64) by an \
             RMSE of {:.5} of radiance; the ledgers predict {predicted_rmse:.5}. SSIM {:.4}, ΔE2000 {:.2}.\n",
            measured.rmse, measured.ssim, measured.delta_e_2000
        );
        let Flight {
            cache_bytes,
            wire_bytes,
            seconds,
            frames,
            ..
        } = &self.flight;
        let _ = writeln!(
            text,
            "Flight: {} frames in {seconds:.1} s with {} of cache; {} over the wire.",
            frames.len(),
            size(*cache_bytes),
            size(*wire_bytes)
        );
        text
    }

    fn shots(&self, text: &mut String) -> std::fmt::Result {
        writeln!(
            text,
            "| picture            |      wire |     cache |       GPU |  pages | columns | predicted |    RMSE |  PSNR |   SSIM | ΔE2000 |"
        )?;
        writeln!(
            text,
            "|:-------------------|----------:|----------:|----------:|-------:|--------:|----------:|--------:|------:|-------:|-------:|"
        )?;
        for shot in self.refinement.iter().chain(&self.caches) {
            writeln!(
                text,
                "| {:18} | {:>9} | {:>9} | {:>9} | {:6} | {:7} | {:9.5} | {:7.5} | {:5.1} | {:6.4} | {:6.2} |",
                shot.label,
                size(shot.wire_bytes),
                size(shot.cache_bytes),
                size(shot.gpu_bytes),
                shot.pages_resident,
                shot.columns_resident,
                shot.predicted_rms,
                shot.quality.rmse,
                shot.quality.psnr_db,
                shot.quality.ssim,
                shot.quality.delta_e_2000,
            )?;
        }
        writeln!(text)
    }

    fn materials(&self, text: &mut String) -> std::fmt::Result {
        writeln!(
            text,
            "| material |       BTF |   archive | ratio |  error | synthesis | preprocessing |"
        )?;
        writeln!(
            text,
            "|:---------|----------:|----------:|------:|-------:|----------:|--------------:|"
        )?;
        for made in &self.materials {
            let seconds = |seconds: f64| {
                if seconds > 0.0 {
                    format!("{seconds:.1} s")
                } else {
                    "there".into()
                }
            };
            writeln!(
                text,
                "| {:8} | {:>9} | {:>9} | {:5.0} | {:4.1} % | {:>9} | {:>13} |",
                made.name,
                size(made.btf_bytes),
                size(made.archive_bytes),
                made.btf_bytes as f64 / made.archive_bytes.max(1) as f64,
                100.0 * made.total_relative,
                seconds(made.synth_seconds),
                seconds(made.preprocess_seconds),
            )?;
        }
        writeln!(text)
    }
}
