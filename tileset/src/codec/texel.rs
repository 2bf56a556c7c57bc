//! Four components at once: the arithmetic of transform and filters.

use std::ops::{Add, Mul, Sub};

/// One texel of a component group. Plain lane-wise f32 arithmetic, which the compiler turns into vector
/// instructions; Rust never fuses a multiplication with an addition, so results have the same bits
/// everywhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(crate) struct Texel(pub [f32; 4]);

impl Add for Texel {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|c| self.0[c] + other.0[c]))
    }
}

impl Sub for Texel {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|c| self.0[c] - other.0[c]))
    }
}

impl Mul<f32> for Texel {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        Self(self.0.map(|value| value * factor))
    }
}
