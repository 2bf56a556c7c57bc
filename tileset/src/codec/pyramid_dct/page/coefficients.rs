//! Records to coefficients: the serial half of decoding, for those who do the rest many texels at a time.
//!
//! Entropy decoding cannot be split; all that follows it can: the transform of the parent's texels, the inverse
//! transform, the border. [`Coefficients`] is what lies between. Words, so that a GPU reads them as they are:
//!
//! - For each block of 16×16 texels of the payload, row by row, one word: in bits 0 to 7 how many coefficients of its
//!   scan are given, the others being zero; in bits 8 to 15 how many of these, the first ones, are whole floats; from bit
//!   16 on where they begin.
//! - The coefficients of the four components in units of the step: four words of floats, or two of half floats.
//!
//! Halves are taken only where they are exact. Coefficients in steps are multiples of 1/128, so that up to 16 steps
//! they always are, and what is larger has low frequencies, which come first. Nothing is rounded between the record and
//! the texel but by the arithmetic itself.
//!
//! The scan goes by diagonals of rising `u + v`, on each of them by rising `v`, and leaves out the lowest
//! ⌈width/2⌉ × ⌈height/2⌉ coefficients. Those are the forward DCT of the parent's texels under the block, times
//! √(texels of the block / texels of the parent).

use half::f16;

use super::source::Before;
use super::{Blocks, parent_origin, scan_of, step_at};
use crate::codec::page::check_step;
use crate::codec::pyramid_dct::border;
use crate::codec::pyramid_dct::context::Expected;
use crate::codec::pyramid_dct::dispatch::{self, Eight, Processor};
use crate::codec::pyramid_dct::levels::Reader;
use crate::codec::pyramid_dct::scan::Place;
use crate::codec::pyramid_dct::tables::PageTables;
use crate::codec::pyramid_dct::transform::{AREA, Block, SIDE};
use crate::codec::texel::Texel;
use crate::error::corrupt;
use crate::{Error, PAGE_TEXELS, PageId, Pyramid, Result};

/// Bits of a block's word below the number of whole floats.
const WHOLE_SHIFT: u32 = 8;
/// Bits below where its coefficients begin.
const START_SHIFT: u32 = 16;
/// Most coefficients of a block that the parent does not give.
const MAX_COUNT: usize = AREA - AREA / 4;
/// Coefficients that are converted together.
const CHUNK: usize = 16;
/// Blocks of a page.
const MAX_BLOCKS: usize = (PAGE_TEXELS as usize / SIDE).pow(2);

/// A page but the root, entropy decoded: what its record says beyond the parent.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Coefficients {
    /// Width and height of the payload in texels.
    pub size: (u32, u32),
    /// The texel of the parent's slot that lies under the first of the payload.
    pub parent_origin: (u32, u32),
    /// Along x and along y, whether the picture ends before and behind the payload, so that the border repeats the edge.
    pub ends: [[bool; 2]; 2],
    /// By which coefficients are multiplied.
    pub step: f32,
    /// Blocks, then coefficients, at most [`Coefficients::MAX_WORDS`].
    pub words: Vec<u32>,
}

impl Coefficients {
    /// Most words of a page: all that the parent does not give of a full page, as whole floats.
    pub const MAX_WORDS: usize = MAX_BLOCKS + MAX_BLOCKS * MAX_COUNT * 4;
}

/// Entropy decodes a page's record; see [`crate::codec::Decoder::coefficients`].
pub(crate) fn coefficients(
    step: f64,
    pyramid: &Pyramid,
    page: PageId,
    bytes: &[u8],
    tables: &PageTables,
) -> Result<Coefficients> {
    let Some(parent_origin) = parent_origin(pyramid, page.tile)? else {
        return Err(Error::Invalid {
            what: format!("coefficients of {page}"),
            detail: "the root has no parent to add them to, decode it to texels".into(),
        });
    };
    let blocks = Blocks::new(pyramid, page.tile);
    let size = (blocks.width as u32, blocks.height as u32);
    let means = tables.means(page.tile.mip, page.group);
    let reader = match bytes {
        [] => None,
        _ => Some(Reader::new(bytes, tables, means)),
    };
    let reader = reader
        .transpose()
        .map_err(|detail| corrupt(page.to_string(), 0, detail))?;
    let step = step_at(check_step(step)?, page.tile.mip);
    let words = dispatch::run(Walk { blocks, reader });
    Ok(Coefficients {
        size,
        parent_origin: (parent_origin.0 as u32, parent_origin.1 as u32),
        ends: border::ends(pyramid, page.tile),
        step,
        words: words.map_err(|detail| corrupt(page.to_string(), 0, detail))?,
    })
}

/// All blocks of a page.
struct Walk<'a> {
    blocks: Blocks,
    /// `None` if the page says nothing that its parent does not.
    reader: Option<Reader<'a>>,
}

impl dispatch::Work for Walk<'_> {
    type Output = std::result::Result<Vec<u32>, String>;

    #[inline(always)]
    fn run(mut self, processor: impl Processor) -> Self::Output {
        let count = self.blocks.corners().count();
        let mut words = vec![(count as u32) << START_SHIFT; count];
        let Some(reader) = &mut self.reader else {
            return Ok(words);
        };
        // What most pages need.
        words.reserve(count * MAX_COUNT * 2);
        let mut spare = None;
        let mut block: Block = [Texel::default(); AREA];
        let mut expected = Expected::new();
        let mut before = Before::new();
        let mut values = Values::new();
        for (at, corner) in self.blocks.corners().enumerate() {
            let place = self.blocks.place(corner);
            let scan = scan_of(&place, &mut spare);
            let end = before.read(processor, reader, &place, scan, 1.0, &mut block, &mut expected)?;
            values.gather(processor, scan.places(end), &block);
            let (count, whole) = (values.count as u32, values.whole as u32);
            words[at] = count | whole << WHOLE_SHIFT | (words.len() as u32) << START_SHIFT;
            values.push(&mut words);
            for place in scan.places(end) {
                block[usize::from(place.at)] = Texel::default();
            }
        }
        self.reader.map_or(Ok(()), Reader::finish)?;
        Ok(words)
    }
}

/// Coefficients of a block in the order of the scan.
struct Values {
    floats: [[f32; 4 * CHUNK]; MAX_COUNT / CHUNK],
    halves: [[f16; 4 * CHUNK]; MAX_COUNT / CHUNK],
    /// Up to the last one that is not zero.
    count: usize,
    /// Up to the last one that is no half float.
    whole: usize,
}

impl Values {
    fn new() -> Self {
        Self {
            floats: [[0.0; _]; _],
            halves: [[f16::ZERO; _]; _],
            count: 0,
            whole: 0,
        }
    }

    #[inline(always)]
    fn gather(&mut self, processor: impl Processor, places: &[Place], block: &Block) {
        (self.count, self.whole) = (0, 0);
        let chunks = self.floats.iter_mut().zip(&mut self.halves);
        for (chunk, (places, (floats, halves))) in places.chunks(CHUNK).zip(chunks).enumerate() {
            for (to, place) in floats.as_chunks_mut::<4>().0.iter_mut().zip(places) {
                *to = block[usize::from(place.at)].0;
            }
            let mut back = [0.0; 4 * CHUNK];
            let eights = floats
                .as_chunks::<8>()
                .0
                .iter()
                .zip(halves.as_chunks_mut::<8>().0);
            for ((floats, halves), back) in eights.zip(back.as_chunks_mut::<8>().0) {
                *halves = processor.eight(*floats).halves();
                *back = processor.eight_halves(*halves).floats();
            }
            let all = floats.as_chunks::<4>().0.iter().zip(back.as_chunks::<4>().0);
            for (number, (value, back)) in (chunk * CHUNK + 1..).zip(all).take(places.len()) {
                if *value != [0.0; 4] {
                    self.count = number;
                }
                if value != back {
                    self.whole = number;
                }
            }
        }
    }

    /// Appends whole floats, then halves.
    #[inline(always)]
    fn push(&self, words: &mut Vec<u32>) {
        let whole = &self.floats.as_flattened()[..4 * self.whole];
        words.extend(whole.iter().map(|value| value.to_bits()));
        // The first component of two in the lower half, on every platform.
        let halves = self.halves.as_flattened()[4 * self.whole..4 * self.count]
            .as_chunks::<2>()
            .0;
        words.extend(
            halves
                .iter()
                .map(|[low, high]| u32::from(low.to_bits()) | u32::from(high.to_bits()) << 16),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::pyramid_dct::page::low_scale;
    use crate::codec::pyramid_dct::page::tests::repeated;
    use crate::codec::pyramid_dct::scan::index;
    use crate::codec::pyramid_dct::transform::matrices;
    use crate::{BORDER_TEXELS, Page, SLOT_AREA, SLOT_TEXELS};
    use proptest::prelude::*;

    /// A block's coefficient, if its record gives one, as a shader finds it.
    fn coefficient(words: &[u32], block: usize, number: usize) -> [f64; 4] {
        let word = words[block];
        let (count, whole) = ((word & 0xff) as usize, (word >> WHOLE_SHIFT & 0xff) as usize);
        let start = (word >> START_SHIFT) as usize;
        std::array::from_fn(|c| {
            if number >= count {
                return 0.0;
            }
            if number < whole {
                return f32::from_bits(words[start + 4 * number + c]).into();
            }
            let pair = words[start + 2 * (number + whole) + c / 2];
            f16::from_bits((pair >> (16 * (c % 2))) as u16).into()
        })
    }

    /// The definition, in f64: what a page's payload is, and the largest magnitude in it.
    fn decode(found: &Coefficients, parent: &Page) -> Vec<(usize, [f64; 4])> {
        let basis = |k: usize, x: usize, length: usize| f64::from(matrices()[length * AREA + k * SIDE + x]);
        let (width, height) = (found.size.0 as usize, found.size.1 as usize);
        let mut texels = Vec::new();
        let corners = (0..height)
            .step_by(SIDE)
            .flat_map(|y| (0..width).step_by(SIDE).map(move |x| (x, y)));
        for (block, (left, top)) in corners.enumerate() {
            let (w, h) = (SIDE.min(width - left), SIDE.min(height - top));
            let low = (w.div_ceil(2), h.div_ceil(2));
            let mut all = vec![[0f64; 4]; AREA];
            for (u, v) in (0..w).flat_map(|u| (0..h).map(move |v| (u, v))) {
                let step = f64::from(found.step);
                all[u * SIDE + v] = match index((w, h), low, (u, v)) {
                    Some(number) => coefficient(&found.words, block, number).map(|value| value * step),
                    None => std::array::from_fn(|c| {
                        let mut sum = 0.0;
                        for (x, y) in (0..low.0).flat_map(|x| (0..low.1).map(move |y| (x, y))) {
                            let row = found.parent_origin.1 as usize + top / 2 + y;
                            let at =
                                row * SLOT_TEXELS as usize + found.parent_origin.0 as usize + left / 2 + x;
                            sum += parent.texels[at][c].to_f64() * basis(u, x, low.0) * basis(v, y, low.1);
                        }
                        sum * f64::from(low_scale((w, h), low))
                    }),
                };
            }
            for (x, y) in (0..w).flat_map(|x| (0..h).map(move |y| (x, y))) {
                let mut sum = [0.0; 4];
                for (u, v) in (0..w).flat_map(|u| (0..h).map(move |v| (u, v))) {
                    let factor = basis(u, x, w) * basis(v, y, h);
                    (0..4).for_each(|c| sum[c] += all[u * SIDE + v][c] * factor);
                }
                let border = BORDER_TEXELS as usize;
                texels.push(((top + y + border) * SLOT_TEXELS as usize + left + x + border, sum));
            }
        }
        texels
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(8))]

        #[test]
        fn coefficients_and_parent_are_the_page(
            width in 1u32..150, height in 1u32..100, tile in 1u32..5, log_step in -9f64..1.0, seed: u32,
        ) {
            let coded = repeated(width, height, (16 * tile, 16), log_step.exp2(), seed);
            let decoded = coded.decode_all();
            for page in &coded.pages {
                let id = PageId { group: 0, tile: page.tile };
                let Some(parent) = coded.pyramid.parent(page.tile) else {
                    prop_assert!(coefficients(coded.step, &coded.pyramid, id, &page.bytes, &coded.tables).is_err());
                    continue;
                };
                for bytes in [&page.bytes[..], &[]] {
                    let found = coefficients(coded.step, &coded.pyramid, id, bytes, &coded.tables).unwrap();
                    prop_assert!(found.words.len() <= Coefficients::MAX_WORDS);
                    let wanted = coded.decode(page.tile, bytes, Some(&decoded[&parent])).unwrap();
                    prop_assert_eq!(found.size, coded.pyramid.payload(page.tile));
                    let found = decode(&found, &decoded[&parent]);
                    // Sums of f32 are as exact as the largest of them.
                    let largest = found.iter().flat_map(|(_, texel)| texel).fold(0f64, |a, b| a.max(b.abs()));
                    for (at, texel) in found {
                        for (found, wanted) in texel.iter().zip(wanted.texels[at]) {
                            let ulp = wanted.to_f64().abs() * f16::EPSILON.to_f64();
                            let limit = ulp + largest * 2e-6 + 6e-8;
                            prop_assert!((found - wanted.to_f64()).abs() <= limit, "{} {}", found, wanted);
                        }
                    }
                }
            }
        }

        #[test]
        fn damage_is_found_where_the_decoder_of_pages_finds_it(
            damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
            noise in prop::collection::vec(any::<u8>(), 0..600),
            cut: prop::sample::Index,
            tile in prop::sample::select(vec![(100, 70), (16, 32)]),
        ) {
            let coded = repeated(100, 70, tile, 0.02, 7);
            let parent = Page { texels: vec![[f16::ONE; 4]; SLOT_AREA] };
            for page in coded.pages.iter().filter(|page| page.tile != coded.pyramid.root()) {
                let mut bytes = page.bytes.clone();
                for (index, value) in damage.iter().filter(|_| !page.bytes.is_empty()) {
                    let place = index.index(bytes.len());
                    bytes[place] ^= value;
                }
                let short = if bytes.is_empty() { 0 } else { cut.index(bytes.len()) };
                for bytes in [&bytes[..], &noise, &page.bytes[..short]] {
                    let id = PageId { group: 0, tile: page.tile };
                    let found = coefficients(coded.step, &coded.pyramid, id, bytes, &coded.tables);
                    let wanted = coded.decode(page.tile, bytes, Some(&parent));
                    match (found, wanted) {
                        (Ok(found), Ok(_)) => prop_assert!(found.words.len() <= Coefficients::MAX_WORDS),
                        (Err(found), Err(wanted)) => prop_assert_eq!(found.to_string(), wanted.to_string()),
                        (found, wanted) => prop_assert!(false, "{:?} {:?}", found.is_ok(), wanted.is_ok()),
                    }
                }
            }
        }
    }

    #[test]
    fn values_are_whole_floats_up_to_the_last_that_is_no_half() {
        let scan = crate::codec::pyramid_dct::scan::Scan::new((SIDE, SIDE), (8, 8));
        let places = scan.places(31);
        let mut block: Block = [Texel::default(); AREA];
        let mut values = Values::new();
        let mut gathered = |at: usize, value: f32| {
            block[usize::from(places[at].at)].0[2] = value;
            values.gather(dispatch::Any, places, &block);
            (values.count, values.whole)
        };
        assert_eq!(gathered(191, 0.0), (0, 0));
        assert_eq!(gathered(3, 2048.0), (4, 0));
        assert_eq!(gathered(7, 16.0 - 1.0 / 128.0), (8, 0));
        assert_eq!(gathered(5, 16.0 + 1.0 / 128.0), (8, 6));
        assert_eq!(gathered(191, 268_435_456.0), (192, 192));
        assert_eq!(gathered(191, -1.0), (192, 6));
        let mut words = Vec::new();
        values.push(&mut words);
        assert_eq!(words.len(), 6 * 4 + 186 * 2);
        assert_eq!(words[5 * 4 + 2], (16.0f32 + 1.0 / 128.0).to_bits());
        assert_eq!(
            words[6 * 4 + 2 + 1],
            u32::from(f16::from_f32(16.0 - 1.0 / 128.0).to_bits())
        );
    }
}
