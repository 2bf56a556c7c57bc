//! The levels of a block to symbols and back.
//!
//! A block opens with the number of diagonals that hold a level other than zero, for all four components together;
//! then come the levels of these diagonals, four at each place. A level in units of 2^shift is one symbol up to
//! ±[`LARGEST_SYMBOL`]; beyond that, or where the model has never seen it, an escape and an Elias gamma code. The
//! shifted bits follow as they are.

use super::context::{Class, Context, EMPTY, FIRST_ROW, MODELS, classes, magnitude};
use super::scan::{DIAGONALS, Place, Scan};
use super::tables::PageTables;
use super::transform::{AREA, Block, SIDE};
use crate::codec::rans::{Decoder, Encoder, Model};
use crate::codec::texel::Texel;

/// Largest level, in units of 2^shift, that is a symbol of its own.
pub(super) const LARGEST_SYMBOL: u32 = 30;
/// The symbol that stands for any other level.
pub(super) const ESCAPE: usize = 2 * LARGEST_SYMBOL as usize + 1;
/// Symbols of a level.
pub(super) const SYMBOLS: usize = ESCAPE + 1;
/// Largest accepted level.
pub(super) const MAX_LEVEL: i32 = 1 << 28;
/// Models of the number of diagonals: by that of the block before.
pub(super) const END_MODELS: usize = 8;

/// Takes symbols: counts or codes them.
pub(super) trait Sink {
    /// The number of diagonals of a block.
    fn end(&mut self, model: usize, end: usize);
    /// The levels of the four components at one place.
    fn levels(&mut self, found: &[Found; 4]);
}

/// A level and how it came about.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    /// Whose statistics hold for it; see [`super::scan::Place::like`].
    pub like: u8,
    /// Its context.
    pub context: Context,
    /// The coefficient in steps.
    pub coefficient: f32,
    /// What is coded for it.
    pub level: i32,
}

/// The model of a block's number of diagonals, from that of the block before.
pub(super) fn end_model(last: usize) -> usize {
    // 0 stands for an empty block.
    (last.div_ceil(4)).min(END_MODELS - 1)
}

/// The symbol of a level in units of 2^shift, if it has one: 0, 1, -1, 2, …
pub(super) fn symbol_of(level: i32, shift: u8) -> Option<usize> {
    let magnitude = level.unsigned_abs() >> shift;
    match magnitude {
        0 => Some(0),
        1..=LARGEST_SYMBOL => Some(2 * magnitude as usize - usize::from(level > 0)),
        _ => None,
    }
}

/// Chooses the levels of a block of coefficients, given in steps, and gives them to `sink`; returns the number of
/// diagonals.
pub(super) fn write(
    sink: &mut impl Sink,
    scan: &Scan,
    means: &[i32; AREA],
    last_end: usize,
    coefficients: &Block,
    choose: impl Fn(f32, Context) -> i32,
) -> usize {
    let mut levels = Vec::with_capacity(scan.count(DIAGONALS));
    let mut coded = 0;
    let (mut before, mut last) = (EMPTY, EMPTY);
    for diagonal in 0..DIAGONALS {
        let mut now = EMPTY;
        let places = scan.diagonal(diagonal);
        let classes = classes(&last, &before, places, means);
        for &Place { at, row, like } in places {
            let row = usize::from(row);
            let contexts = classes[row].contexts();
            let coefficient = coefficients[usize::from(at)].0;
            let mut found = [Found::default(); 4];
            for c in 0..4 {
                let (context, coefficient) = (contexts[c], coefficient[c]);
                let level = choose(coefficient, context);
                now[row + FIRST_ROW][c] = magnitude(level);
                found[c] = Found {
                    like,
                    context,
                    coefficient,
                    level,
                };
            }
            levels.push(found);
            if found.iter().any(|found| found.level != 0) {
                coded = levels.len();
            }
        }
        (before, last) = (last, now);
    }
    let end = scan.diagonals(coded);
    sink.end(end_model(last_end), end);
    for found in &levels[..scan.count(end)] {
        sink.levels(found);
    }
    end
}

/// Codes with the models of `tables`.
pub(super) struct Coder<'a> {
    pub(super) tables: &'a PageTables,
    pub(super) encoder: Encoder,
    /// Sum of the squares of what the levels stand for, in steps.
    pub(super) energy: f64,
}

impl Sink for Coder<'_> {
    fn end(&mut self, model: usize, end: usize) {
        self.encoder.symbol(0, &self.tables.ends[model], end);
    }

    fn levels(&mut self, found: &[Found; 4]) {
        // All symbols first: a decoder takes them from four lanes at once.
        let symbols = found.map(|found| self.symbol(&found));
        for (lane, (found, symbol)) in found.iter().zip(symbols).enumerate() {
            let model = &self.tables.models[usize::from(found.context.model)];
            self.encoder.symbol(lane, model, symbol);
            self.energy += f64::from(self.tables.value(found.context, found.level)).powi(2);
        }
        for (lane, (found, symbol)) in found.iter().zip(symbols).enumerate() {
            self.rest(lane, found, symbol);
        }
    }
}

impl Coder<'_> {
    fn model(&self, found: &Found) -> &Model {
        &self.tables.models[usize::from(found.context.model)]
    }

    fn symbol(&self, found: &Found) -> usize {
        symbol_of(found.level, found.context.shift)
            .filter(|&symbol| self.model(found).bits(symbol).is_finite())
            .unwrap_or(ESCAPE)
    }

    /// What the symbol does not say.
    fn rest(&mut self, lane: usize, found: &Found, symbol: usize) {
        let (shift, level) = (found.context.shift, found.level);
        let magnitude = level.unsigned_abs();
        if symbol == ESCAPE {
            // The magnitude in units of 2^shift plus one has `count` bits behind its leading one.
            let high = (magnitude >> shift) + 1;
            let count = high.ilog2();
            self.encoder.bits(lane, count, 5);
            self.encoder
                .bits(lane, high & ((1 << count.min(16)) - 1), count.min(16));
            self.encoder.bits(
                lane,
                (high ^ 1 << count) >> count.min(16),
                count.saturating_sub(16),
            );
            self.encoder.bits(lane, u32::from(level < 0), 1);
        }
        if shift > 0 {
            let low = magnitude & ((1 << shift) - 1);
            self.encoder.bits(lane, low, shift.into());
            if magnitude >> shift == 0 && low > 0 {
                self.encoder.bits(lane, u32::from(level < 0), 1);
            }
        }
    }
}

/// What decodes the levels of a page's blocks.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a> {
    decoder: Decoder<'a>,
    tables: &'a PageTables,
    models: &'a [Model; MODELS],
    /// Coefficients by model and symbol, in steps.
    values: &'a [[f32; 64]; MODELS],
    means: &'a [i32; AREA],
    /// Diagonals of the last block.
    last_end: usize,
}

impl<'a> Reader<'a> {
    /// Of a page in a group and mip whose `means` these are; the message says why there can be none.
    pub(super) fn new(
        bytes: &'a [u8],
        tables: &'a PageTables,
        means: &'a [i32; AREA],
    ) -> Result<Self, String> {
        let untrained = || "tables of the page codec without models".to_owned();
        Ok(Self {
            decoder: Decoder::new(bytes)?,
            tables,
            models: tables.models.first_chunk().ok_or_else(untrained)?,
            values: tables.values.first_chunk().ok_or_else(untrained)?,
            means,
            last_end: 0,
        })
    }

    /// Decodes a block's coefficients, in units of the step, into `block`, which is zero; returns the number of
    /// diagonals.
    #[inline(always)]
    pub(super) fn read(&mut self, scan: &Scan, block: &mut Block) -> usize {
        // A copy, so that states stay in registers.
        let mut reader = *self;
        reader.last_end = reader
            .decoder
            .symbol(0, &reader.tables.ends[end_model(reader.last_end)]);
        let (mut first, mut second, mut third) = (EMPTY, EMPTY, EMPTY);
        let (mut before, mut last, mut now) = (&mut first, &mut second, &mut third);
        for diagonal in 0..reader.last_end {
            // All contexts first: they depend on earlier diagonals only, and no symbol has to wait for them.
            let places = scan.diagonal(diagonal);
            let classes = classes(last, before, places, reader.means);
            *now = EMPTY;
            for place in places {
                let row = usize::from(place.row) % SIDE;
                if let Some((values, magnitudes)) = reader.levels(&classes[row]) {
                    block[usize::from(place.at)] = Texel(values);
                    now[row + FIRST_ROW] = magnitudes;
                }
            }
            (before, last, now) = (last, now, before);
        }
        *self = reader;
        self.last_end
    }

    /// The next four coefficients and their magnitudes; `None` if all are zero.
    #[inline(always)]
    fn levels(&mut self, class: &Class) -> Option<([f32; 4], [u16; 4])> {
        if !class.are_unshifted() {
            let contexts = class.contexts();
            let symbols = self
                .decoder
                .symbols(contexts.map(|context| &self.models[usize::from(context.model)]));
            return Some(self.rest_of_all(contexts, symbols));
        }
        let indices = class.models();
        let [a, b, c, d] = indices;
        let models = [&self.models[a], &self.models[b], &self.models[c], &self.models[d]];
        if class.are_likely_zero() && self.decoder.zeros(models) {
            return None;
        }
        let symbols = self.decoder.symbols(models);
        let (mut values, mut magnitudes, mut escaped) = ([0.0; 4], [0; 4], false);
        for c in 0..4 {
            values[c] = self.values[indices[c]][symbols[c] & 63];
            magnitudes[c] = (symbols[c] as u16).div_ceil(2);
            escaped |= symbols[c] == ESCAPE;
        }
        if escaped {
            return Some(self.rest_of_all(class.contexts(), symbols));
        }
        Some((values, magnitudes))
    }

    /// Coefficients and magnitudes where symbols do not say all.
    #[inline(always)]
    fn rest_of_all(&mut self, contexts: [Context; 4], symbols: [usize; 4]) -> ([f32; 4], [u16; 4]) {
        let (mut values, mut magnitudes) = ([0.0; 4], [0; 4]);
        for c in 0..4 {
            let level;
            (self.decoder, level) = rest(self.decoder, c, contexts[c], symbols[c]);
            (values[c], magnitudes[c]) = (self.tables.value(contexts[c], level), magnitude(level));
        }
        (values, magnitudes)
    }

    /// Checks that all is read; the message says what is wrong.
    pub(super) fn finish(self) -> Result<(), String> {
        self.decoder.finish()
    }
}

/// The level behind a symbol, with what follows it.
#[cold]
#[inline(never)]
fn rest<'a>(
    mut decoder: Decoder<'a>,
    lane: usize,
    Context { shift, .. }: Context,
    symbol: usize,
) -> (Decoder<'a>, i32) {
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
    (
        decoder,
        if negative {
            -(magnitude as i32)
        } else {
            magnitude as i32
        },
    )
}
