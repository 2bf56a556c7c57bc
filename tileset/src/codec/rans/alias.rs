//! Which symbol a slot belongs to, by the alias method.
//!
//! Slots lie in buckets, one for each symbol of the largest alphabet. The first slots of a bucket are its symbol's, up
//! to a cutoff; the rest belongs to one other symbol. Integers only, and in a fixed order: it is the same everywhere.

use super::{MAX_SYMBOLS, SLOTS};

/// Slots of a bucket.
const BUCKET: usize = SLOTS / MAX_SYMBOLS;

/// A bucket: what its slots stand for.
///
/// As a little-endian number of 64 bits, from the lowest: cutoff, other symbol, own frequency; other frequency, offset.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Bucket {
    /// Slots that belong to the symbol of this number.
    cutoff: u8,
    /// The symbol of the others.
    other: u8,
    /// Frequency of the symbol of this number.
    own_frequency: u16,
    /// Frequency of the other symbol.
    other_frequency: u16,
    /// What turns a position in this bucket into a place among the slots of the other symbol; wraps.
    other_offset: u16,
}

impl Bucket {
    /// The bits of the cutoff.
    #[cfg(target_arch = "x86_64")]
    pub(crate) const CUTOFF_MASK: i32 = 0xff;
}

/// All buckets of a model.
pub(crate) type Buckets = [Bucket; MAX_SYMBOLS];

/// What a slot stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Meaning {
    pub(super) symbol: usize,
    /// Slots of the symbol, and which of them this is.
    pub(super) frequency: u16,
    pub(super) place: u16,
}

/// What a slot, of which only the lowest bits count, stands for.
#[inline(always)]
pub(super) fn meaning(buckets: &Buckets, slot: u32) -> Meaning {
    let number = slot as usize / BUCKET % MAX_SYMBOLS;
    let position = slot as u16 % BUCKET as u16;
    let bucket = buckets[number];
    let own = position < u16::from(bucket.cutoff);
    // Which of both it is cannot be foreseen: a branch would be wrong too often.
    let select = |own_value: u32, other: u32| std::hint::select_unpredictable(own, own_value, other);
    Meaning {
        symbol: select(number as u32, bucket.other.into()) as usize,
        frequency: select(bucket.own_frequency.into(), bucket.other_frequency.into()) as u16,
        place: (select(0, bucket.other_offset.into()) as u16).wrapping_add(position),
    }
}

/// Distributes the slots; `frequencies`, at most [`MAX_SYMBOLS`], add up to [`SLOTS`].
pub(super) fn buckets(frequencies: &[u16]) -> Buckets {
    let mut buckets = [Bucket::default(); MAX_SYMBOLS];
    // Slots of each symbol that no other bucket has taken yet.
    let mut left = [0u16; MAX_SYMBOLS];
    left[..frequencies.len()].copy_from_slice(frequencies);
    let full = BUCKET as u16;
    let (mut under, mut over): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    for (symbol, &left) in left.iter().enumerate() {
        match left.cmp(&full) {
            std::cmp::Ordering::Less => under.push(symbol),
            std::cmp::Ordering::Equal => {}
            std::cmp::Ordering::Greater => over.push(symbol),
        }
    }
    // The last slots of a symbol that has too many fill up the bucket of one that has too few. As they add up there is
    // always one of both, or none.
    while let (Some(&from), Some(to)) = (over.last(), under.pop()) {
        left[from] -= full - left[to];
        buckets[to].other = from as u8;
        buckets[to].other_offset = left[from].wrapping_sub(left[to]);
        if left[from] <= full {
            over.pop();
            if left[from] < full {
                under.push(from);
            }
        }
    }
    for (bucket, left) in buckets.iter_mut().zip(left) {
        bucket.cutoff = left as u8;
    }
    let frequency = |symbol: usize| frequencies.get(symbol).copied().unwrap_or(0);
    for (symbol, bucket) in buckets.iter_mut().enumerate() {
        bucket.own_frequency = frequency(symbol);
        bucket.other_frequency = frequency(bucket.other.into());
    }
    buckets
}

/// The slots of all symbols, one symbol after the other, each in the order of their places.
pub(super) fn slots(buckets: &Buckets, frequencies: &[u16]) -> Vec<u16> {
    let mut starts = [0; MAX_SYMBOLS];
    let mut start = 0;
    for (at, &frequency) in starts.iter_mut().zip(frequencies) {
        *at = start;
        start += usize::from(frequency);
    }
    let mut slots = vec![0; SLOTS];
    for slot in 0..SLOTS as u16 {
        let meaning = meaning(buckets, slot.into());
        slots[starts[meaning.symbol] + usize::from(meaning.place)] = slot;
    }
    slots
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::rans::Model;

    proptest::proptest! {
        /// Each place of each symbol has one slot.
        #[test]
        fn slots_are_shared_by_frequency(counts in proptest::collection::vec(
            proptest::prop_oneof![proptest::prelude::Just(0), 1u32..10, proptest::prelude::any::<u32>()], 0..=64,
        )) {
            let model = Model::from_counts(&counts);
            let mut seen: Vec<Vec<bool>> =
                model.frequencies.iter().map(|&frequency| vec![false; usize::from(frequency)]).collect();
            for slot in 0..SLOTS as u32 {
                let Meaning { symbol, frequency, place } = meaning(&model.buckets, slot);
                proptest::prop_assert_eq!(frequency, model.frequencies[symbol]);
                let seen = &mut seen[symbol][usize::from(place)];
                proptest::prop_assert!(!*seen);
                *seen = true;
                proptest::prop_assert_eq!(u32::from(model.slots(symbol)[usize::from(place)]), slot);
                // Only the lowest bits count.
                proptest::prop_assert_eq!(
                    meaning(&model.buckets, slot | 0xabcd << 12),
                    meaning(&model.buckets, slot)
                );
            }
        }
    }
}
