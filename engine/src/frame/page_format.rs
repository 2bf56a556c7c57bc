//! Which format the page cache has, where the user leaves that to the ledgers: the one with the smaller predicted error.
//!
//! Bytes have room for twice as many pages and round them. What the missing pages of a budget cost is in the directories (the
//! weights of pages, in the unit of all errors), and so is what rounding costs, which goes with the energy. Rank, codec
//! and half floats err alike in both, so they cancel. The view that is thought of sees as many texels of the finest
//! mips as its picture has pixels, twice, because tiles are seen in part, and all materials alike.

use super::Engine;
use crate::{
    Result,
    gpu::{Caches, PageFormat, materials::Btf, page_format::rounding_mse},
};

/// Largest over root mean square magnitude of a component in a slot, typically; measured, see docs/results.md.
const CREST: f64 = 3.8;
/// Texels that a view wants of the finest mips, for each of its pixels.
const TEXELS_SEEN: f64 = 2.0;
/// Bits of a float's exponent and the first three of its mantissa.
const BIN_SHIFT: u32 = 20;
const BINS: usize = 1 << (31 - BIN_SHIFT);

/// All pages of the known materials by what each adds to a material's mean square.
pub(super) struct Worths {
    /// From the least to the most valuable: pages, and their sums.
    bins: Vec<(f64, f64)>,
    materials: f64,
    /// Of the finest mips.
    texels: f64,
}

impl Default for Worths {
    fn default() -> Self {
        Self {
            bins: vec![(0.0, 0.0); BINS],
            materials: 0.0,
            texels: 0.0,
        }
    }
}

impl Worths {
    /// Adds a material.
    pub(super) fn add(&mut self, btf: &Btf) {
        let pyramid = btf.pyramid();
        let (width, height) = pyramid.mip_size(0);
        let texels = f64::from(width) * f64::from(height);
        self.texels += texels;
        self.materials += 1.0;
        let shares: Vec<f64> = pyramid
            .tiles()
            .map(|tile| {
                let (width, height) = pyramid.payload(tile);
                let finest = f64::from(1u32 << (2 * tile.mip));
                (f64::from(width) * f64::from(height) * finest / texels).min(1.0)
            })
            .collect();
        for (record, share) in btf.index.pages().iter().zip(shares.iter().cycle()) {
            self.count((f64::from(record.weight) * share) as f32);
        }
    }

    /// Adds a page; what is no positive number is worth nothing.
    fn count(&mut self, worth: f32) {
        let worth = if worth.is_finite() { worth.max(0.0) } else { 0.0 };
        let (pages, sum) = &mut self.bins[(worth.to_bits() >> BIN_SHIFT) as usize];
        *pages += 1.0;
        *sum += f64::from(worth);
    }

    /// Mean square of what is missing in a view of so many pixels, if so many pages have room.
    fn missing(&self, slots: u32, pixels: f64) -> f64 {
        let seen = (pixels * TEXELS_SEEN / self.texels.max(1.0)).min(1.0);
        let mut room = f64::from(slots) / seen;
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

    /// The better format for so many slots of half floats, and of bytes.
    pub(super) fn choose(&self, half_slots: u32, byte_slots: u32, pixels: f64) -> PageFormat {
        if self.missing(byte_slots, pixels) + self.rounding() < self.missing(half_slots, pixels) {
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

    /// The format for budgets of the page cache: the user's, or what the ledgers say.
    pub(super) fn choose_format(&self, page_bytes: u64, column_quads: u64) -> Result<PageFormat> {
        let options = &self.options;
        if let Some(format) = options.page_format {
            return Ok(format);
        }
        if options.decode_on == super::Decode::Gpu {
            return Ok(PageFormat::Half);
        }
        let slots = |page_format| -> Result<u32> {
            let caches = Caches {
                page_bytes,
                page_format,
                ..options.caches()
            };
            Ok(self.renderer.layout(caches, column_quads)?.slots().0)
        };
        let (half, byte) = (slots(PageFormat::Half)?, slots(PageFormat::Byte)?);
        let (width, height) = options.size;
        Ok(self
            .worths
            .choose(half, byte, f64::from(width) * f64::from(height)))
    }

    /// Makes the page cache one of this format: all its pages leave, and come back from the host's records or the source.
    /// Waits for what is being decoded. The cache itself is replaced by [`Engine::resize_caches`].
    pub(super) fn set_format(&mut self, format: PageFormat) -> Result<()> {
        if format == self.format {
            return Ok(());
        }
        self.finish_decoding()?;
        self.format = format;
        let on_gpu = self.options.decodes_on_gpu(self.renderer.context(), format);
        self.records.set_on_gpu(on_gpu);
        let (_, column_slots) = self.renderer.slots();
        self.set_slots(0, column_slots);
        self.changed = true;
        Ok(())
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
            texels: 16.0 * 4096.0,
            ..Default::default()
        };
        (0..16).for_each(|page| worths.count(worth(page)));
        worths
    }

    #[test]
    fn what_is_missing_is_the_least_valuable_part() {
        let falling = worths(|page| 0.5f32.powi(page as i32));
        let all = 16.0 * 4096.0;
        for slots in [0, 1, 5, 16, 20] {
            let expected: f64 = (slots..16).map(|page| 0.5f64.powi(page as i32)).sum();
            let found = falling.missing(slots, all);
            assert!((found - expected).abs() < 1e-12, "{slots}: {found} {expected}");
        }
        // A view of an eighth of all texels, of which it sees twice as many, wants a quarter of the pages.
        assert!((falling.missing(2, all / 8.0) - falling.missing(8, all)).abs() < 1e-12);
        assert_eq!(Worths::default().missing(1, all), 0.0);
    }

    #[test]
    fn bytes_are_chosen_for_what_they_make_room_for() {
        let (all, even) = (16.0 * 4096.0, worths(|_| 1.0));
        assert_eq!(even.choose(8, 16, all), PageFormat::Byte);
        assert_eq!(even.choose(16, 32, all), PageFormat::Half);
        // A first page that is worth ten thousand times as much: rounding it costs more than the others bring.
        let strong = worths(|page| if page == 0 { 1e6 } else { 1.0 });
        assert_eq!(strong.choose(8, 16, all), PageFormat::Half);
        // Odd weights count for nothing.
        let odd = worths(|page| [f32::NAN, f32::INFINITY, -1.0, 0.0][page as usize % 4]);
        assert_eq!((odd.missing(0, all), odd.rounding()), (0.0, 0.0));
        assert_eq!(odd.choose(1, 2, all), PageFormat::Half);
    }
}
