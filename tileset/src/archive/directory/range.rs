//! An adaptive binary range coder: bits of known odds take what they are worth, not a whole bit.
//!
//! The coder itself is that of LZMA: 32 bits of range, a byte at a time, carries run back through what is held. The
//! odds learn as counts do at first, and then by a fixed share, so that short sequences pay little for learning.

/// The odds of a bit, learnt from the bits before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Odds {
    /// Probability of a 1, in 65,536ths.
    one: u16,
    /// Bits seen, up to [`MEMORY`].
    seen: u8,
}

/// After so many bits the odds no longer become slower.
const MEMORY: u8 = 40;
/// How far the odds stay from certainty, in 65,536ths.
const DOUBT: i32 = 32;

impl Odds {
    pub(super) const EVEN: Self = Odds {
        one: 1 << 15,
        seen: 0,
    };

    fn learn(&mut self, bit: bool) {
        let target = if bit { 65_536 - DOUBT } else { DOUBT };
        let one = i32::from(self.one);
        self.one = (one + 2 * (target - one) / (2 * i32::from(self.seen) + 3)) as u16;
        self.seen = (self.seen + 1).min(MEMORY);
    }
}

/// Either end of a sequence of bits, so that what is written and what is read go through the same code: a writer takes
/// each bit and gives it back, a reader ignores what it is given and gives the bit that was written.
pub(super) trait Coder {
    /// A bit with odds.
    fn bit(&mut self, odds: &mut Odds, bit: bool) -> bool;

    /// The `count` lower bits of a value, at most 32, the highest first, all with even odds.
    fn plain(&mut self, value: u32, count: u32) -> u32;
}

/// Ranges stay at least this large.
const SMALLEST: u32 = 1 << 24;
/// Bytes that a reader is ahead of what it needs. Behind the last byte they are zeros.
const AHEAD: usize = 3;

/// Writes.
#[derive(Debug)]
pub(super) struct Encoder {
    bytes: Vec<u8>,
    /// Lower end of the range; bit 32 is a carry into what is held.
    low: u64,
    range: u32,
    /// The last byte that a carry may still change, and how many bytes of 255 follow it.
    held: Option<u8>,
    full: usize,
}

impl Encoder {
    pub(super) fn new() -> Self {
        Self {
            bytes: Vec::new(),
            low: 0,
            range: u32::MAX,
            held: None,
            full: 0,
        }
    }

    /// All bytes. Of all numbers in the last range that one is taken whose lower three bytes are zeros; these are left out.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.low = (self.low + u64::from(SMALLEST) - 1) & !(u64::from(SMALLEST) - 1);
        self.shift();
        self.release(0);
        self.bytes
    }

    /// Takes the highest byte off `low`.
    fn shift(&mut self) {
        let (carry, top) = ((self.low >> 32) as u8, (self.low >> 24) as u8);
        if carry == 0 && top == 255 && self.held.is_some() {
            self.full += 1;
        } else {
            self.release(carry);
            self.held = Some(top);
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    /// Writes what is held, with the carry.
    fn release(&mut self, carry: u8) {
        if let Some(held) = self.held {
            self.bytes.push(held.wrapping_add(carry));
            self.bytes
                .extend(std::iter::repeat_n(255u8.wrapping_add(carry), self.full));
            self.full = 0;
        }
    }

    fn normalize(&mut self) {
        while self.range < SMALLEST {
            self.shift();
            self.range <<= 8;
        }
    }
}

impl Coder for Encoder {
    fn bit(&mut self, odds: &mut Odds, bit: bool) -> bool {
        let part = (self.range >> 16) * u32::from(odds.one);
        if bit {
            self.range = part;
        } else {
            self.low += u64::from(part);
            self.range -= part;
        }
        odds.learn(bit);
        self.normalize();
        bit
    }

    fn plain(&mut self, value: u32, count: u32) -> u32 {
        for place in (0..count).rev() {
            self.range >>= 1;
            self.low += u64::from(value >> place & 1) * u64::from(self.range);
            self.normalize();
        }
        value
    }
}

/// Reads. Behind the last byte it reads zeros; whether it had to is told by [`Decoder::left`].
#[derive(Debug)]
pub(super) struct Decoder<'a> {
    bytes: &'a [u8],
    /// Place of the next byte; may lie behind the end.
    next: usize,
    /// Where in the range the written number lies.
    code: u32,
    range: u32,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self {
            bytes,
            next: 0,
            code: 0,
            range: u32::MAX,
        };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    /// Bytes that are left behind what the bits up to here need; negative where bytes are missing.
    pub(super) fn left(&self) -> isize {
        self.bytes.len() as isize + AHEAD as isize - self.next as isize
    }

    fn shift(&mut self) {
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.code = self.code << 8 | u32::from(byte);
        self.next += 1;
    }

    fn normalize(&mut self) {
        while self.range < SMALLEST {
            self.shift();
            self.range <<= 8;
        }
    }
}

impl Coder for Decoder<'_> {
    fn bit(&mut self, odds: &mut Odds, _: bool) -> bool {
        let part = (self.range >> 16) * u32::from(odds.one);
        let bit = self.code < part;
        if bit {
            self.range = part;
        } else {
            self.code -= part;
            self.range -= part;
        }
        odds.learn(bit);
        self.normalize();
        bit
    }

    fn plain(&mut self, _: u32, count: u32) -> u32 {
        let mut value = 0;
        for _ in 0..count {
            self.range >>= 1;
            let bit = self.code >= self.range;
            if bit {
                self.code -= self.range;
            }
            value = value << 1 | u32::from(bit);
            self.normalize();
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bits, some with one of four odds, some plain.
    fn run(coder: &mut impl Coder, bits: &[(u8, bool)]) -> Vec<bool> {
        let mut odds = [Odds::EVEN; 4];
        bits.iter()
            .map(|&(kind, bit)| match odds.get_mut(usize::from(kind)) {
                Some(odds) => coder.bit(odds, bit),
                None => coder.plain(bit.into(), 1) == 1,
            })
            .collect()
    }

    fn round_trip(bits: &[(u8, bool)]) -> usize {
        let mut encoder = Encoder::new();
        let written = run(&mut encoder, bits);
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&bytes);
        assert_eq!(run(&mut decoder, bits), written);
        assert_eq!(decoder.left(), 0, "all bytes are needed, none is missing");
        bytes.len()
    }

    proptest! {
        #[test]
        fn bits_come_back(bits in prop::collection::vec((0u8..6, any::<bool>()), 0..2000)) {
            round_trip(&bits);
        }

        #[test]
        fn rare_bits_come_back(at in prop::collection::vec(0usize..3000, 0..20), common: bool) {
            let bits: Vec<_> = (0..3000).map(|i| (0, common ^ at.contains(&i))).collect();
            round_trip(&bits);
        }

        #[test]
        fn any_bytes_can_be_read(bytes in prop::collection::vec(any::<u8>(), 0..40), kinds in prop::collection::vec(0u8..6, 0..500)) {
            let bits: Vec<_> = kinds.into_iter().map(|kind| (kind, false)).collect();
            run(&mut Decoder::new(&bytes), &bits);
        }
    }

    #[test]
    fn bits_take_what_they_are_worth() {
        assert_eq!(round_trip(&[]), 1);
        assert_eq!(round_trip(&[(5, true); 800]), 101);
        // Certain ones take nearly nothing, carries run through long rows of 255.
        assert!(round_trip(&[(0, true); 10_000]) < 12);
        assert!(round_trip(&[(0, false); 10_000]) < 12);
        // One of eight: 0.544 bits each.
        let bits: Vec<_> = (0..80_000u32)
            .map(|i| (1, i.wrapping_mul(2_654_435_761) >> 29 == 0))
            .collect();
        let bytes = round_trip(&bits);
        assert!((5400..5700).contains(&bytes), "{bytes}");
    }
}
