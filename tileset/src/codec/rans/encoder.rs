//! Symbols to bytes.

use super::{LANES, LEAST_STATE, Model, PROBABILITY_BITS, WORD_BITS};

/// One step of the encoder.
enum Step<'a> {
    /// The slots of a symbol.
    Symbol { lane: u8, slots: &'a [u16] },
    /// Bits without a model, and their number.
    Bits { lane: u8, bits: u16, count: u8 },
}

/// Collects symbols; coding happens at the end, from the last symbol to the first.
#[derive(Default)]
pub(crate) struct Encoder<'a> {
    steps: Vec<Step<'a>>,
}

impl<'a> Encoder<'a> {
    /// Appends a symbol.
    ///
    /// # Panics
    /// If the model cannot code the symbol (it had no count), or there is no such lane.
    pub(crate) fn symbol(&mut self, lane: usize, model: &'a Model, symbol: usize) {
        let slots = model.slots(symbol);
        assert!(!slots.is_empty(), "symbol {symbol} was never counted");
        assert!(lane < LANES);
        let lane = lane as u8;
        self.steps.push(Step::Symbol { lane, slots });
    }

    /// Appends the lowest `count` bits of `bits`, at most 16; the others must be 0.
    ///
    /// # Panics
    /// If there are more bits, or there is no such lane.
    pub(crate) fn bits(&mut self, lane: usize, bits: u32, count: u32) {
        assert!(lane < LANES && count <= WORD_BITS && bits >> count == 0);
        self.steps.push(Step::Bits {
            lane: lane as u8,
            bits: bits as u16,
            count: count as u8,
        });
    }

    /// The bytes: the four states that a decoder starts with, then words, all little-endian. Nothing pushed
    /// gives no bytes.
    pub(crate) fn finish(self) -> Vec<u8> {
        if self.steps.is_empty() {
            return Vec::new();
        }
        let mut states = [LEAST_STATE; LANES];
        let mut words = Vec::with_capacity(self.steps.len() / 4);
        // Makes room for a symbol that takes `frequency` of 2^`scale_bits` slots.
        let mut shorten = |state: &mut u32, frequency: u32, scale_bits: u32| {
            if u64::from(*state) >= u64::from(frequency) << (32 - scale_bits) {
                words.push(*state as u16);
                *state >>= WORD_BITS;
            }
        };
        for step in self.steps.iter().rev() {
            match *step {
                Step::Symbol { lane, slots } => {
                    let state = &mut states[usize::from(lane)];
                    let frequency = slots.len() as u32;
                    shorten(state, frequency, PROBABILITY_BITS);
                    let slot = slots[(*state % frequency) as usize];
                    *state = ((*state / frequency) << PROBABILITY_BITS) + u32::from(slot);
                }
                Step::Bits { lane, bits, count } => {
                    let state = &mut states[usize::from(lane)];
                    shorten(state, 1, count.into());
                    *state = (*state << count) + u32::from(bits);
                }
            }
        }
        let mut bytes: Vec<u8> = states.iter().flat_map(|state| state.to_le_bytes()).collect();
        bytes.extend(words.iter().rev().flat_map(|word| word.to_le_bytes()));
        bytes
    }
}
