//! Work compiled twice: for any processor, and for those with AVX2.
//!
//! One choice a page, outside of all loops. Both ways give the same bits: integers are integers, halves are rounded to
//! the nearest, and no feature that is switched on fuses a multiplication with an addition.

use half::{f16, slice::HalfFloatSliceExt};

use super::levels::Reader;
use super::scan::Scan;
use super::transform::Block;

/// What processors do in different ways.
pub(super) trait Processor: Copy {
    /// [`Reader::read`].
    fn read(self, reader: &mut Reader, scan: &Scan, step: f32, block: &mut Block) -> usize;
    /// Rounds to half floats.
    fn halves(self, floats: &[f32; 64]) -> [f16; 64];
    /// The inverse of [`Self::halves`], which is exact.
    fn floats(self, halves: &[f16; 32]) -> [f32; 32];
}

/// Work whose `run`, and all that it calls in its loops, is `#[inline(always)]`, so that it can be compiled for other
/// processors than its caller.
pub(super) trait Work {
    type Output;
    /// Does it.
    fn run(self, processor: impl Processor) -> Self::Output;
}

/// Runs `work` with the best that this processor has.
pub(super) fn run<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(processor) = avx2::Avx2::detect() {
        return processor.run(work);
    }
    work.run(Any)
}

/// Whatever the caller is compiled for.
#[derive(Clone, Copy)]
pub(super) struct Any;

impl Processor for Any {
    #[inline(always)]
    fn read(self, reader: &mut Reader, scan: &Scan, step: f32, block: &mut Block) -> usize {
        reader.read(scan, step, block)
    }

    #[inline(always)]
    fn halves(self, floats: &[f32; 64]) -> [f16; 64] {
        let mut halves = [f16::ZERO; 64];
        halves.convert_from_f32_slice(floats);
        halves
    }

    #[inline(always)]
    fn floats(self, halves: &[f16; 32]) -> [f32; 32] {
        let mut floats = [0.0; 32];
        halves.convert_to_f32_slice(&mut floats);
        floats
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::is_x86_feature_detected;
    use std::arch::x86_64::*;

    use super::{Block, Processor, Reader, Scan, Work, f16};

    /// Exists only where the processor has AVX2, BMI1, BMI2, POPCNT and F16C.
    #[derive(Clone, Copy)]
    pub(super) struct Avx2(());

    impl Avx2 {
        pub(super) fn detect() -> Option<Self> {
            let found = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("popcnt")
                && is_x86_feature_detected!("f16c");
            found.then_some(Self(()))
        }

        pub(super) fn run<W: Work>(self, work: W) -> W::Output {
            // SAFETY: `self` exists, so the processor has all that the function is compiled for.
            unsafe { run(self, work) }
        }
    }

    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt,f16c")]
    fn run<W: Work>(processor: Avx2, work: W) -> W::Output {
        work.run(processor)
    }

    impl Processor for Avx2 {
        #[inline(always)]
        fn read(self, reader: &mut Reader, scan: &Scan, step: f32, block: &mut Block) -> usize {
            // SAFETY: `self` exists.
            unsafe { reader.read_avx2(scan, step, block) }
        }

        #[inline(always)]
        fn halves(self, floats: &[f32; 64]) -> [f16; 64] {
            // SAFETY: `self` exists.
            unsafe { halves(floats) }
        }

        #[inline(always)]
        fn floats(self, halves: &[f16; 32]) -> [f32; 32] {
            // SAFETY: `self` exists.
            unsafe { floats(halves) }
        }
    }

    #[inline]
    #[target_feature(enable = "avx2,f16c")]
    fn halves(values: &[f32; 64]) -> [f16; 64] {
        let mut halves = [_mm_setzero_si128(); 8];
        for (halves, values) in halves.iter_mut().zip(values.as_chunks::<8>().0) {
            *halves = _mm256_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(bytemuck::cast(*values));
        }
        bytemuck::cast(halves)
    }

    #[inline]
    #[target_feature(enable = "avx2,f16c")]
    fn floats(halves: &[f16; 32]) -> [f32; 32] {
        let mut values = [_mm256_setzero_ps(); 4];
        for (values, halves) in values.iter_mut().zip(halves.as_chunks::<8>().0) {
            *values = _mm256_cvtph_ps(bytemuck::cast(*halves));
        }
        bytemuck::cast(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Convert;

    impl Work for Convert {
        type Output = Vec<(u16, u32)>;
        #[inline(always)]
        fn run(self, processor: impl Processor) -> Self::Output {
            let mut all = Vec::new();
            for first in (0..=u16::MAX).step_by(32) {
                let halves: [f16; 32] = std::array::from_fn(|i| f16::from_bits(first + i as u16));
                let floats = processor.floats(&halves);
                // Between two halves, too: a little less and more than the middle, and the middle itself.
                let near: [f32; 64] = std::array::from_fn(|i| {
                    let value = floats[i / 2];
                    if i % 2 == 0 {
                        value
                    } else {
                        value * (1.0 + (i as f32 - 31.0) / 65536.0)
                    }
                });
                let rounded = processor.halves(&near);
                all.extend((0..64).map(|i| (rounded[i].to_bits(), floats[i / 2].to_bits())));
            }
            // What is no number has many bit patterns.
            all.retain(|(half, float)| !f16::from_bits(*half).is_nan() && !f32::from_bits(*float).is_nan());
            all
        }
    }

    #[test]
    fn half_floats_are_the_same_everywhere() {
        let plain = Convert.run(Any);
        assert!(plain.len() > 120_000);
        assert_eq!(plain, run(Convert));
    }
}
