//! Records to coefficients: the serial half of decoding, for those who do the rest many texels at a time.
//!
//! Entropy decoding cannot be split; all that follows it can: the transform of the parent's texels, the inverse
//! transform, the border. [`Coefficients`] is what lies between. Words, so that a GPU reads them as they are:
//!
//! - For each block of 16×16 texels of the payload, row by row, one word: in bits 0 to 14 how many coefficients of its
//!   scan are given, the others being zero; in bit 15 whether they are whole floats; from bit 16 on where they begin.
//! - The coefficients of the four components in units of the step: two words of half floats, or four of floats.
//!
//! Halves are taken only where they are exact. Coefficients in steps are multiples of 1/128, so that up to 16 steps
//! they always are; nothing is rounded between the record and the texel but by the arithmetic itself.
//!
//! The scan goes by diagonals of rising `u + v`, on each of them by rising `v`, and leaves out the lowest
//! ⌈width/2⌉ × ⌈height/2⌉ coefficients. Those are the forward DCT of the parent's texels under the block, times
//! √(texels of the block / texels of the parent).

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::{Blocks, parent_origin, scan_of, step_at};
use crate::codec::page::check_step;
use crate::codec::pyramid_dct::border;
use crate::codec::pyramid_dct::dispatch::{self, Processor};
use crate::codec::pyramid_dct::levels::Reader;
use crate::codec::pyramid_dct::tables::PageTables;
use crate::codec::pyramid_dct::transform::{AREA, Block, SIDE};
use crate::codec::texel::Texel;
use crate::error::corrupt;
use crate::{Error, PAGE_TEXELS, PageId, Pyramid, Result};

/// Bit of a block's word: its coefficients are whole floats.
const WHOLE: u32 = 1 << 15;
/// Bits below where a block's coefficients begin.
const START_SHIFT: u32 = 16;
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
    pub const MAX_WORDS: usize = MAX_BLOCKS + MAX_BLOCKS * (AREA - AREA / 4) * 4;
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
        let mut spare = None;
        let mut block: Block = [Texel::default(); AREA];
        for (at, corner) in self.blocks.corners().enumerate() {
            let scan = scan_of(&self.blocks.place(corner), &mut spare);
            block.fill(Texel::default());
            let end = processor.read(reader, scan, 1.0, &mut block);
            let mut values = [[0f32; 4]; AREA];
            let mut count = 0;
            for (place, (number, value)) in scan.places(end).iter().zip((1..).zip(&mut values)) {
                *value = block[usize::from(place.at)].0;
                if *value != [0.0; 4] {
                    count = number;
                }
            }
            words[at] = count as u32 | (words.len() as u32) << START_SHIFT;
            if !push_halves(&mut words, &values[..count]) {
                words[at] |= WHOLE;
                words.extend(values[..count].as_flattened().iter().map(|value| value.to_bits()));
            }
        }
        self.reader.map_or(Ok(()), Reader::finish)?;
        Ok(words)
    }
}

/// Appends values as half floats, if all of them are.
fn push_halves(words: &mut Vec<u32>, values: &[[f32; 4]]) -> bool {
    let mut halves = [[f16::ZERO; 4]; AREA];
    let mut back = [[0f32; 4]; AREA];
    let (halves, back) = (&mut halves[..values.len()], &mut back[..values.len()]);
    halves
        .as_flattened_mut()
        .convert_from_f32_slice(values.as_flattened());
    halves
        .as_flattened()
        .convert_to_f32_slice(back.as_flattened_mut());
    let exact = *back == *values;
    if exact {
        // The first component of two in the lower half, on every platform.
        let pairs = halves.as_flattened().as_chunks::<2>().0.iter();
        words.extend(pairs.map(|[low, high]| u32::from(low.to_bits()) | u32::from(high.to_bits()) << 16));
    }
    exact
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::pyramid_dct::page::low_scale;
    use crate::codec::pyramid_dct::page::tests::coded;
    use crate::codec::pyramid_dct::scan::index;
    use crate::codec::pyramid_dct::transform::matrices;
    use crate::{BORDER_TEXELS, Page, SLOT_AREA, SLOT_TEXELS};
    use proptest::prelude::*;

    /// A block's coefficient, if its record gives one, as a shader finds it.
    fn coefficient(words: &[u32], block: usize, number: usize) -> [f64; 4] {
        let word = words[block];
        if number >= (word % WHOLE) as usize {
            return [0.0; 4];
        }
        let start = (word >> START_SHIFT) as usize;
        std::array::from_fn(|c| {
            if word & WHOLE != 0 {
                return f32::from_bits(words[start + 4 * number + c]).into();
            }
            let pair = words[start + 2 * number + c / 2];
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
            width in 1u32..150, height in 1u32..100, log_step in -9f64..1.0, seed: u32,
        ) {
            let coded = coded(width, height, log_step.exp2(), seed);
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
        ) {
            let coded = coded(100, 70, 0.02, 7);
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
    fn large_values_are_whole_floats() {
        let mut words = Vec::new();
        assert!(push_halves(&mut words, &[[15.9921875, -0.0078125, 0.0, 2048.0]]));
        assert_eq!(words.len(), 2);
        assert!(!push_halves(&mut words, &[[16.0 + 1.0 / 128.0, 0.0, 0.0, 0.0]]));
        assert!(!push_halves(&mut words, &[[268_435_456.0, 0.0, 0.0, 0.0]]));
        assert_eq!(words.len(), 2);
    }
}
