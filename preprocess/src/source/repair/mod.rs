//! A BTF whose bad samples are filled while it is read: NaN, infinities, and values beyond [`MAX_SAMPLE`].
//!
//! - A hole in an image closes from its rim inwards, each channel for itself (`fill`).
//! - A channel that has no good sample in an image is that of the image under the angularly nearest light of the same
//!   view that has one; where the view has none, of the nearest view.
//! - [`Repairs`] counts what was repaired and names the first ones.
//!
//! What is filled in depends on the samples alone, not on who reads what in which order. Beside the images asked
//! for, each thread holds one more while it fills one that has lost a channel, and a byte or so is kept an image.
//!
//! [`MAX_SAMPLE`]: crate::npy::MAX_SAMPLE

mod fill;
mod tally;

pub use tally::{Repair, RepairReport, Repairs};

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use tileset::Direction;

use super::{Images, LowRank};
use crate::npy::{CHANNELS, Samples, Sampling};
use crate::{Error, Result};
use tally::Harm;

/// Images whose bad samples are filled.
#[derive(Debug)]
pub(super) struct Repaired {
    path: PathBuf,
    sampling: Sampling,
    width: usize,
    texels: usize,
    inner: Box<dyn Images>,
    repairs: Arc<Repairs>,
}

impl Repaired {
    /// Wraps the images of the BTF at `path`.
    pub(super) fn new(
        path: &Path,
        sampling: &Sampling,
        (width, height): (u32, u32),
        inner: Box<dyn Images>,
    ) -> Self {
        Self {
            path: path.to_owned(),
            sampling: sampling.clone(),
            width: width as usize,
            texels: width as usize * height as usize,
            inner,
            repairs: Arc::new(Repairs::new(sampling.views.len(), sampling.lights.len(), width)),
        }
    }

    /// The counter.
    pub(super) fn repairs(&self) -> Arc<Repairs> {
        self.repairs.clone()
    }

    /// Looks at consecutive images; whether any of them has bad samples.
    fn inspect(&self, images: Range<usize>, samples: &Samples<'_>) -> bool {
        let size = 3 * self.texels;
        let (first, count) = (images.start, images.len());
        // Every image, not up to the first: all of them are counted.
        let harmed = |at| {
            let samples = samples.slice(at * size..(at + 1) * size);
            self.repairs.inspect(first + at, &samples).any
        };
        (0..count)
            .into_par_iter()
            .map(harmed)
            .reduce(|| false, |a, b| a | b)
    }

    /// Fills the samples `[rgb][y][x]` of an image.
    fn repair(&self, image: usize, samples: &mut [f32]) -> Result<()> {
        let harm = self.repairs.inspect(image, &Samples::F32(samples));
        if !harm.any {
            return Ok(());
        }
        let mut lost = [false; 3];
        for (lost, plane) in lost.iter_mut().zip(samples.chunks_exact_mut(self.texels)) {
            *lost = !fill::fill(plane, self.width, self.sampling.wrap);
        }
        if lost.contains(&true) {
            self.replace(image, lost, samples)?;
        }
        Ok(())
    }

    /// Takes the `lost` channels of an image from those of the nearest directions.
    fn replace(&self, image: usize, mut lost: [bool; 3], samples: &mut [f32]) -> Result<()> {
        let lights = self.sampling.lights.len();
        let (view, light) = (image / lights, image % lights);
        let nearest_lights = by_angle(&self.sampling.lights, light);
        let mut scratch = Vec::new();
        for near_view in by_angle(&self.sampling.views, view) {
            if self.repairs.exhausted(near_view, lost) {
                continue; // so that a BTF of nothing but holes is searched once, not once an image
            }
            for candidate in nearest_lights.iter().map(|light| near_view * lights + light) {
                self.take(candidate, &mut lost, samples, &mut scratch)?;
                if lost == [false; 3] {
                    return Ok(());
                }
            }
        }
        let channel = lost.iter().position(|&lost| lost).unwrap_or(0);
        Err(Error::format(
            &self.path,
            format!(
                "no image has a usable sample in channel {}: view {view}, light {light} ({}) cannot be filled",
                CHANNELS[channel],
                self.inner.place(image)
            ),
        ))
    }

    /// Takes those of the `lost` channels that a `candidate` has, filled.
    fn take(
        &self,
        candidate: usize,
        lost: &mut [bool; 3],
        samples: &mut [f32],
        scratch: &mut Vec<f32>,
    ) -> Result<()> {
        let helps = |harm: Harm, lost: [bool; 3]| (0..3).any(|channel| lost[channel] && !harm.lost[channel]);
        if let Some(harm) = self.repairs.known(candidate)
            && !helps(harm, *lost)
        {
            return Ok(());
        }
        let found = self.inner.samples(candidate..candidate + 1, scratch)?;
        let harm = self.repairs.inspect(candidate, &found);
        for channel in (0..3).filter(|&channel| !harm.lost[channel]) {
            if std::mem::take(&mut lost[channel]) {
                let range = channel * self.texels..(channel + 1) * self.texels;
                let plane = &mut samples[range.clone()];
                found.slice(range).to_f32(plane);
                fill::fill(plane, self.width, self.sampling.wrap);
            }
        }
        Ok(())
    }
}

impl Images for Repaired {
    fn format(&self) -> String {
        self.inner.format()
    }

    fn stored_bytes(&self) -> u64 {
        self.inner.stored_bytes()
    }

    /// Mapped samples are copied where one of them must change.
    fn sample_bytes(&self) -> usize {
        self.inner.sample_bytes() + size_of::<f32>()
    }

    fn decoding_bytes(&self) -> u64 {
        self.inner.decoding_bytes()
    }

    fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        let harmed = |image| self.repairs.known(image).is_none_or(|harm| harm.any);
        if !images.clone().any(harmed) {
            return self.inner.samples(images, buffer);
        }
        let found = self.inner.samples(images.clone(), buffer)?;
        let length = found.len();
        let harmed = self.inspect(images.clone(), &found);
        let address = match found {
            Samples::F32(samples) => Some(samples.as_ptr() as usize),
            Samples::F16(_) => None,
        };
        // The inner format has either decoded into the buffer, where the samples can be changed, or given a map of
        // its file, which costs nothing to ask for again.
        let start = buffer.as_ptr() as usize;
        let decoded = address.filter(|address| (start..start + size_of_val(&buffer[..])).contains(address));
        let Some(address) = decoded else {
            if !harmed {
                return self.inner.samples(images, buffer);
            }
            buffer.resize(length, 0.0);
            self.inner
                .samples(images.clone(), &mut Vec::new())?
                .to_f32(&mut buffer[..length]);
            self.repair_all(images, &mut buffer[..length])?;
            return Ok(Samples::F32(&buffer[..length]));
        };
        let first = (address - start) / size_of::<f32>();
        if harmed {
            self.repair_all(images, &mut buffer[first..first + length])?;
        }
        Ok(Samples::F32(&buffer[first..first + length]))
    }

    fn prefetch(&self, images: Range<usize>) {
        self.inner.prefetch(images);
    }

    fn release(&self, images: Range<usize>) {
        self.inner.release(images);
    }

    fn place(&self, image: usize) -> String {
        self.inner.place(image)
    }

    fn notes(&self) -> Vec<String> {
        self.inner.notes()
    }

    fn check(&self, image: usize) -> Result<()> {
        self.inner.check(image)
    }

    /// Factors with a bad entry say nothing about the samples of a whole row or column: such a file is factorized anew.
    fn low_rank(&self) -> Result<Option<LowRank>> {
        let good = |values: &[f32]| !values.iter().any(|&value| fill::is_bad(value.into()));
        Ok(self
            .inner
            .low_rank()?
            .filter(|factors| good(&factors.u) && good(&factors.v)))
    }
}

impl Repaired {
    fn repair_all(&self, images: Range<usize>, samples: &mut [f32]) -> Result<()> {
        samples
            .par_chunks_exact_mut(3 * self.texels)
            .zip(images)
            .try_for_each(|(samples, image)| self.repair(image, samples))
    }
}

/// The indices of all directions, the nearest to that of index `to` first; itself is the very first, and of two as near
/// the one of the smaller index comes first.
fn by_angle(directions: &[Direction], to: usize) -> Vec<usize> {
    let target = directions[to].to_vector();
    let mut order: Vec<(f64, usize)> = directions
        .iter()
        .map(|direction| direction.to_vector())
        .map(|vector| -(0..3).map(|axis| vector[axis] * target[axis]).sum::<f64>())
        .enumerate()
        .map(|(index, distance)| (if index == to { f64::NEG_INFINITY } else { distance }, index))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order.into_iter().map(|(_, index)| index).collect()
}
