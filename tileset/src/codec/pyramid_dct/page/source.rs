//! Blocks that go on from earlier blocks of their page.
//!
//! A block may name one before it in the page, its source, and then its coefficients are those of the source plus what
//! is coded. It pays where a material repeats: a weave, tiles, studs. Sums are made in steps, where they are exact, and
//! before anything is transformed, so that decoding still splits into its serial half and the rest.
//!
//! Source: intra block copy (Xu et al., "Overview of the emerging HEVC screen content coding extension", 2016), here of
//! coefficients, so that what repeats must do so at whole blocks.

use super::Place;
use crate::codec::pyramid_dct::context::Expected;
use crate::codec::pyramid_dct::dispatch::{self, Processor};
use crate::codec::pyramid_dct::levels::{Reader, SOURCES};
use crate::codec::pyramid_dct::scan::Scan;
use crate::codec::pyramid_dct::transform::{AREA, Block};
use crate::codec::texel::Texel;

/// Coefficients of the blocks of a page that are decoded so far, in steps.
pub(super) struct Before {
    /// Of all blocks, in the order of their scans.
    texels: Vec<Texel>,
    blocks: Vec<Known>,
}

/// One of them.
#[derive(Clone, Copy)]
struct Known {
    size: (usize, usize),
    /// Its first coefficient.
    start: usize,
    /// Diagonals that are not zero.
    end: usize,
}

impl Before {
    /// None so far.
    pub(super) fn new() -> Self {
        Self {
            texels: Vec::new(),
            blocks: Vec::new(),
        }
    }

    /// Decodes the next block of a page, times `step`, into `block`, which is zero; returns how many diagonals of it may
    /// not be zero any more. The message says what is wrong.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "the state of a page, in registers")]
    pub(super) fn read(
        &mut self,
        processor: impl Processor,
        reader: &mut Reader,
        place: &Place,
        scan: &Scan,
        step: f32,
        block: &mut Block,
        expected: &mut Expected,
    ) -> Result<usize, String> {
        let end = reader.end();
        if !reader.has_sources() {
            if end > 0 {
                processor.read(reader, scan, end, step, block, expected);
            }
            return Ok(end);
        }
        let start = self.texels.len();
        let mut known = Known {
            size: place.size,
            start,
            end,
        };
        if end > 0 {
            let back = reader.source();
            processor.read(reader, scan, end, 1.0, block, expected);
            if back > 0 {
                known.end = self.add(back, known, scan, block)?;
            }
            let places = scan.places(known.end);
            self.texels
                .extend(places.iter().map(|place| block[usize::from(place.at)]));
            for place in places {
                let texel = &mut block[usize::from(place.at)];
                *texel = *texel * step;
            }
        }
        self.blocks.push(known);
        Ok(known.end)
    }

    /// Adds the block that lies so many blocks back; returns the diagonals of the sum.
    fn add(&self, back: usize, to: Known, scan: &Scan, block: &mut Block) -> Result<usize, String> {
        let source = self
            .blocks
            .len()
            .checked_sub(back)
            .map(|index| self.blocks[index])
            .filter(|source| source.size == to.size)
            .ok_or_else(|| {
                format!(
                    "block {} goes on from the one {back} before it, which is none of its size",
                    self.blocks.len()
                )
            })?;
        let places = scan.places(source.end);
        for (place, &texel) in places.iter().zip(&self.texels[source.start..]) {
            let sum = &mut block[usize::from(place.at)];
            *sum = texel + *sum;
        }
        Ok(to.end.max(source.end))
    }
}

/// Blocks of a page that are coded so far, as decoders will have them.
#[derive(Default)]
pub(super) struct Coded(Vec<CodedBlock>);

struct CodedBlock {
    size: (usize, usize),
    /// Coefficients in steps; `None` if all are zero.
    coefficients: Option<Box<Block>>,
}

/// About what a source saves at least, in bits, to be tried.
const LEAST_SAVING: f32 = 8.0;

impl Coded {
    /// Appends the next block; `None` if all of it is zero.
    pub(super) fn push(&mut self, size: (usize, usize), coefficients: Option<Box<Block>>) {
        self.0.push(CodedBlock { size, coefficients });
    }

    /// The coefficients of the block that lies so many blocks back.
    pub(super) fn block(&self, back: usize) -> Option<&Block> {
        let index = self.0.len().checked_sub(back)?;
        self.0.get(index)?.coefficients.as_deref()
    }

    /// How many blocks back the best source lies for a block of this size, if there is a good one.
    pub(super) fn best_source(&self, size: (usize, usize), block: &Block) -> Option<usize> {
        let nothing = [Texel::default(); AREA];
        let bits = |source| dispatch::run(Bits { block, source });
        let mut best = (bits(&nothing) - LEAST_SAVING, None);
        let before = self.0.iter().rev().zip(1..SOURCES);
        for (other, back) in before.filter(|(other, _)| other.size == size) {
            if let Some(source) = other.coefficients.as_deref() {
                let bits = bits(source);
                if bits < best.0 {
                    best = (bits, Some(back));
                }
            }
        }
        best.1
    }
}

/// About how many bits a block takes, in units of its steps, if it goes on from another: half the logarithm of
/// 1 + 8·difference².
struct Bits<'a> {
    block: &'a Block,
    source: &'a Block,
}

impl dispatch::Work for Bits<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self, _: impl Processor) -> f32 {
        let mut sums = [0u32; 4];
        for (texel, source) in self.block.iter().zip(self.source) {
            let difference = *texel - *source;
            for (sum, difference) in sums.iter_mut().zip(difference.0) {
                // The bits of a float are its logarithm, piecewise linear; without the last ten, so that all fit.
                let square = 1.0 + 8.0 * difference * difference;
                *sum += (square.to_bits() - 1f32.to_bits()) >> 10;
            }
        }
        sums.iter().sum::<u32>() as f32 / f32::from(2u16 << 13)
    }
}
