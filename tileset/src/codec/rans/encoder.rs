//! Symbols to bytes.

use super::{LANES, LEAST_STATE, Model, PROBABILITY_BITS, WORD_BITS, stored::write_states};

/// One step of the encoder.
enum Step<'a> {
    /// The slots of a symbol.
    Symbol { lane: u8, slots: &'a [u16] },
    /// Bits without a model, and their number.
    Bits { lane: u8, bits: u16, count: u8 },
}

impl Step<'_> {
    fn lane(&self) -> usize {
        match *self {
            Step::Symbol { lane, .. } | Step::Bits { lane, .. } => lane.into(),
        }
    }

    /// Whether a state must lose a word first.
    fn overflows(&self, state: u32) -> bool {
        let limit = match *self {
            Step::Symbol { slots, .. } => (slots.len() as u64) << (32 - PROBABILITY_BITS),
            Step::Bits { count, .. } => 1 << (32 - count),
        };
        u64::from(state) >= limit
    }

    /// The state from which a decoder takes this step to `state`.
    fn code(&self, state: u32) -> u32 {
        match *self {
            Step::Symbol { slots, .. } => {
                let frequency = slots.len() as u32;
                let slot = slots[(state % frequency) as usize];
                ((state / frequency) << PROBABILITY_BITS) + u32::from(slot)
            }
            Step::Bits { bits, count, .. } => (state << count) + u32::from(bits),
        }
    }
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

    /// The bytes: the four states that a decoder starts with, then words. Nothing pushed gives no bytes.
    ///
    /// States begin as small as they can, so that they hold nothing but symbols. A decoder takes words for states below
    /// [`LEAST_STATE`] as long as there are any; so when the first word leaves one lane, the others must have grown to
    /// [`LEAST_STATE`], and begin as large as that needs.
    pub(crate) fn finish(self) -> Vec<u8> {
        if self.steps.is_empty() {
            return Vec::new();
        }
        let (states, words) = match self.code(self.first_states()) {
            // A state of zero has no highest bit; larger ones do not come down to it.
            (states, _) if states.contains(&0) => self.code([LEAST_STATE; LANES]),
            coded => coded,
        };
        let mut bytes = Vec::with_capacity(2 * words.len() + 18);
        write_states(states, &mut bytes);
        bytes.extend(words.iter().rev().flat_map(|word| word.to_le_bytes()));
        bytes
    }

    /// Codes all steps, from the last to the first.
    fn code(&self, mut states: [u32; LANES]) -> ([u32; LANES], Vec<u16>) {
        let mut words = Vec::with_capacity(self.steps.len() / 4);
        for step in self.steps.iter().rev() {
            let state = &mut states[step.lane()];
            if step.overflows(*state) {
                words.push(*state as u16);
                *state >>= WORD_BITS;
            }
            *state = step.code(*state);
        }
        (states, words)
    }

    /// The states to begin with.
    fn first_states(&self) -> [u32; LANES] {
        let mut states = [1; LANES];
        loop {
            // Where the first word leaves.
            let mut now = states;
            let first = self.steps.iter().rposition(|step| {
                let state = &mut now[step.lane()];
                let overflows = step.overflows(*state);
                if !overflows {
                    *state = step.code(*state);
                }
                overflows
            });
            let Some(first) = first else {
                return states;
            };
            let before = states;
            for lane in 0..LANES {
                let (to_come, done) = self.steps.split_at(first + 1);
                let has_more = to_come.iter().any(|step| step.lane() == lane);
                if now[lane] >= LEAST_STATE || !has_more {
                    continue;
                }
                // Larger first states grow larger, but for a few. The upper end is always large enough.
                let grows = |state: u32| {
                    let steps = done.iter().rev().filter(|step| step.lane() == lane);
                    let grown = steps.fold(u64::from(state), |state, step| match u32::try_from(state) {
                        Ok(state) if !step.overflows(state) => step.code(state).into(),
                        _ => u64::MAX,
                    });
                    grown >= LEAST_STATE.into()
                };
                let (mut low, mut high) = (states[lane], LEAST_STATE);
                while high - low > 1 {
                    let middle = low.midpoint(high);
                    if grows(middle) {
                        high = middle;
                    } else {
                        low = middle;
                    }
                }
                states[lane] = high;
            }
            if states == before {
                return states;
            }
        }
    }
}
