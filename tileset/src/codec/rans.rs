//! Entropy coder: interleaved range asymmetric numeral systems (rANS) with static models.
//!
//! Four states share one stream of 16-bit words, so a decoder has four independent chains of work. A caller
//! names the state, called lane, of each symbol; natural is one lane for each component of a group. Symbols
//! are decoded in the order in which they were pushed, each with any model that the decoder can know by then,
//! so contexts may depend on everything decoded before. Bits without a model take the same way through
//! [`Encoder::bits`]: there is no second stream and no length to store.
//!
//! Integers only, so the same bytes come and go on every platform. Damaged bytes give wrong symbols of the
//! model's alphabet, never a panic or a read out of bounds. [`Decoder::finish`] tells of most damage, but not
//! of all: a changed sign, say, is another valid stream. Checksums are for the container.
//!
//! Source: Duda, "Asymmetric numeral systems: entropy coding combining speed of Huffman coding with
//! compression rate of arithmetic coding", 2013; Giesen, "Interleaved entropy coders", 2014, for the lanes,
//! the shared stream and the word-wise renormalization (one step always suffices with states of 2¹⁶ to 2³²).

/// Independent states.
pub(crate) const LANES: usize = 4;
/// Probabilities are multiples of 2⁻¹².
const PROBABILITY_BITS: u32 = 12;
/// Slots of a model, shared by its symbols in proportion to their probabilities.
const SLOTS: usize = 1 << PROBABILITY_BITS;
/// Least state between two symbols.
const LEAST_STATE: u32 = 1 << WORD_BITS;
const WORD_BITS: u32 = 16;
/// Most symbols of an alphabet.
pub(crate) const MAX_SYMBOLS: usize = 64;
/// Most models of one set.
pub(crate) const MAX_MODELS: usize = 256;

/// Probabilities of the symbols 0, 1, 2 … of one context.
#[derive(Clone)]
pub(crate) struct Model {
    /// Slots of each symbol; their sum is [`SLOTS`]. The last is not 0.
    frequencies: Vec<u16>,
    /// The symbol of each slot: bytes, since the tables of many models must fit the second-level cache.
    symbols: [u8; SLOTS],
    /// First slot and frequency of each symbol, and of those that do not exist: a byte needs no check.
    intervals: [[u16; 2]; 256],
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
    fn from_frequencies(frequencies: Vec<u16>) -> Option<Self> {
        let sum: usize = frequencies.iter().map(|&frequency| usize::from(frequency)).sum();
        if frequencies.len() > MAX_SYMBOLS || sum != SLOTS || frequencies.last() == Some(&0) {
            return None;
        }
        let mut model = Self {
            frequencies,
            symbols: [0; SLOTS],
            intervals: [[0; 2]; 256],
        };
        let mut start = 0;
        for (symbol, &frequency) in model.frequencies.iter().enumerate() {
            model.intervals[symbol] = [start, frequency];
            model.symbols[usize::from(start)..][..usize::from(frequency)].fill(symbol as u8);
            start += frequency;
        }
        Some(model)
    }

    /// Bits that a symbol takes; infinite for what the model cannot code.
    pub(crate) fn bits(&self, symbol: usize) -> f32 {
        let frequency = self.frequencies.get(symbol).copied().unwrap_or(0);
        PROBABILITY_BITS as f32 - f32::from(frequency).log2()
    }
}

/// Frequencies of the sum [`SLOTS`] that code symbols of such counts shortest, at least 1 for each that occurs.
fn normalize(counts: &[u32]) -> Vec<u16> {
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

/// Appends a set of models: their number, and for each its number of symbols and all frequencies but the
/// last, which follows from the sum. Numbers up to 127 take one byte, others two.
///
/// # Panics
/// With more than [`MAX_MODELS`].
pub(crate) fn write_models(models: &[Model], bytes: &mut Vec<u8>) {
    assert!(models.len() <= MAX_MODELS);
    write_number(models.len() as u16, bytes);
    for model in models {
        write_number(model.frequencies.len() as u16, bytes);
        for &frequency in &model.frequencies[..model.frequencies.len() - 1] {
            write_number(frequency, bytes);
        }
    }
}

/// Takes a set of models off the front of `bytes`; the message says why that fails. At most `limit` models
/// are read.
pub(crate) fn read_models(bytes: &mut &[u8], limit: usize) -> Result<Vec<Model>, String> {
    let count = usize::from(read_number(bytes)?);
    if count > limit.min(MAX_MODELS) {
        return Err(format!(
            "{count} models, at most {} are expected",
            limit.min(MAX_MODELS)
        ));
    }
    (0..count)
        .map(|index| {
            let symbols = usize::from(read_number(bytes)?);
            if !(1..=MAX_SYMBOLS).contains(&symbols) {
                return Err(format!(
                    "model {index} has {symbols} symbols, at most {MAX_SYMBOLS} can be"
                ));
            }
            let mut frequencies = (1..symbols)
                .map(|_| read_number(bytes))
                .collect::<Result<Vec<_>, _>>()?;
            let sum: usize = frequencies.iter().map(|&frequency| usize::from(frequency)).sum();
            frequencies.push(SLOTS.saturating_sub(sum) as u16);
            Model::from_frequencies(frequencies)
                .ok_or_else(|| format!("frequencies of model {index} add up to {sum} before the last one"))
        })
        .collect()
}

fn write_number(number: u16, bytes: &mut Vec<u8>) {
    debug_assert!(number < 1 << 15);
    if number < 128 {
        bytes.push(number as u8);
    } else {
        bytes.extend([128 | (number >> 8) as u8, number as u8]);
    }
}

fn read_number(bytes: &mut &[u8]) -> Result<u16, String> {
    let number = match **bytes {
        [first @ 0..128, ..] => u16::from(first),
        [first, second, ..] => u16::from_be_bytes([first & 127, second]),
        _ => return Err("the models end too early".into()),
    };
    *bytes = &bytes[if number < 128 && bytes[0] < 128 { 1 } else { 2 }..];
    Ok(number)
}

/// One step of the encoder: the interval of slots that a symbol takes, of 2^`scale_bits`.
struct Step {
    start: u16,
    frequency: u16,
    scale_bits: u8,
    lane: u8,
}

/// Collects symbols; coding happens at the end, from the last symbol to the first.
#[derive(Default)]
pub(crate) struct Encoder {
    steps: Vec<Step>,
}

impl Encoder {
    /// Appends a symbol.
    ///
    /// # Panics
    /// If the model cannot code the symbol (it had no count), or there is no such lane.
    pub(crate) fn symbol(&mut self, lane: usize, model: &Model, symbol: usize) {
        let frequency = model.frequencies[symbol];
        assert!(frequency > 0, "symbol {symbol} was never counted");
        assert!(lane < LANES);
        self.steps.push(Step {
            start: model.intervals[symbol][0],
            frequency,
            scale_bits: PROBABILITY_BITS as u8,
            lane: lane as u8,
        });
    }

    /// Appends the lowest `count` bits of `bits`, at most 16; the others must be 0.
    ///
    /// # Panics
    /// If there are more bits, or there is no such lane.
    pub(crate) fn bits(&mut self, lane: usize, bits: u32, count: u32) {
        assert!(lane < LANES && count <= WORD_BITS && bits >> count == 0);
        self.steps.push(Step {
            start: bits as u16,
            frequency: 1,
            scale_bits: count as u8,
            lane: lane as u8,
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
        for step in self.steps.iter().rev() {
            let state = &mut states[usize::from(step.lane)];
            let (start, frequency) = (u32::from(step.start), u32::from(step.frequency));
            let scale_bits = u32::from(step.scale_bits);
            if u64::from(*state) >= u64::from(frequency) << (32 - scale_bits) {
                words.push(*state as u16);
                *state >>= WORD_BITS;
            }
            *state = ((*state / frequency) << scale_bits) + *state % frequency + start;
        }
        let mut bytes: Vec<u8> = states.iter().flat_map(|state| state.to_le_bytes()).collect();
        bytes.extend(words.iter().rev().flat_map(|word| word.to_le_bytes()));
        bytes
    }
}

#[inline(always)]
fn slot_of(state: u32) -> u16 {
    state as u16 & (SLOTS as u16 - 1)
}

/// The state behind a symbol of some frequency, of whose slots it was the `place`-th; not renormalized.
#[inline(always)]
fn advance(state: u32, frequency: u16, place: u16) -> u32 {
    u32::from(frequency)
        .wrapping_mul(state >> PROBABILITY_BITS)
        .wrapping_add(u32::from(place))
}

/// The symbol of a state, and the state behind it; not renormalized.
#[inline(always)]
fn step(state: u32, model: &Model) -> (usize, u32) {
    let slot = slot_of(state);
    let symbol = usize::from(model.symbols[usize::from(slot)]);
    let [start, frequency] = model.intervals[symbol];
    // Never below zero, but the compiler cannot know.
    (symbol, advance(state, frequency, slot.wrapping_sub(start)))
}

/// Takes symbols out of the bytes of [`Encoder::finish`], in the order in which they were pushed.
#[derive(Clone, Copy)]
pub(crate) struct Decoder<'a> {
    states: [u32; LANES],
    words: &'a [[u8; 2]],
    /// Words taken; goes on counting behind the last, where all words are 0.
    position: usize,
}

impl<'a> Decoder<'a> {
    /// Starts; the message says why the bytes cannot be a stream.
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, String> {
        let (states, words) = match bytes.split_at_checked(LANES * 4) {
            Some((states, words)) => (states.as_chunks::<4>().0, words.as_chunks::<2>()),
            None if bytes.is_empty() => (&[][..], (&[][..], &[][..])),
            None => {
                return Err(format!(
                    "{} bytes hold no states of the entropy coder",
                    bytes.len()
                ));
            }
        };
        if !words.1.is_empty() {
            return Err("half a word follows the entropy coded data".into());
        }
        Ok(Self {
            states: std::array::from_fn(|lane| {
                states
                    .get(lane)
                    .map_or(LEAST_STATE, |state| u32::from_le_bytes(*state))
            }),
            words: words.0,
            position: 0,
        })
    }

    /// The next symbol.
    #[inline(always)]
    pub(crate) fn symbol(&mut self, lane: usize, model: &Model) -> usize {
        let (symbol, state) = step(self.states[lane & (LANES - 1)], model);
        self.renormalize(lane, state);
        symbol
    }

    /// The next symbol of each lane, as four calls of [`Self::symbol`] would give them.
    #[inline(always)]
    pub(crate) fn symbols(&mut self, models: [&Model; LANES]) -> [usize; LANES] {
        let mut symbols = [0; LANES];
        let mut states = self.states;
        for lane in 0..LANES {
            (symbols[lane], states[lane]) = step(states[lane], models[lane]);
        }
        self.renormalize_all(states);
        symbols
    }

    /// Takes the next symbol of each lane if all are 0; otherwise nothing happens. Where that is likely it is faster
    /// than [`Self::symbols`].
    #[inline(always)]
    pub(crate) fn zeros(&mut self, models: [&Model; LANES]) -> bool {
        let mut states = self.states;
        let mut all = true;
        for lane in 0..LANES {
            let (slot, frequency) = (slot_of(states[lane]), models[lane].intervals[0][1]);
            all &= slot < frequency;
            states[lane] = advance(states[lane], frequency, slot);
        }
        if all {
            self.renormalize_all(states);
        }
        all
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
        let short = state < LEAST_STATE;
        let word = self.words.get(self.position).copied().unwrap_or_default();
        let longer = state << WORD_BITS | u32::from(u16::from_le_bytes(word));
        self.states[lane & (LANES - 1)] = if short { longer } else { state };
        self.position = self.position.wrapping_add(usize::from(short));
    }

    /// Takes a word for each state that is too short, lane by lane.
    #[inline(always)]
    fn renormalize_all(&mut self, states: [u32; LANES]) {
        let padded;
        let window = match self.words.get(self.position..).and_then(<[_]>::first_chunk) {
            Some(window) => window,
            None => {
                padded = self.last_words();
                &padded
            }
        };
        let mut taken = 0;
        for (to, state) in self.states.iter_mut().zip(states) {
            let short = state < LEAST_STATE;
            // As many are taken before as there are lanes before; the bound spares the check.
            let longer = state << WORD_BITS | u32::from(u16::from_le_bytes(window[taken % LANES]));
            *to = if short { longer } else { state };
            taken += usize::from(short);
        }
        self.position = self.position.wrapping_add(taken);
    }

    /// The next words where there may be fewer than lanes.
    #[cold]
    fn last_words(&self) -> [[u8; 2]; LANES] {
        std::array::from_fn(|i| {
            let place = self.position.wrapping_add(i);
            self.words.get(place).copied().unwrap_or_default()
        })
    }

    /// Checks that the stream ends here, in the state where the encoder began; the message says what is wrong.
    pub(crate) fn finish(self) -> Result<(), String> {
        if self.position != self.words.len() {
            return Err(format!(
                "{} words of entropy coded data were expected, {} are there",
                self.position,
                self.words.len()
            ));
        }
        if self.states != [LEAST_STATE; LANES] {
            return Err("the entropy coded data does not end where its encoder began".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What is pushed: lane, and a model and its symbol, or bits and their number.
    #[derive(Clone, Copy, Debug)]
    enum Item {
        Symbol(usize, usize, usize),
        Bits(usize, u32, u32),
    }

    fn encode(models: &[Model], items: &[Item]) -> Vec<u8> {
        let mut encoder = Encoder::default();
        for &item in items {
            match item {
                Item::Symbol(lane, model, symbol) => encoder.symbol(lane, &models[model], symbol),
                Item::Bits(lane, bits, count) => encoder.bits(lane, bits, count),
            }
        }
        encoder.finish()
    }

    /// Whether all items come back, and the stream is whole.
    fn decodes(models: &[Model], items: &[Item], bytes: &[u8]) -> bool {
        let Ok(mut decoder) = Decoder::new(bytes) else {
            return false;
        };
        let same = items.iter().fold(true, |same, &item| {
            same & match item {
                Item::Symbol(lane, model, symbol) => decoder.symbol(lane, &models[model]) == symbol,
                Item::Bits(lane, bits, count) => decoder.bits(lane, count) == bits,
            }
        });
        same & decoder.finish().is_ok()
    }

    fn models() -> Vec<Model> {
        let geometric: Vec<u32> = (0..30).map(|i| 1 << (29 - i)).collect();
        vec![
            Model::from_counts(&[1; 64]),
            Model::from_counts(&geometric),
            Model::from_counts(&[]),
            Model::from_counts(&[0, 0, u32::MAX, 0, 1, 0]),
        ]
    }

    fn item() -> impl Strategy<Value = Item> {
        prop_oneof![
            (0usize..4, 0usize..64).prop_map(|(lane, symbol)| Item::Symbol(lane, 0, symbol)),
            (0usize..4, 0usize..30).prop_map(|(lane, symbol)| Item::Symbol(lane, 1, symbol)),
            (0usize..4).prop_map(|lane| Item::Symbol(lane, 2, 0)),
            (0usize..4, 1usize..=2).prop_map(|(lane, half)| Item::Symbol(lane, 3, 2 * half)),
            (0usize..4, 0u32..=16, any::<u32>()).prop_map(|(lane, count, bits)| Item::Bits(
                lane,
                bits & ((1 << count) - 1),
                count
            )),
        ]
    }

    proptest! {
        #[test]
        fn symbols_and_bits_round_trip(items in prop::collection::vec(item(), 0..400)) {
            let models = models();
            let bytes = encode(&models, &items);
            prop_assert!(decodes(&models, &items, &bytes));
            if !bytes.is_empty() {
                prop_assert!(!decodes(&models, &items, &bytes[..bytes.len() - 2]));
                prop_assert!(!decodes(&models, &items, &[&bytes[..], &[0; 2]].concat()));
            }
        }

        #[test]
        fn noise_decodes_to_symbols_of_the_alphabet(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            let models = models();
            if let Ok(mut decoder) = Decoder::new(&bytes) {
                for i in 0..1000 {
                    prop_assert!(decoder.symbol(i, &models[1]) < 30);
                    prop_assert!(decoder.bits(i, 3) < 8);
                    prop_assert!([2, 4].contains(&decoder.symbol(i, &models[3])));
                }
            }
        }

        #[test]
        fn models_keep_what_occurs_and_come_back(counts in prop::collection::vec(
            prop_oneof![Just(0), 1u32..10, any::<u32>()], 0..=64,
        )) {
            let model = Model::from_counts(&counts);
            for (symbol, &count) in counts.iter().enumerate() {
                prop_assert_eq!(model.bits(symbol).is_finite(), count > 0 || counts.iter().all(|&c| c == 0) && symbol == 0);
            }
            let mut bytes = Vec::new();
            write_models(&[model.clone(), model.clone()], &mut bytes);
            bytes.push(9);
            let mut rest = &bytes[..];
            let read = read_models(&mut rest, 2).unwrap();
            prop_assert_eq!(rest, [9]);
            prop_assert!(read.iter().all(|read| read.frequencies == model.frequencies));
            prop_assert!(read_models(&mut &bytes[..], 1).is_err());
            for length in 0..bytes.len() - 1 {
                prop_assert!(read_models(&mut &bytes[..length], 2).is_err());
            }
        }

        #[test]
        fn noise_is_no_panic_for_models(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = read_models(&mut &bytes[..], MAX_MODELS);
        }
    }

    #[test]
    fn length_is_close_to_the_entropy() {
        let counts = [9000, 500, 300, 150, 40, 9, 1];
        let sum: u32 = counts.iter().sum();
        let model = Model::from_counts(&counts);
        // Each symbol as often as it was counted, in an order that mixes them.
        let mut symbols: Vec<usize> = (0..).zip(counts).flat_map(|(s, n)| vec![s; n as usize]).collect();
        symbols.sort_by_key(|&symbol| (symbol as u32).wrapping_mul(2_654_435_761) >> 7);
        let items: Vec<Item> = (0..)
            .zip(&symbols)
            .map(|(i, &s): (usize, _)| Item::Symbol(i % 4, 0, s))
            .collect();
        let entropy: f64 = counts
            .iter()
            .map(|&count| f64::from(count) * (f64::from(sum) / f64::from(count)).log2())
            .sum();
        let bytes = encode(&[model], &items).len() as f64;
        assert!(
            bytes < entropy / 8.0 * 1.003 + 16.0,
            "{bytes} bytes for {entropy} bits"
        );
        assert!(bytes > entropy / 8.0);
    }

    #[test]
    fn normalization_is_the_best_there_is() {
        // Against all frequencies of three symbols.
        for counts in [[1000, 10, 1], [5, 5, 5], [70_000, 69_999, 2], [1, 1, 1_000_000]] {
            let length = |frequencies: &[u16]| -> f64 {
                (0..3)
                    .map(|i| f64::from(counts[i]) * -f64::from(frequencies[i]).log2())
                    .sum()
            };
            let best = (1..4095u16)
                .flat_map(|a| (1..4096 - a).map(move |b| [a, b, 4096 - a - b]))
                .map(|frequencies| length(&frequencies))
                .fold(f64::INFINITY, f64::min);
            assert!(length(&normalize(&counts)) <= best + 1e-6 * best.abs());
        }
    }

    #[test]
    fn any_flipped_bit_is_found() {
        let models = models();
        let items: Vec<Item> = (0..200).map(|i| Item::Symbol(i % 4, 1, i * i % 5)).collect();
        let bytes = encode(&models, &items);
        for bit in 0..bytes.len() * 8 {
            let mut bad = bytes.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(!decodes(&models, &items, &bad), "bit {bit}");
        }
    }
}
