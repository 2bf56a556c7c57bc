//! Bytes to symbols.

use super::{Buckets, LANES, LEAST_STATE, PROBABILITY_BITS, WORD_BITS, alias, stored::read_states};

/// The symbol of a state, and the state behind it; not renormalized.
#[inline(always)]
fn step(state: u32, model: &Buckets) -> (usize, u32) {
    let meaning = alias::meaning(model, state);
    let state = u32::from(meaning.frequency)
        .wrapping_mul(state >> PROBABILITY_BITS)
        .wrapping_add(meaning.place.into());
    (meaning.symbol, state)
}

/// Takes symbols out of the bytes of [`super::Encoder::finish`], in the order in which they were pushed.
#[derive(Clone, Copy)]
pub(crate) struct Decoder<'a> {
    pub(crate) states: [u32; LANES],
    words: &'a [[u8; 2]],
    /// Words taken.
    position: usize,
}

impl<'a> Decoder<'a> {
    /// Starts; the message says why the bytes cannot be a stream.
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, String> {
        let (states, words) = match bytes {
            [] => ([1; LANES], bytes),
            _ => read_states(bytes)?,
        };
        match words.as_chunks::<2>() {
            (words, []) => Ok(Self {
                states,
                words,
                position: 0,
            }),
            _ => Err("half a word follows the entropy coded data".into()),
        }
    }

    /// The next symbol.
    #[inline(always)]
    pub(crate) fn symbol(&mut self, lane: usize, model: &Buckets) -> usize {
        let (symbol, state) = step(self.states[lane & (LANES - 1)], model);
        self.renormalize(lane, state);
        symbol
    }

    /// The next symbol of each lane, as four calls of [`Self::symbol`] would give them.
    #[inline(always)]
    pub(crate) fn symbols(&mut self, models: [&Buckets; LANES]) -> [usize; LANES] {
        let mut symbols = [0; LANES];
        let mut states = self.states;
        for lane in 0..LANES {
            (symbols[lane], states[lane]) = step(states[lane], models[lane]);
        }
        self.renormalize_all(states);
        symbols
    }

    /// The next `count` bits, at most 16.
    #[inline(always)]
    pub(crate) fn bits(&mut self, lane: usize, count: u32) -> u32 {
        debug_assert!(count <= WORD_BITS);
        let state = self.states[lane & (LANES - 1)];
        self.renormalize(lane, state >> count);
        state & ((1 << count) - 1)
    }

    #[inline(always)]
    fn renormalize(&mut self, lane: usize, state: u32) {
        let word = self.words.get(self.position);
        let short = state < LEAST_STATE && word.is_some();
        let word = word.copied().unwrap_or_default();
        let longer = state << WORD_BITS | u32::from(u16::from_le_bytes(word));
        self.states[lane & (LANES - 1)] = if short { longer } else { state };
        self.position += usize::from(short);
    }

    /// Takes a word for each state that is too short, lane by lane, as long as there are words.
    #[inline(always)]
    fn renormalize_all(&mut self, states: [u32; LANES]) {
        let (mut window, left) = self.window();
        let mut taken = 0;
        for (to, state) in self.states.iter_mut().zip(states) {
            let short = state < LEAST_STATE && taken < left;
            let longer = state << WORD_BITS | window as u32 & ((1 << WORD_BITS) - 1);
            *to = if short { longer } else { state };
            window >>= if short { WORD_BITS } else { 0 };
            taken += u32::from(short);
        }
        self.take(taken);
    }

    /// The next words, at most four, the first in the lowest bits, and their number.
    #[inline(always)]
    pub(crate) fn window(&self) -> (u64, u32) {
        match self
            .words
            .get(self.position..)
            .and_then(<[_]>::first_chunk::<LANES>)
        {
            Some(words) => (u64::from_le_bytes(bytemuck::cast(*words)), LANES as u32),
            None => self.last_words(),
        }
    }

    /// The next words where there are fewer than lanes, and their number.
    #[cold]
    fn last_words(&self) -> (u64, u32) {
        let words = self.words.get(self.position..).unwrap_or_default();
        let window = words.iter().rev().fold(0, |window, word| {
            window << WORD_BITS | u64::from(u16::from_le_bytes(*word))
        });
        (window, words.len() as u32)
    }

    /// Goes on by so many words, at most those of the window.
    #[inline(always)]
    pub(crate) fn take(&mut self, words: u32) {
        self.position += words as usize;
    }

    /// Checks that the stream ends here, in states in which an encoder may have begun; the message says what is wrong.
    pub(crate) fn finish(self) -> Result<(), String> {
        if self.position != self.words.len() {
            return Err(format!(
                "{} words of entropy coded data were expected, {} are there",
                self.position,
                self.words.len()
            ));
        }
        if self.states.iter().any(|&state| state > LEAST_STATE) {
            return Err("the entropy coded data does not end where its encoder began".into());
        }
        Ok(())
    }
}
