//! Probabilities of symbols.

use std::sync::OnceLock;

use super::{MAX_SYMBOLS, PROBABILITY_BITS, SLOTS, alias};

/// Probabilities of the symbols 0, 1, 2 … of one context.
#[derive(Clone)]
pub(crate) struct Model {
    /// Slots of each symbol; their sum is [`SLOTS`]. The last is not 0.
    pub(super) frequencies: Vec<u16>,
    /// Whose the slots are.
    pub(crate) buckets: alias::Buckets,
    /// The slots symbol by symbol, made when the first symbol is encoded.
    slots: OnceLock<Vec<u16>>,
}

impl Model {
    /// The best model for symbols that occur so often; what never occurs cannot be coded. Without any count
    /// all is symbol 0.
    ///
    /// # Panics
    /// With more than [`MAX_SYMBOLS`] counts.
    pub(crate) fn from_counts(counts: &[u32]) -> Self {
        assert!(counts.len() <= MAX_SYMBOLS);
        Self::from_frequencies(normalize(counts)).expect("frequencies add up")
    }

    /// `None` unless the frequencies add up to [`SLOTS`], and the last is not 0.
    pub(super) fn from_frequencies(frequencies: Vec<u16>) -> Option<Self> {
        let sum: usize = frequencies.iter().map(|&frequency| usize::from(frequency)).sum();
        if frequencies.len() > MAX_SYMBOLS || sum != SLOTS || frequencies.last() == Some(&0) {
            return None;
        }
        Some(Self {
            buckets: alias::buckets(&frequencies),
            frequencies,
            slots: OnceLock::new(),
        })
    }

    /// Symbols that can be coded, and those before the last of them.
    pub(crate) fn symbols(&self) -> usize {
        self.frequencies.len()
    }

    /// Bits that a symbol takes; infinite for what the model cannot code.
    pub(crate) fn bits(&self, symbol: usize) -> f32 {
        let frequency = self.frequencies.get(symbol).copied().unwrap_or(0);
        PROBABILITY_BITS as f32 - f32::from(frequency).log2()
    }

    /// The slots of a symbol in the order of their places.
    ///
    /// # Panics
    /// If there is no such symbol.
    pub(super) fn slots(&self, symbol: usize) -> &[u16] {
        let slots = self
            .slots
            .get_or_init(|| alias::slots(&self.buckets, &self.frequencies));
        let length = |frequency: &u16| usize::from(*frequency);
        let start: usize = self.frequencies[..symbol].iter().map(length).sum();
        &slots[start..start + length(&self.frequencies[symbol])]
    }
}

/// Frequencies of the sum [`SLOTS`] that code symbols of such counts shortest, at least 1 for each that occurs.
pub(super) fn normalize(counts: &[u32]) -> Vec<u16> {
    let seen = counts
        .iter()
        .rposition(|&count| count > 0)
        .map_or(0, |last| last + 1);
    if seen == 0 {
        return vec![SLOTS as u16];
    }
    let counts = &counts[..seen];
    let sum: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    let mut frequencies: Vec<u16> = counts
        .iter()
        .map(|&count| match count {
            0 => 0,
            _ => (f64::from(count) * SLOTS as f64 / sum).round().max(1.0) as u16,
        })
        .collect();
    // What rounding left over or took too much goes, slot by slot, where it gains most or costs least.
    let gain = |count: u32, from: u16, to: u16| f64::from(count) * (f64::from(to) / f64::from(from)).ln();
    loop {
        let total: usize = frequencies.iter().map(|&frequency| usize::from(frequency)).sum();
        let grow = total < SLOTS;
        if total == SLOTS {
            return frequencies;
        }
        let step = |frequency: u16| if grow { frequency + 1 } else { frequency - 1 };
        let (best, _) = counts
            .iter()
            .zip(&frequencies)
            .enumerate()
            .filter(|&(_, (&count, &frequency))| count > 0 && (grow || frequency > 1))
            .map(|(symbol, (&count, &frequency))| (symbol, gain(count, frequency, step(frequency))))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .expect("some symbol has slots to spare, since there are fewer symbols than slots");
        frequencies[best] = step(frequencies[best]);
    }
}
