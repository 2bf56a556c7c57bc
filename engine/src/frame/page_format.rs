//! Which format the page cache has, where the user leaves that to the engine: half floats where all that the view wants has room,
//! otherwise the one with the smaller predicted error.
//!
//! Bytes have room for twice as many pages and round them. What the missing pages of a budget cost is in the directories (the
//! weights of pages, in the unit of all errors), and so is what rounding costs, which goes with the energy. Rank, codec
//! and half floats err alike in both, so they cancel. How many pages the view wants the votes say; all pages are thought to be
//! in it alike.
//!
//! A change takes all pages anew, from what the host has of them, so it has to be worth it: for some frames in a row, and back to half
//! floats only with room to spare. The picture shows the old cache until the new one is predicted to be no worse.

use std::sync::Arc;

use super::Engine;
use crate::{
    Result,
    gpu::{Caches, PageFormat, materials::Btf, page_format::rounding_mse},
    residency::Summary,
};

/// Largest over root mean square magnitude of a component in a slot, typically; measured, see docs/results.md.
const CREST: f64 = 3.8;
/// Frames in a row in which the other format must be the better one: half a second at 60 Hz.
const PATIENCE: u32 = 30;
/// Of the slots of half floats, in 64ths, what a view may want to go back to them: a camera that sways about the limit changes nothing.
const SPARED: u32 = 56;
/// Bits of a float's exponent and the first three of its mantissa.
const BIN_SHIFT: u32 = 20;
const BINS: usize = 1 << (31 - BIN_SHIFT);

/// All pages of the known materials by what each adds to a material's mean square.
pub(super) struct Worths {
    /// From the least to the most valuable: pages, and their sums.
    bins: Vec<(f64, f64)>,
    materials: f64,
}

/// What is being thought about.
#[derive(Default)]
pub(super) struct Review {
    /// Frames in a row in which the other format would have been better.
    frames: u32,
    /// Slots that the budget has room for, of half floats and of bytes.
    slots: [u32; 2],
    /// Predicted mean squared error of what is shown while a new cache fills, and the view of that.
    kept: Option<(f64, u64)>,
}

impl Default for Worths {
    fn default() -> Self {
        Self {
            bins: vec![(0.0, 0.0); BINS],
            materials: 0.0,
        }
    }
}

impl Worths {
    /// Adds a material.
    pub(super) fn add(&mut self, btf: &Btf) {
        let pyramid = btf.pyramid();
        let (width, height) = pyramid.mip_size(0);
        let texels = f64::from(width) * f64::from(height);
        self.materials += 1.0;
        let shares: Vec<f64> = pyramid
            .tiles()
            .map(|tile| {
                let (width, height) = pyramid.payload(tile);
                let finest = f64::from(1u32 << (2 * tile.mip));
                (f64::from(width) * f64::from(height) * finest / texels).min(1.0)
            })
            .collect();
        for (weight, share) in btf.weights().zip(shares.iter().cycle()) {
            self.count((f64::from(weight) * share) as f32);
        }
    }

    /// Adds a page; what is no positive number is worth nothing.
    fn count(&mut self, worth: f32) {
        let worth = if worth.is_finite() { worth.max(0.0) } else { 0.0 };
        let (pages, sum) = &mut self.bins[(worth.to_bits() >> BIN_SHIFT) as usize];
        *pages += 1.0;
        *sum += f64::from(worth);
    }

    /// Mean square of what is missing in a view that wants so many pages, if so many have room.
    fn missing(&self, slots: u32, wanted: u32) -> f64 {
        if wanted <= slots {
            return 0.0;
        }
        let pages: f64 = self.bins.iter().map(|(pages, _)| pages).sum();
        let mut room = f64::from(slots) * pages / f64::from(wanted);
        let mut missing = 0.0;
        for &(pages, sum) in self.bins.iter().rev().filter(|(pages, _)| *pages > 0.0) {
            let held = (room / pages).min(1.0);
            room -= held * pages;
            missing += (1.0 - held) * sum;
        }
        missing / self.materials.max(1.0)
    }

    /// Mean squared error of bytes.
    fn rounding(&self) -> f64 {
        let energy: f64 = self.bins.iter().map(|(_, sum)| sum).sum();
        rounding_mse(CREST as f32) * energy / self.materials.max(1.0)
    }

    /// The better format for so many slots of half floats, and of bytes, in a view that wants so many pages.
    fn choose(&self, [half_slots, byte_slots]: [u32; 2], wanted: u32) -> PageFormat {
        let half = self.missing(half_slots, wanted);
        if half > 0.0 && self.missing(byte_slots, wanted) + self.rounding() < half {
            PageFormat::Byte
        } else {
            PageFormat::Half
        }
    }
}

impl Engine {
    /// What texels of the page cache are.
    pub fn page_format(&self) -> PageFormat {
        self.format
    }

    /// Slots of the page cache.
    pub fn page_slots(&self) -> u32 {
        self.renderer.slots().0
    }

    /// Whether there is nothing to choose.
    fn format_is_given(&self) -> bool {
        self.options.page_format.is_some() || self.options.decode_on == super::Decode::Gpu
    }

    /// Nothing is about to change, and what is shown is the page cache as it is.
    pub(super) fn format_is_final(&self) -> bool {
        self.review.frames == 0 && !self.renderer.keeps()
    }

    /// Takes notice of budgets and materials.
    pub(super) fn count_format_slots(&mut self) {
        let slots = |page_format| {
            let caches = Caches {
                page_format,
                ..self.options.caches()
            };
            let layout = self.renderer.layout(caches, self.column_quads());
            layout.map_or(0, |layout| layout.slots().0)
        };
        self.review.slots = [PageFormat::Half, PageFormat::Byte].map(slots);
    }

    /// Pages that would take a slot if there were enough: not those of groups for whose columns there is no room.
    fn pages_in_demand(&mut self) -> u32 {
        let pages = self.summary().pages_wanted;
        let (mut columns, mut last) = (0, None);
        for vote in self.window.votes() {
            if last.replace(vote.material) != Some(vote.material) {
                columns += u32::from(self.btfs[usize::from(vote.material.0)].groups());
            }
        }
        let (_, room) = self.renderer.slots();
        if columns <= room {
            return pages;
        }
        (u64::from(pages) * u64::from(room)).div_ceil(columns.into()) as u32
    }

    /// Counts the frames in which the other format would have been better.
    pub(super) fn review_format(&mut self) {
        if self.format_is_given() || self.btfs.is_empty() {
            return;
        }
        let wanted = self.pages_in_demand();
        let [half, byte] = self.review.slots;
        let half = match self.format {
            PageFormat::Half => half,
            PageFormat::Byte => (u64::from(half) * u64::from(SPARED) / 64) as u32,
        };
        let better = self.worths.choose([half, byte], wanted);
        self.review.frames = if better == self.format {
            0
        } else {
            self.review.frames + 1
        };
    }

    /// Changes the format if that has been better for long enough. All pages leave, and come back from the host's records or the source;
    /// what is being decoded is waited for.
    pub(super) fn follow_review(&mut self) -> Result<()> {
        if self.review.frames < PATIENCE {
            return Ok(());
        }
        self.review.frames = 0;
        self.finish_decoding()?;
        let strips = self.renderer.flush();
        self.renderer.stitch(&strips);
        let mse = self.summary().predicted_mse.abs() + self.format_mse();
        // The first of changes that come upon each other has the whole picture.
        if !self.renderer.keeps() {
            self.review.kept = Some((mse, self.view));
        }
        self.format = match self.format {
            PageFormat::Half => PageFormat::Byte,
            PageFormat::Byte => PageFormat::Half,
        };
        let on_gpu = self.options.decodes_on_gpu(self.renderer.context(), self.format);
        self.records.set_on_gpu(on_gpu);
        for btf in &mut self.btfs {
            Arc::make_mut(btf).page_format = self.format;
        }
        let (_, column_slots) = self.renderer.slots();
        self.set_slots(0, column_slots);
        self.changed = true;
        self.resize_caches()
    }

    /// Shows the new cache when it is no worse than the one that is shown: by the predicted error, or, where the view has
    /// changed meanwhile, when most of what it wants is there; in the end when nothing more comes.
    pub(super) fn show_filled(&mut self, now: &Summary) {
        let Some((mse, view)) = self.review.kept else {
            return;
        };
        let filled = {
            let (slots, _) = self.renderer.slots();
            let wanted = self.pages_in_demand().min(slots);
            self.view != view && now.pages_resident >= wanted - wanted / 8
        };
        let as_good = now.predicted_mse.abs() + self.format_mse() <= mse;
        let done = now.settled && self.records.idle();
        if filled || as_good || done || !self.renderer.keeps() {
            self.review.kept = None;
            self.renderer.show_filled();
            self.changed = true;
        }
    }

    /// Mean squared error of reflectance, over the pixels that vote, that the format of the page cache makes.
    pub(super) fn format_mse(&mut self) -> f64 {
        if self.format == PageFormat::Half {
            return 0.0;
        }
        let (mut sum, mut pixels) = (0.0, 0.0);
        for vote in self.window.votes() {
            let votes = f64::from(vote.pixels);
            pixels += votes;
            let btf = usize::from(vote.material.0);
            let scale = self.btfs[btf].index.manifest.texture_scale;
            sum += votes * self.renderer.rounding_mse(btf, vote.tile) * scale * scale;
        }
        if pixels > 0.0 { sum / pixels } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A material of 16 full pages of the finest mip that are worth this each.
    fn worths(worth: impl Fn(u32) -> f32) -> Worths {
        let mut worths = Worths {
            materials: 1.0,
            ..Default::default()
        };
        (0..16).for_each(|page| worths.count(worth(page)));
        worths
    }

    #[test]
    fn what_is_missing_is_the_least_valuable_part() {
        let falling = worths(|page| 0.5f32.powi(page as i32));
        for slots in [0, 1, 5, 16, 20] {
            let expected: f64 = (slots..16).map(|page| 0.5f64.powi(page as i32)).sum();
            let found = falling.missing(slots, 16);
            assert!((found - expected).abs() < 1e-12, "{slots}: {found} {expected}");
        }
        // A view that wants a quarter of the pages.
        assert!((falling.missing(2, 4) - falling.missing(8, 16)).abs() < 1e-12);
        assert_eq!(falling.missing(4, 4), 0.0);
        assert_eq!(Worths::default().missing(1, 2), 0.0);
    }

    #[test]
    fn bytes_are_chosen_for_what_they_make_room_for() {
        let even = worths(|_| 1.0);
        assert_eq!(even.choose([8, 16], 16), PageFormat::Byte);
        assert_eq!(even.choose([16, 32], 16), PageFormat::Half);
        assert_eq!(even.choose([8, 16], 8), PageFormat::Half);
        assert_eq!(even.choose([8, 16], 9), PageFormat::Byte);
        // A first page that is worth ten thousand times as much: rounding it costs more than the others bring.
        let strong = worths(|page| if page == 0 { 1e6 } else { 1.0 });
        assert_eq!(strong.choose([8, 16], 16), PageFormat::Half);
        // Odd weights count for nothing.
        let odd = worths(|page| [f32::NAN, f32::INFINITY, -1.0, 0.0][page as usize % 4]);
        assert_eq!((odd.missing(0, 16), odd.rounding()), (0.0, 0.0));
        assert_eq!(odd.choose([1, 2], 16), PageFormat::Half);
    }
}
