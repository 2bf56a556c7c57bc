//! Symbols to levels to coefficients.

use super::{ESCAPE, MAX_LEVEL, end_model, source_model};
use crate::codec::pyramid_dct::context::{Context, Expected, Means, magnitude};
use crate::codec::pyramid_dct::scan::Scan;
use crate::codec::pyramid_dct::tables::PageTables;
use crate::codec::pyramid_dct::transform::Block;
use crate::codec::rans::{Buckets, Decoder};
use crate::codec::texel::Texel;

/// What decodes the levels of a page's blocks.
#[derive(Clone, Copy)]
pub(in crate::codec::pyramid_dct) struct Reader<'a> {
    pub(super) decoder: Decoder<'a>,
    pub(super) tables: &'a PageTables,
    /// By model.
    pub(super) buckets: &'a [Buckets; 64],
    /// Coefficients in steps, by model and symbol.
    pub(super) values: &'a [[f32; 64]; 64],
    pub(super) means: Means<'a>,
    /// Diagonals of the last block.
    pub(super) last_end: usize,
    /// Source of the last block that has levels.
    last_source: usize,
    /// Whether blocks may have sources.
    has_sources: bool,
}

impl<'a> Reader<'a> {
    /// Of a page in a group and mip whose `means` these are; the message says why there can be none.
    pub(in crate::codec::pyramid_dct) fn new(
        bytes: &'a [u8],
        tables: &'a PageTables,
        means: Means<'a>,
    ) -> Result<Self, String> {
        if !tables.is_trained() {
            return Err("tables of the page codec without models".to_owned());
        }
        Ok(Self {
            decoder: Decoder::new(bytes)?,
            tables,
            buckets: &tables.buckets,
            values: &tables.values,
            means,
            last_end: 0,
            last_source: 0,
            has_sources: tables.has_sources(),
        })
    }

    /// The number of diagonals of the next block.
    #[inline(always)]
    pub(in crate::codec::pyramid_dct) fn end(&mut self) -> usize {
        self.last_end = self
            .decoder
            .symbol(0, &self.tables.ends[end_model(self.last_end)].buckets);
        self.last_end
    }

    /// Whether blocks may have sources.
    #[inline(always)]
    pub(in crate::codec::pyramid_dct) fn has_sources(&self) -> bool {
        self.has_sources
    }

    /// How many blocks back the block lies to which the next one, which has diagonals, adds; 0 for none.
    #[inline(always)]
    pub(in crate::codec::pyramid_dct) fn source(&mut self) -> usize {
        let model = &self.tables.sources[source_model(self.last_source)];
        self.last_source = self.decoder.symbol(1, &model.buckets);
        self.last_source
    }

    /// Decodes the first `end` diagonals of a block, times `step`, into `block`. Takes nothing as known before, and
    /// leaves nothing known in `expected`.
    ///
    /// Not inlined: with the registers for itself it is faster.
    #[inline(never)]
    pub(in crate::codec::pyramid_dct) fn read(
        &mut self,
        scan: &Scan,
        end: usize,
        step: f32,
        block: &mut Block,
        expected: &mut Expected,
    ) {
        // A copy, so that states stay in registers.
        let mut reader = *self;
        for place in scan.places(end) {
            let contexts = expected.take(place.grid, reader.means.at(place.like));
            let models = contexts.map(|context| usize::from(context.model) % 64);
            let symbols = reader.decoder.symbols(models.map(|model| &reader.buckets[model]));
            let (values, magnitudes) = if symbols
                .iter()
                .zip(contexts)
                .any(|(&symbol, context)| symbol == ESCAPE || context.shift > 0)
            {
                reader.rest_of_all(contexts, symbols)
            } else {
                (
                    std::array::from_fn(|c| reader.values[models[c]][symbols[c] % 64]),
                    symbols.map(|symbol| (symbol as i32 + 1) >> 1),
                )
            };
            block[usize::from(place.at)] = Texel(values) * step;
            expected.add(place.grid, magnitudes);
        }
        expected.forget(scan, end);
        *self = reader;
    }

    /// Coefficients in steps and magnitudes where symbols do not say all.
    pub(super) fn rest_of_all(
        &mut self,
        contexts: [Context; 4],
        symbols: [usize; 4],
    ) -> ([f32; 4], [i32; 4]) {
        let (mut values, mut magnitudes) = ([0.0; 4], [0; 4]);
        for c in 0..4 {
            let level = rest(&mut self.decoder, c, contexts[c], symbols[c]);
            (values[c], magnitudes[c]) = (self.tables.value(contexts[c], level), magnitude(level));
        }
        (values, magnitudes)
    }

    /// Checks that all is read; the message says what is wrong.
    pub(in crate::codec::pyramid_dct) fn finish(self) -> Result<(), String> {
        self.decoder.finish()
    }
}

/// The level behind a symbol, with what follows it.
fn rest(decoder: &mut Decoder, lane: usize, Context { shift, .. }: Context, symbol: usize) -> i32 {
    let (mut magnitude, mut negative) = ((symbol as u32).div_ceil(2), symbol.is_multiple_of(2));
    if symbol == ESCAPE {
        let count = decoder.bits(lane, 5);
        let low = decoder.bits(lane, count.min(16));
        let high = decoder.bits(lane, count.saturating_sub(16).min(16));
        magnitude =
            ((1u64 << count | u64::from(high) << 16 | u64::from(low)) - 1).min(MAX_LEVEL as u64) as u32;
        negative = decoder.bits(lane, 1) == 1;
    }
    if shift > 0 {
        let low = decoder.bits(lane, shift.into());
        if magnitude == 0 && low > 0 {
            negative = decoder.bits(lane, 1) == 1;
        }
        magnitude = ((u64::from(magnitude) << shift) | u64::from(low)).min(MAX_LEVEL as u64) as u32;
    }
    if negative {
        -(magnitude as i32)
    } else {
        magnitude as i32
    }
}
