//! Magnitudes and signs as symbols and plain bits.
//!
//! Magnitudes up to 11 are symbols of their own; beyond, a symbol gives the number of further bits (Exp-Golomb).

use super::context::{self, CLASSES, Profile};
use crate::codec::rans::{Buckets, Decoder, Encoder, Model};

/// Symbols that are the magnitude itself.
const DIRECT: u32 = 12;
/// Symbols of an alphabet: direct ones, and one for each number of further bits.
pub(super) const SYMBOLS: usize = DIRECT as usize + crate::codec::symbols::MAX_LEVEL.ilog2() as usize + 1;
/// Most bits that the coder takes at once.
const CHUNK_BITS: u32 = 16;

/// How often each symbol occurs in each class.
pub(super) type Counts = [[u32; SYMBOLS]; CLASSES];

/// The symbol of a magnitude, and how many bits follow.
#[inline(always)]
pub(super) fn symbol(magnitude: u32) -> (usize, u32) {
    if magnitude < DIRECT {
        (magnitude as usize, 0)
    } else {
        let bits = (magnitude - DIRECT + 1).ilog2();
        ((DIRECT + bits) as usize, bits)
    }
}

/// The models by class; classes that are alike, or rare, share one.
#[derive(Clone)]
pub(super) struct Models {
    pub models: Vec<Model>,
    /// Model of each class.
    pub of_class: [u8; CLASSES],
}

impl Models {
    /// Merges classes with their neighbours as long as that saves bytes.
    pub(super) fn train(counts: &Counts) -> Self {
        let mut merged: Vec<[u32; SYMBOLS]> = Vec::new();
        let mut of_class = [0; CLASSES];
        for (class, counts) in counts.iter().enumerate() {
            let alone = code_bits(counts);
            let together = merged.last().map(|last| {
                let sum = std::array::from_fn(|symbol| last[symbol].saturating_add(counts[symbol]));
                (sum, code_bits(&sum) <= alone + code_bits(last))
            });
            match (together, merged.last_mut()) {
                (Some((sum, true)), Some(last)) => *last = sum,
                _ => merged.push(*counts),
            }
            of_class[class] = (merged.len() - 1) as u8;
        }
        Self {
            models: merged.iter().map(|counts| Model::from_counts(counts)).collect(),
            of_class,
        }
    }
}

/// Bits for all symbols of a model, and for the model itself.
fn code_bits(counts: &[u32; SYMBOLS]) -> f64 {
    const MODEL_BITS: f64 = 10.0;
    let sum: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    let seen = counts.iter().filter(|&&count| count > 0);
    seen.map(|&count| MODEL_BITS + f64::from(count) * (sum / f64::from(count)).log2())
        .sum()
}

/// Codes the levels `[place][component]` of one group.
pub(super) fn encode(
    profile: &Profile,
    component_levels: [i8; 4],
    models: &Models,
    levels: &[[i32; 4]],
) -> Vec<u8> {
    let mut encoder = Encoder::default();
    context::walk(profile, component_levels, |place, c, class| {
        let level = levels[place][c];
        let magnitude = level.unsigned_abs();
        let (symbol, bits) = symbol(magnitude);
        encoder.symbol(c, &models.models[usize::from(models.of_class[class])], symbol);
        let rest = if bits > 0 {
            magnitude - DIRECT + 1 - (1 << bits)
        } else {
            0
        };
        if bits > CHUNK_BITS {
            encoder.bits(c, rest >> CHUNK_BITS, bits - CHUNK_BITS);
            encoder.bits(c, rest & ((1 << CHUNK_BITS) - 1), CHUNK_BITS);
        } else if bits > 0 {
            encoder.bits(c, rest, bits);
        }
        if magnitude > 0 {
            encoder.bits(c, u32::from(level < 0), 1);
        }
        magnitude
    });
    encoder.finish()
}

/// Decodes the levels of a group and gives each that is not zero to `take(place, component, magnitude,
/// negative)`; the message says why the bytes are no levels.
pub(super) fn decode(
    profile: &Profile,
    component_levels: [i8; 4],
    models: &Models,
    bytes: &[u8],
    mut take: impl FnMut(usize, usize, u32, bool),
) -> Result<(), String> {
    let mut decoder = Decoder::new(bytes)?;
    let by_class: [&Buckets; CLASSES] =
        std::array::from_fn(|class| &models.models[usize::from(models.of_class[class])].buckets);
    context::walk(profile, component_levels, |place, c, class| {
        let symbol = decoder.symbol(c, by_class[class]) as u32;
        if symbol == 0 {
            return 0;
        }
        let magnitude = if symbol < DIRECT {
            symbol
        } else {
            large(&mut decoder, c, symbol - DIRECT)
        };
        let negative = decoder.bits(c, 1) == 1;
        take(place, c, magnitude, negative);
        magnitude
    });
    decoder.finish()
}

#[cold]
fn large(decoder: &mut Decoder, c: usize, bits: u32) -> u32 {
    let bits = bits.min(SYMBOLS as u32 - 1 - DIRECT);
    let mut rest = 0;
    if bits > CHUNK_BITS {
        rest = decoder.bits(c, bits - CHUNK_BITS) << CHUNK_BITS;
    }
    rest |= decoder.bits(c, bits.min(CHUNK_BITS));
    DIRECT - 1 + (1 << bits) + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::symbols::MAX_LEVEL;

    #[test]
    fn levels_of_all_sizes_round_trip() {
        let profile = Profile {
            views: vec![0; 5],
            lights: vec![0; 7],
            colours: [0; 3],
        };
        let sizes = [
            0,
            1,
            11,
            12,
            13,
            27,
            28,
            65_535,
            65_536,
            1 << 20,
            MAX_LEVEL as u32,
        ];
        let mut levels = vec![[0i32; 4]; 105];
        for (i, level) in levels.as_flattened_mut().iter_mut().enumerate() {
            let size = sizes[i * 7 % sizes.len()] as i32;
            *level = if i % 3 == 0 { -size } else { size };
        }
        let mut counts = [[0; SYMBOLS]; CLASSES];
        context::walk(&profile, [0; 4], |place, c, class| {
            let magnitude = levels[place][c].unsigned_abs();
            counts[class][symbol(magnitude).0] += 1;
            magnitude
        });
        let models = Models::train(&counts);
        let bytes = encode(&profile, [0; 4], &models, &levels);
        let mut back = vec![[0i32; 4]; 105];
        decode(
            &profile,
            [0; 4],
            &models,
            &bytes,
            |place, c, magnitude, negative| {
                back[place][c] = if negative {
                    -(magnitude as i32)
                } else {
                    magnitude as i32
                };
            },
        )
        .unwrap();
        assert_eq!(back, levels);
    }

    #[test]
    fn classes_that_are_alike_share_a_model() {
        let mut counts = [[0; SYMBOLS]; CLASSES];
        counts[3][..2].copy_from_slice(&[1000, 100]);
        counts[4][..2].copy_from_slice(&[900, 90]);
        counts[9][..2].copy_from_slice(&[10, 1000]);
        let models = Models::train(&counts);
        assert_eq!(models.models.len(), 2);
        assert_eq!(models.of_class[3..=4], [0, 0]);
        assert_eq!(models.of_class[9], 1);
    }
}
