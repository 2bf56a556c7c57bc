//! One quantity of the entries, weights or lengths: predicted from what is known of it nearby, then the difference.

use super::range::{Coder, Odds};

/// Fraction bits of logarithms.
const FRACTION: u32 = 11;
/// An octave.
pub(super) const OCTAVE: i32 = 1 << FRACTION;
/// Fraction bits of the factors of a filter.
const FACTOR: u32 = 16;
/// Largest magnitude of a factor.
const MAX_FACTOR: i64 = 16 << FACTOR;

/// How a quantity was predicted, and what it was, as logarithms in units of 1 / [`OCTAVE`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Track {
    pub(super) value: i32,
    /// What it has more than the entry before.
    pub(super) step: i32,
    /// Magnitude of what the prediction missed.
    pub(super) error: i32,
}

/// The numbers of a quantity and their logarithms.
pub(super) trait Scale {
    /// Largest number; the smallest is 1.
    fn largest(&self) -> u32;
    /// Logarithm of a number.
    fn log(&self, number: u32) -> i32;
    /// The number of a logarithm from that of the smallest to that of the largest.
    fn number(&self, log: i32) -> u32;
    /// How many eighths of a number's unit, at this number, are as much as a logarithm's magnitude.
    fn eighths(&self, number: u32, magnitude: u64) -> u64;
}

/// Codes of weights, whose logarithms they are: exponent and upper bits of the mantissa of a float.
pub(super) struct Weights;

impl Weights {
    /// Mantissa bits of a weight.
    pub(super) const MANTISSA: u32 = 4;
    /// The largest finite one.
    pub(super) const LARGEST: u32 = (255 << Self::MANTISSA) - 1;
    const SHIFT: u32 = FRACTION - Self::MANTISSA;
}

impl Scale for Weights {
    fn largest(&self) -> u32 {
        Self::LARGEST
    }

    fn log(&self, number: u32) -> i32 {
        (number << Self::SHIFT) as i32
    }

    fn number(&self, log: i32) -> u32 {
        ((log + (1 << (Self::SHIFT - 1))) >> Self::SHIFT) as u32
    }

    fn eighths(&self, _: u32, magnitude: u64) -> u64 {
        (magnitude << 3) >> Self::SHIFT
    }
}

/// Bytes of records, up to so many. Their logarithms are linear between powers of two.
pub(super) struct Lengths(pub(super) u32);

impl Scale for Lengths {
    fn largest(&self) -> u32 {
        self.0
    }

    fn log(&self, number: u32) -> i32 {
        let octave = number.ilog2();
        let rest = u64::from(number) - (1 << octave);
        ((octave << FRACTION) + ((rest << FRACTION) >> octave) as u32) as i32
    }

    fn number(&self, log: i32) -> u32 {
        let (octave, rest) = (log >> FRACTION, log as u64 & (OCTAVE as u64 - 1));
        (1 << octave) + ((rest << octave) >> FRACTION) as u32
    }

    fn eighths(&self, number: u32, magnitude: u64) -> u64 {
        (magnitude * u64::from(number)) >> (FRACTION - 3)
    }
}

/// Weights or lengths of a kind of records, as they are coded one after the other.
pub(super) struct Quantity<const N: usize> {
    filter: Filter<N>,
    differences: Differences,
}

impl<const N: usize> Quantity<N> {
    /// With the factors to begin with, and how slowly they learn.
    pub(super) fn new(factors: [i32; N], slowness: u32) -> Self {
        Self {
            filter: Filter { factors, slowness },
            differences: Differences::new(),
        }
    }

    /// Codes a number, or, with none, only what would have been expected. `before` is what it is compared with, `near` what
    /// else tells how well it may be predicted, and `inputs` what changed elsewhere since the entry before.
    ///
    /// The message says that the number cannot be.
    pub(super) fn code(
        &mut self,
        coder: &mut impl Coder,
        scale: &impl Scale,
        (before, near): (Track, [Track; 3]),
        inputs: [i32; N],
        number: Option<u32>,
    ) -> Result<(u32, Track), String> {
        let (least, most) = (scale.log(1), scale.log(scale.largest()));
        let predicted =
            (i64::from(before.value) + self.filter.predict(inputs)).clamp(least.into(), most.into()) as i32;
        let errors = near.iter().fold(before.error, |sum, track| sum + track.error);
        let (number, value, error) = match number {
            None => (0, predicted, errors / 4),
            Some(number) => {
                let expected = scale.number(predicted);
                let doubt = scale.eighths(expected, errors as u64) / 4;
                let difference = i64::from(number) - i64::from(expected);
                let number = i64::from(expected) + self.differences.code(coder, difference, doubt);
                let number = u32::try_from(number)
                    .ok()
                    .filter(|number| (1..=scale.largest()).contains(number))
                    .ok_or_else(|| format!("{number}, not from 1 to {},", scale.largest()))?;
                let value = scale.log(number);
                self.filter.learn(inputs, value - predicted);
                (number, value, (value - predicted).abs())
            }
        };
        let step = value - before.value;
        Ok((number, Track { value, step, error }))
    }
}

/// A linear prediction whose factors follow what it misses (normalized least mean squares).
struct Filter<const N: usize> {
    /// In 65,536ths.
    factors: [i32; N],
    slowness: u32,
}

impl<const N: usize> Filter<N> {
    fn predict(&self, inputs: [i32; N]) -> i64 {
        let products = self.factors.iter().zip(inputs);
        products
            .map(|(&factor, input)| i64::from(factor) * i64::from(input))
            .sum::<i64>()
            >> FACTOR
    }

    fn learn(&mut self, inputs: [i32; N], missed: i32) {
        let square = |input: i32| i64::from(input) * i64::from(input);
        // A sixteenth of an octave is added, so that noise teaches little.
        let power = inputs.iter().map(|&input| square(input)).sum::<i64>() + square(OCTAVE / 16);
        let pull = (i64::from(missed) << 24) / power;
        for (factor, input) in self.factors.iter_mut().zip(inputs) {
            let change = (pull * i64::from(input)) >> (24 - FACTOR + self.slowness);
            *factor = (i64::from(*factor) + change).clamp(-MAX_FACTOR, MAX_FACTOR) as i32;
        }
    }
}

/// What stands in unary at most; more follows as a number of bits and these.
const UNARY: usize = 20;
/// The eighths of a unit of doubt from which on lower bits are plain.
const FINE: u32 = 3;

/// Differences from a prediction, coarser the larger they are expected.
struct Differences {
    /// By the doubt, in half octaves, and the coarse magnitude so far: is it larger?
    larger: [[Odds; UNARY]; 8],
    /// By the same: the bit below.
    below: [[Odds; UNARY + 1]; 8],
}

impl Differences {
    fn new() -> Self {
        Self {
            larger: [[Odds::EVEN; UNARY]; 8],
            below: [[Odds::EVEN; UNARY + 1]; 8],
        }
    }

    /// `doubt`: the expected magnitude, in eighths.
    fn code(&mut self, coder: &mut impl Coder, difference: i64, doubt: u64) -> i64 {
        let doubt = doubt.clamp(1, 1 << 27);
        let octave = doubt.ilog2();
        let half = ((doubt << 1) >> octave) as usize & 1;
        let fine = octave.saturating_sub(FINE);
        let class = 2 * (octave - fine) as usize + half;

        let magnitude = difference.unsigned_abs();
        let coarse = magnitude >> fine;
        let mut found = 0;
        while found < UNARY && coder.bit(&mut self.larger[class][found], coarse > found as u64) {
            found += 1;
        }
        let mut coded = found as u64;
        if found == UNARY {
            coded += beyond(coder, coarse.saturating_sub(UNARY as u64));
        }
        if fine > 0 {
            let below = coder.bit(&mut self.below[class][found], magnitude >> (fine - 1) & 1 == 1);
            let rest = coder.plain(magnitude as u32, fine - 1);
            let mask = (1 << (fine - 1)) - 1;
            coded = (coded << 1 | u64::from(below)) << (fine - 1) | u64::from(rest & mask);
        }
        let negative = coded != 0 && coder.plain((difference < 0).into(), 1) & 1 == 1;
        if negative { -(coded as i64) } else { coded as i64 }
    }
}

/// A number of any size below 2³¹: how many bits it has with 1 added, in unary, and those below the highest.
fn beyond(coder: &mut impl Coder, number: u64) -> u64 {
    let bits = (number + 1).ilog2();
    let mut found = 0;
    while found < 31 && coder.plain((bits > found).into(), 1) & 1 == 1 {
        found += 1;
    }
    let rest = u64::from(coder.plain((number + 1) as u32, found)) & ((1 << found) - 1);
    (1 << found) + rest - 1
}
