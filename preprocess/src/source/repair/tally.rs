//! What was repaired.

use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use crate::npy::{CHANNELS, Samples};

use super::fill::is_bad;

/// Bad samples that are named one by one.
const NAMED: usize = 8;

/// A sample that was replaced.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Repair {
    /// Index of the view.
    pub view: usize,
    /// Index of the light.
    pub light: usize,
    /// 'r', 'g' or 'b'.
    pub channel: char,
    /// Column of the texel.
    pub x: usize,
    /// Row of the texel.
    pub y: usize,
    /// What stood there: "NaN", "inf", "-inf", or a number beyond the limit.
    pub value: String,
}

/// What was repaired in all images that were read at least once: after one pass, in all of them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RepairReport {
    /// Samples that were replaced.
    pub samples: u64,
    /// Images with such samples.
    pub images: u64,
    /// Images of which at least one channel held no good sample, and was taken from the image of the nearest
    /// direction.
    pub lost_images: u64,
    /// The first ones, in the order of view, light, channel, row and column; eight at most.
    pub first: Vec<Repair>,
}

impl std::fmt::Display for RepairReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "repaired {} samples in {} images", self.samples, self.images)?;
        if self.lost_images > 0 {
            write!(
                f,
                ", {} of them taken from the nearest direction because a channel had nothing left",
                self.lost_images
            )?;
        }
        if let Some(Repair {
            view,
            light,
            channel,
            x,
            y,
            value,
        }) = self.first.first()
        {
            write!(
                f,
                "; the first is {value} at view {view}, light {light}, channel {channel}, texel x {x} y {y}"
            )?;
        }
        Ok(())
    }
}

/// What is wrong with one image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Harm {
    /// Whether any sample is bad.
    pub(super) any: bool,
    /// Which channels have no good sample.
    pub(super) lost: [bool; 3],
}

/// What is known of all images, shared by whoever reads them. A byte an image.
#[derive(Debug)]
pub struct Repairs {
    lights: usize,
    width: usize,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// `None` for images that nobody has read.
    known: Vec<Option<Harm>>,
    /// For each view and channel, how many images are known to have lost it.
    lost: Vec<[usize; 3]>,
    report: RepairReport,
}

impl Repairs {
    pub(super) fn new(views: usize, lights: usize, width: u32) -> Self {
        Self {
            lights,
            width: width as usize,
            state: Mutex::new(State {
                known: vec![None; views * lights],
                lost: vec![[0; 3]; views],
                report: RepairReport::default(),
            }),
        }
    }

    /// What was repaired up to now.
    pub fn report(&self) -> RepairReport {
        self.state().report.clone()
    }

    /// What is wrong with an image, if it was read before.
    pub(super) fn known(&self, image: usize) -> Option<Harm> {
        self.state().known[image]
    }

    /// Whether every image of a view is known to have lost all `wanted` channels.
    pub(super) fn exhausted(&self, view: usize, wanted: [bool; 3]) -> bool {
        let lost = self.state().lost[view];
        (0..3).all(|channel| !wanted[channel] || lost[channel] == self.lights)
    }

    /// Looks at the samples `[rgb][y][x]` of an image, and counts what is wrong if they are there for the first time.
    pub(super) fn inspect(&self, image: usize, samples: &Samples<'_>) -> Harm {
        if let Some(harm) = self.known(image) {
            return harm;
        }
        let texels = samples.len() / 3;
        let (mut counts, mut first) = ([0usize; 3], Vec::new());
        for (channel, count) in counts.iter_mut().enumerate() {
            let plane = samples.slice(channel * texels..(channel + 1) * texels);
            if !any_bad(&plane) {
                continue;
            }
            for texel in (0..texels).filter(|&texel| is_bad(plane.get(texel))) {
                *count += 1;
                if first.len() < NAMED {
                    first.push(Repair {
                        view: image / self.lights,
                        light: image % self.lights,
                        channel: CHANNELS[channel],
                        x: texel % self.width,
                        y: texel / self.width,
                        value: plane.get(texel).to_string(),
                    });
                }
            }
        }
        let harm = Harm {
            any: counts != [0; 3],
            lost: counts.map(|count| count == texels),
        };
        self.state().learn(image, self.lights, harm, counts, first);
        harm
    }

    /// A panic elsewhere leaves nothing half written here.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn learn(&mut self, image: usize, lights: usize, harm: Harm, counts: [usize; 3], first: Vec<Repair>) {
        if self.known[image].replace(harm).is_some() {
            return; // another thread was faster
        }
        if !harm.any {
            return;
        }
        let report = &mut self.report;
        report.samples += counts.iter().sum::<usize>() as u64;
        report.images += 1;
        report.lost_images += u64::from(harm.lost.contains(&true));
        // In the order of the images, whatever the order in which they are read.
        let at = report
            .first
            .partition_point(|repair| repair.view * lights + repair.light < image);
        report.first.splice(at..at, first);
        report.first.truncate(NAMED);
        for (lost, &now) in self.lost[image / lights].iter_mut().zip(&harm.lost) {
            *lost += usize::from(now);
        }
    }
}

/// Whether any sample is bad: a quick look, which for good images is the only one.
fn any_bad(samples: &Samples<'_>) -> bool {
    match samples {
        // All exponent bits are set in infinities and NaN; no half float is beyond the limit.
        Samples::F16(samples) => samples
            .iter()
            .fold(false, |bad, sample| bad | (sample.to_bits() & 0x7c00 == 0x7c00)),
        Samples::F32(samples) => samples
            .iter()
            .fold(false, |bad, &sample| bad | is_bad(sample.into())),
    }
}
