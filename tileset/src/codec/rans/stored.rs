//! Models and states as bytes.

use super::{LANES, MAX_MODELS, MAX_SYMBOLS, Model, SLOTS};

/// Bits that tell how many bits of a state follow its highest.
const LENGTH_BITS: u32 = 5;
/// Most bytes of all states.
const MAX_STATES_BYTES: usize = (LANES as u32 * (LENGTH_BITS + u32::BITS - 1)).div_ceil(8) as usize;

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

/// Appends the states that a decoder starts with, none of which is 0: of each the number of bits below its highest,
/// then these bits of each, from the lowest bit of the first byte on; zeros fill the last byte.
pub(super) fn write_states(states: [u32; LANES], bytes: &mut Vec<u8>) {
    let (mut bits, mut count) = (0u64, 0);
    let mut push = |value: u32, length: u32| {
        bits |= u64::from(value) << count;
        count += length;
        while count >= 8 {
            bytes.push(bits as u8);
            (bits, count) = (bits >> 8, count - 8);
        }
    };
    let lengths = states.map(u32::ilog2);
    lengths.iter().for_each(|&length| push(length, LENGTH_BITS));
    for (state, length) in states.into_iter().zip(lengths) {
        push(state ^ 1 << length, length);
    }
    push(0, 7); // the rest of a byte, if there is one
}

/// The states at the front of `bytes`, and what follows them; the message says why there are none.
pub(super) fn read_states(bytes: &[u8]) -> Result<([u32; LANES], &[u8]), String> {
    let mut padded = [0; MAX_STATES_BYTES + 8];
    let known = bytes.len().min(MAX_STATES_BYTES);
    padded[..known].copy_from_slice(&bytes[..known]);
    let mut at = 0;
    let mut take = |length: u32| {
        let window = std::array::from_fn(|i| padded[at as usize / 8 + i]);
        let value = u64::from_le_bytes(window) >> (at % 8) & ((1 << length) - 1);
        at += length;
        value as u32
    };
    let lengths = [(); LANES].map(|()| take(LENGTH_BITS));
    let states = lengths.map(|length| 1 << length | take(length));
    let count = LANES as u32 * LENGTH_BITS + lengths.iter().sum::<u32>();
    let empty = take(count.next_multiple_of(8) - count) == 0;
    match bytes.split_at_checked(count.div_ceil(8) as usize) {
        Some((_, words)) if empty => Ok((states, words)),
        _ => Err(format!(
            "{} bytes hold no states of the entropy coder",
            bytes.len()
        )),
    }
}
