//! Random numbers that are the same on every platform.

use rand_chacha::{
    ChaCha8Rng,
    rand_core::{Rng, SeedableRng},
};

/// A stream of random numbers, named so that drawing more from one does not move another.
pub(super) struct Random(ChaCha8Rng);

impl Random {
    /// The stream `name` of `seed`: the key of ChaCha is the seed's eight bytes, little-endian, and the first 24
    /// bytes of the name.
    pub(super) fn new(seed: u64, name: &str) -> Random {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        for (slot, byte) in key[8..].iter_mut().zip(name.bytes()) {
            *slot = byte;
        }
        Random(ChaCha8Rng::from_seed(key))
    }

    /// Any 32 bits.
    pub(super) fn bits(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f32 {
        unit(self.bits())
    }

    /// Uniform in [low, high).
    pub(super) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }
}

/// The upper 24 bits as a number in [0, 1).
pub(super) fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Mixes 32 bits so that every input bit moves every output bit (Wellons, Prospecting for Hash Functions, 2018:
/// `lowbias32`).
pub(super) fn mix(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_seed_and_name_and_repeat() {
        let draw = |seed, name| Random::new(seed, name).bits();
        assert_eq!(draw(1, "a"), draw(1, "a"));
        assert_ne!(draw(1, "a"), draw(2, "a"));
        assert_ne!(draw(1, "a"), draw(1, "b"));
    }

    #[test]
    fn units_are_below_one() {
        assert!(unit(u32::MAX) < 1.0);
        assert_eq!(unit(0), 0.0);
    }
}
