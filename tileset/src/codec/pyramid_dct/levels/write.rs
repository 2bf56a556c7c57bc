//! Coefficients to levels to symbols.

use super::{ESCAPE, symbol_of};
use crate::codec::pyramid_dct::context::{Context, Expected, Means, magnitude};
use crate::codec::pyramid_dct::scan::{DIAGONALS, Place, Scan};
use crate::codec::pyramid_dct::tables::PageTables;
use crate::codec::pyramid_dct::transform::Block;
use crate::codec::rans::{Encoder, Model};

/// Takes symbols: counts or codes them.
pub(in crate::codec::pyramid_dct) trait Sink {
    /// The number of diagonals of a block.
    fn end(&mut self, model: usize, end: usize);
    /// To which block before it a block adds.
    fn source(&mut self, model: usize, source: usize);
    /// The levels of the four components at one place.
    fn levels(&mut self, found: &[Found; 4]);
}

/// A level and how it came about.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::codec::pyramid_dct) struct Found {
    /// Whose statistics hold for it; see [`Place::like`].
    pub like: u8,
    /// Its context.
    pub context: Context,
    /// The coefficient in steps.
    pub coefficient: f32,
    /// What is coded for it.
    pub level: i32,
}

/// The levels of a block.
pub(in crate::codec::pyramid_dct) struct Chosen {
    /// Diagonals that are coded.
    pub(in crate::codec::pyramid_dct) end: usize,
    /// Those of all places of these diagonals.
    pub(in crate::codec::pyramid_dct) levels: Vec<[Found; 4]>,
    /// Squared error and bits that are worth it, together; in squared steps.
    pub(in crate::codec::pyramid_dct) cost: f32,
}

/// Chooses the levels of a block of coefficients, given in steps, on `least` diagonals or more. `choose` gives the level
/// of a coefficient and what it costs, `end_cost` what a number of diagonals costs, both in squared steps.
pub(in crate::codec::pyramid_dct) fn choose_levels(
    scan: &Scan,
    means: Means,
    coefficients: &Block,
    least: usize,
    choose: impl Fn(f32, Context) -> (i32, f32),
    end_cost: impl Fn(usize) -> f32,
) -> Chosen {
    let places = scan.places(DIAGONALS);
    let mut levels = Vec::with_capacity(places.len());
    let mut expected = Expected::new();
    let energy: f32 = places
        .iter()
        .flat_map(|place| coefficients[usize::from(place.at)].0)
        .map(|value| value * value)
        .sum();
    // What the places so far cost, and what all behind them do if they are left out.
    let (mut cost, mut rest) = (0.0, energy);
    let (mut best, mut end) = match least {
        0 => (energy + end_cost(0), 0),
        _ => (f32::INFINITY, 0),
    };
    for diagonal in 1..=DIAGONALS {
        let first = levels.len();
        let of_diagonal = &scan.places(diagonal)[first..];
        let mut empty = true;
        for &Place { at, grid, like } in of_diagonal {
            let contexts = expected.take(grid, means.at(like));
            let coefficient = coefficients[usize::from(at)].0;
            let found: [Found; 4] = std::array::from_fn(|c| {
                let (context, coefficient) = (contexts[c], coefficient[c]);
                let (level, level_cost) = choose(coefficient, context);
                cost += level_cost;
                rest -= coefficient * coefficient;
                Found {
                    like,
                    context,
                    coefficient,
                    level,
                }
            });
            levels.push(found);
            if found.iter().any(|found| found.level != 0) {
                empty = false;
                expected.add(grid, found.map(|found| magnitude(found.level)));
            }
        }
        if !empty || diagonal == least {
            let total = cost + rest + end_cost(diagonal);
            if total < best {
                (best, end) = (total, diagonal);
            }
        }
    }
    levels.truncate(scan.places(end).len());
    Chosen {
        end,
        levels,
        cost: best,
    }
}

/// Codes with the models of `tables`.
pub(in crate::codec::pyramid_dct) struct Coder<'a> {
    pub(in crate::codec::pyramid_dct) tables: &'a PageTables,
    pub(in crate::codec::pyramid_dct) encoder: Encoder<'a>,
}

impl Sink for Coder<'_> {
    fn end(&mut self, model: usize, end: usize) {
        self.encoder.symbol(0, &self.tables.ends[model], end);
    }

    fn source(&mut self, model: usize, source: usize) {
        if self.tables.has_sources() {
            self.encoder.symbol(1, &self.tables.sources[model], source);
        }
    }

    fn levels(&mut self, found: &[Found; 4]) {
        // All symbols first: a decoder takes them from four lanes at once.
        let symbols = found.map(|found| self.symbol(&found));
        for (lane, (found, symbol)) in found.iter().zip(symbols).enumerate() {
            let model = &self.tables.models[usize::from(found.context.model)];
            self.encoder.symbol(lane, model, symbol);
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
