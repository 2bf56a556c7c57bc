//! Work compiled twice: for any processor, and for those with AVX2.
//!
//! One choice a page, outside of all loops. Both ways give the same bits: integers are integers, halves are rounded to
//! the nearest, and no feature that is switched on fuses a multiplication with an addition.

use std::ops::{Add, Mul, Sub};

use half::{f16, slice::HalfFloatSliceExt};

use super::context::Expected;
use super::levels::Reader;
use super::scan::Scan;
use super::transform::Block;
use crate::codec::lines::Number;

/// What processors do in different ways.
pub(super) trait Processor: Copy {
    /// Eight floats that are worked on at once.
    type Eight: Eight;
    /// [`Reader::read`].
    fn read(
        self,
        reader: &mut Reader,
        scan: &Scan,
        end: usize,
        step: f32,
        block: &mut Block,
        expected: &mut Expected,
    );
    /// Takes floats as they are.
    fn eight(self, floats: [f32; 8]) -> Self::Eight;
    /// From half floats, which is exact.
    fn eight_halves(self, halves: [f16; 8]) -> Self::Eight;
    /// [`Self::eight_halves`] of all, which may be faster together.
    fn eights(self, halves: &[[f16; 8]; 8]) -> [Self::Eight; 8];
    /// [`Eight::halves`] of all, which may be faster together.
    fn all_halves(self, eights: &[Self::Eight; 16]) -> [[f16; 8]; 16];
}

/// Two texels of four components each.
pub(super) trait Eight: Number + Mul<Output = Self> {
    /// As they are.
    fn floats(self) -> [f32; 8];
    /// Rounds to half floats.
    fn halves(self) -> [f16; 8];
    /// What is above `limit` or below `-limit`, or no number, becomes one of these.
    fn within(self, limit: f32) -> Self;
    /// The first texels of two, and the second ones.
    fn exchange(self, other: Self) -> [Self; 2];
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
    type Eight = Floats;

    #[inline(always)]
    fn read(
        self,
        reader: &mut Reader,
        scan: &Scan,
        end: usize,
        step: f32,
        block: &mut Block,
        expected: &mut Expected,
    ) {
        reader.read(scan, end, step, block, expected);
    }

    #[inline(always)]
    fn eight(self, floats: [f32; 8]) -> Floats {
        Floats(floats)
    }

    #[inline(always)]
    fn eight_halves(self, halves: [f16; 8]) -> Floats {
        let mut floats = [0.0; 8];
        halves.convert_to_f32_slice(&mut floats);
        Floats(floats)
    }

    #[inline(always)]
    fn eights(self, halves: &[[f16; 8]; 8]) -> [Floats; 8] {
        let mut floats = [[0.0; 8]; 8];
        halves
            .as_flattened()
            .convert_to_f32_slice(floats.as_flattened_mut());
        floats.map(Floats)
    }

    #[inline(always)]
    fn all_halves(self, eights: &[Floats; 16]) -> [[f16; 8]; 16] {
        let mut halves = [[f16::ZERO; 8]; 16];
        halves
            .as_flattened_mut()
            .convert_from_f32_slice(eights.map(|eight| eight.0).as_flattened());
        halves
    }
}

/// [`Eight`] for [`Any`].
#[derive(Clone, Copy)]
pub(super) struct Floats([f32; 8]);

impl Add for Floats {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl Sub for Floats {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - other.0[i]))
    }
}

impl Mul<f32> for Floats {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        Self(self.0.map(|value| value * factor))
    }
}

impl Mul for Floats {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] * other.0[i]))
    }
}

impl Eight for Floats {
    #[inline(always)]
    fn floats(self) -> [f32; 8] {
        self.0
    }

    #[inline(always)]
    fn halves(self) -> [f16; 8] {
        let mut halves = [f16::ZERO; 8];
        halves.convert_from_f32_slice(&self.0);
        halves
    }

    #[inline(always)]
    fn within(self, limit: f32) -> Self {
        // `clamp` keeps what is no number.
        let above = self.0.map(|value| if value > -limit { value } else { -limit });
        Self(above.map(|value| if value < limit { value } else { limit }))
    }

    #[inline(always)]
    fn exchange(self, other: Self) -> [Self; 2] {
        let ([a, b, c, d, e, f, g, h], [i, j, k, l, m, n, o, p]) = (self.0, other.0);
        [Self([a, b, c, d, i, j, k, l]), Self([e, f, g, h, m, n, o, p])]
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::is_x86_feature_detected;
    use std::arch::x86_64::*;
    use std::ops::{Add, Mul, Sub};

    use super::{Block, Eight, Expected, Processor, Reader, Scan, Work, f16};

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
        type Eight = Vector;

        #[inline(always)]
        fn read(
            self,
            reader: &mut Reader,
            scan: &Scan,
            end: usize,
            step: f32,
            block: &mut Block,
            expected: &mut Expected,
        ) {
            // SAFETY: `self` exists.
            unsafe { reader.read_avx2(scan, end, step, block, expected) }
        }

        #[inline(always)]
        fn eight(self, floats: [f32; 8]) -> Vector {
            Vector(bytemuck::cast(floats))
        }

        #[inline(always)]
        fn eight_halves(self, halves: [f16; 8]) -> Vector {
            // SAFETY: `self` exists.
            Vector(unsafe { _mm256_cvtph_ps(bytemuck::cast(halves)) })
        }

        #[inline(always)]
        fn eights(self, halves: &[[f16; 8]; 8]) -> [Vector; 8] {
            let mut eights = [self.eight([0.0; 8]); 8];
            for (eight, halves) in eights.iter_mut().zip(halves) {
                *eight = self.eight_halves(*halves);
            }
            eights
        }

        #[inline(always)]
        fn all_halves(self, eights: &[Vector; 16]) -> [[f16; 8]; 16] {
            let mut halves = [[f16::ZERO; 8]; 16];
            for (halves, eight) in halves.iter_mut().zip(eights) {
                *halves = eight.halves();
            }
            halves
        }
    }

    /// [`Eight`] for [`Avx2`], out of which alone it comes: where there is one, the processor has AVX2 and F16C.
    #[derive(Clone, Copy)]
    pub(super) struct Vector(__m256);

    impl Add for Vector {
        type Output = Self;
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: `self` exists.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }
    }

    impl Sub for Vector {
        type Output = Self;
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: `self` exists.
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
    }

    impl Mul<f32> for Vector {
        type Output = Self;
        #[inline(always)]
        fn mul(self, factor: f32) -> Self {
            // SAFETY: `self` exists.
            Self(unsafe { _mm256_mul_ps(self.0, _mm256_set1_ps(factor)) })
        }
    }

    impl Mul for Vector {
        type Output = Self;
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: `self` exists.
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
    }

    impl Eight for Vector {
        #[inline(always)]
        fn floats(self) -> [f32; 8] {
            bytemuck::cast(self.0)
        }

        #[inline(always)]
        fn halves(self) -> [f16; 8] {
            // SAFETY: `self` exists.
            bytemuck::cast(unsafe { _mm256_cvtps_ph::<_MM_FROUND_TO_NEAREST_INT>(self.0) })
        }

        #[inline(always)]
        fn within(self, limit: f32) -> Self {
            // The second operand is taken where one of both is no number.
            // SAFETY: `self` exists.
            Self(unsafe {
                let above = _mm256_max_ps(self.0, _mm256_set1_ps(-limit));
                _mm256_min_ps(above, _mm256_set1_ps(limit))
            })
        }

        #[inline(always)]
        fn exchange(self, other: Self) -> [Self; 2] {
            // SAFETY: `self` exists.
            unsafe {
                [
                    Self(_mm256_permute2f128_ps::<0x20>(self.0, other.0)),
                    Self(_mm256_permute2f128_ps::<0x31>(self.0, other.0)),
                ]
            }
        }
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
            for first in (0..=u16::MAX).step_by(8) {
                let halves = std::array::from_fn(|i| f16::from_bits(first + i as u16));
                let floats = processor.eight_halves(halves).floats();
                let together = processor.eights(&[halves; 8]).map(Eight::floats);
                all.extend(together.as_flattened().iter().map(|value| (0, value.to_bits())));
                // Between two halves, too: a little less and more than the middle, and the middle itself.
                for part in 0..2048 / 64 {
                    let off = |i: usize| (((part * 8 + i) % 63) as f32 - 31.0) / 65536.0;
                    let near = std::array::from_fn(|i| floats[i] * (1.0 + off(i)));
                    let rounded = processor.eight(near).halves();
                    let [.., together] = processor.all_halves(&[processor.eight(near); 16]);
                    all.extend(together.map(|value| (value.to_bits(), 0)));
                    let within = processor.eight(near).within(3.0).floats();
                    all.extend((0..8).map(|i| (rounded[i].to_bits(), floats[i].to_bits())));
                    all.extend(within.map(|value| (0, value.to_bits())));
                }
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

    struct Arithmetic;

    impl Work for Arithmetic {
        type Output = Vec<[f32; 8]>;
        #[inline(always)]
        fn run(self, processor: impl Processor) -> Self::Output {
            let a = processor.eight([0.1, -2.0, 3.0e30, 4.0, 5.5, -6.0, 7.0, 1.0e-40]);
            let b = processor.eight([8.0, 9.1, -1.0e31, 0.0, 1.0, 2.0, 3.3, 4.0e-41]);
            let [first, second] = a.exchange(b);
            [first, second, a + b, a - b, a * b, a * 0.7]
                .map(Eight::floats)
                .to_vec()
        }
    }

    #[test]
    fn arithmetic_is_the_same_everywhere() {
        let plain = Arithmetic.run(Any);
        assert_eq!(plain[0], [0.1, -2.0, 3.0e30, 4.0, 8.0, 9.1, -1.0e31, 0.0]);
        assert_eq!(plain[1], [5.5, -6.0, 7.0, 1.0e-40, 1.0, 2.0, 3.3, 4.0e-41]);
        assert_eq!(plain, run(Arithmetic));
    }
}
