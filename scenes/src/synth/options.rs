//! What to synthesize, and the limits of it.

use crate::{Error, Result};
use tileset::{Direction, MAX_DIRECTIONS};

/// Largest side of a synthesized material, in texels.
pub const MAX_SIZE: u32 = 2048;
/// Largest block of one view, in bytes; three of them are held at a time.
pub const MAX_BLOCK_BYTES: u64 = 1 << 30;
/// Largest number of rays per texel.
pub const MAX_SAMPLES_PER_TEXEL: u32 = 256;
/// Views must be at least this far above the horizon (cosine).
const MIN_VIEW_COSINE: f64 = 0.02;

/// What to synthesize.
#[derive(Clone, Debug)]
pub struct SynthOptions {
    /// Texels per side, 1 to [`MAX_SIZE`].
    pub size: u32,
    /// View directions; all above the horizon.
    pub views: Vec<Direction>,
    /// Light directions; from those below the horizon nothing arrives.
    pub lights: Vec<Direction>,
    /// Which one of all materials of this kind.
    pub seed: u64,
    /// Its pattern, colours, gloss and relief.
    pub style: super::Style,
    /// Rays through each texel, 1 to [`MAX_SAMPLES_PER_TEXEL`].
    pub samples_per_texel: u32,
    /// Adds the light that arrives by way of one other point of the surface.
    pub interreflection: bool,
    /// Threads to compute with; none: one per core. The result does not depend on it.
    pub threads: Option<usize>,
}

impl Default for SynthOptions {
    /// 256 texels, 81 views and lights, seed 1, plain style, four rays per texel, with interreflection.
    fn default() -> SynthOptions {
        SynthOptions {
            size: 256,
            views: super::Sampling::Bonn81.directions(),
            lights: super::Sampling::Bonn81.directions(),
            seed: 1,
            style: super::Style::default(),
            samples_per_texel: 4,
            interreflection: true,
            threads: None,
        }
    }
}

impl SynthOptions {
    /// Rejects what cannot be traced or would take too much memory.
    pub(super) fn check(&self, material: &str) -> Result<()> {
        let invalid = |detail: String| {
            Err(Error::Invalid {
                path: material.into(),
                detail,
            })
        };
        if let Some(problem) = self.style.problem() {
            return invalid(format!("style: {problem}"));
        }
        let within = |value: u64, limit: u64| (1..=limit).contains(&value);
        if !within(self.size.into(), MAX_SIZE.into()) {
            return invalid(format!("size {} texels; choose 1 to {MAX_SIZE}", self.size));
        }
        if !within(self.samples_per_texel.into(), MAX_SAMPLES_PER_TEXEL.into()) {
            let found = self.samples_per_texel;
            return invalid(format!(
                "{found} samples per texel; choose 1 to {MAX_SAMPLES_PER_TEXEL}"
            ));
        }
        for (what, directions) in [("view", &self.views), ("light", &self.lights)] {
            if !within(directions.len() as u64, MAX_DIRECTIONS.into()) {
                return invalid(format!(
                    "{} {what} directions; give 1 to {MAX_DIRECTIONS}",
                    directions.len()
                ));
            }
            if let Some(n) = directions
                .iter()
                .position(|d| !(d.theta.is_finite() && d.phi.is_finite()))
            {
                return invalid(format!("{what} direction {n} is not finite: {:?}", directions[n]));
            }
        }
        if let Some(n) = self.views.iter().position(|d| d.to_vector()[2] < MIN_VIEW_COSINE) {
            return invalid(format!(
                "view direction {n} ({:?}) is not above the horizon; theta must be below 88.8 degrees",
                self.views[n]
            ));
        }
        let bytes = self.lights.len() as u64 * 6 * u64::from(self.size).pow(2);
        if bytes > MAX_BLOCK_BYTES {
            return invalid(format!(
                "one view takes {bytes} bytes, more than {MAX_BLOCK_BYTES}; choose a smaller size or fewer lights"
            ));
        }
        Ok(())
    }

    /// The threads to compute with.
    pub(super) fn pool(&self, material: &str) -> Result<rayon::ThreadPool> {
        let threads = rayon::ThreadPoolBuilder::new().num_threads(self.threads.unwrap_or(0));
        threads.build().map_err(|error| Error::Io {
            path: material.into(),
            source: std::io::Error::other(error),
        })
    }
}
