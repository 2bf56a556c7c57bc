//! Models as bytes.

use super::{MAX_MODELS, MAX_SYMBOLS, Model, SLOTS};

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
