//! Orthonormal DCT-II of one line of 8 or 16 numbers, and its inverse: what both page codecs are made of.
//!
//! Written out by even and odd symmetry from constants. A library's transform would compute its factors with
//! the platform's sine, which differs in the last bit between platforms; a decoder must not.

use std::ops::{Add, Mul, Sub};

/// A number, or several that are worked on at once. No closures below: what is not inlined cannot use the instructions that
/// its caller is compiled for.
pub(super) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f32, Output = Self>
{
}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>> Number for T {}

/// Sum of products, from left to right.
#[inline(always)]
fn dot_4<T: Number>(a: [T; 4], b: [f32; 4]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// [`dot_8`] where the last four of `a` are zero.
#[inline(always)]
fn dot_4_of_8<T: Number>(a: [T; 4], b: [f32; 8]) -> T {
    dot_4(a, [b[0], b[1], b[2], b[3]])
}

/// Sum of products, from left to right.
#[inline(always)]
fn dot_8<T: Number>(a: [T; 8], b: [f32; 8]) -> T {
    a[0] * b[0]
        + a[1] * b[1]
        + a[2] * b[2]
        + a[3] * b[3]
        + a[4] * b[4]
        + a[5] * b[5]
        + a[6] * b[6]
        + a[7] * b[7]
}

// COS_K = cos(K·π/16) / 2, the factors of the orthonormal transform of length 8.
const COS_1: f32 = 0.490_392_63;
const COS_2: f32 = 0.461_939_75;
const COS_3: f32 = 0.415_734_8;
const COS_4: f32 = 0.353_553_38;
const COS_5: f32 = 0.277_785_12;
const COS_6: f32 = 0.191_341_71;
const COS_7: f32 = 0.097_545_16;

#[inline(always)]
pub(super) fn forward_8<T: Number>(x: [T; 8]) -> [T; 8] {
    let sums = [x[0] + x[7], x[1] + x[6], x[2] + x[5], x[3] + x[4]];
    let d = [x[0] - x[7], x[1] - x[6], x[2] - x[5], x[3] - x[4]];
    let (a0, a1) = (sums[0] + sums[3], sums[1] + sums[2]);
    let (b0, b1) = (sums[0] - sums[3], sums[1] - sums[2]);
    [
        (a0 + a1) * COS_4,
        dot_4(d, [COS_1, COS_3, COS_5, COS_7]),
        b0 * COS_2 + b1 * COS_6,
        dot_4(d, [COS_3, -COS_7, -COS_1, -COS_5]),
        (a0 - a1) * COS_4,
        dot_4(d, [COS_5, -COS_1, COS_7, COS_3]),
        b0 * COS_6 - b1 * COS_2,
        dot_4(d, [COS_7, -COS_5, COS_3, -COS_1]),
    ]
}

#[inline(always)]
pub(super) fn inverse_8<T: Number>(c: [T; 8]) -> [T; 8] {
    let (p0, p1) = ((c[0] + c[4]) * COS_4, (c[0] - c[4]) * COS_4);
    let (q0, q1) = (c[2] * COS_2 + c[6] * COS_6, c[2] * COS_6 - c[6] * COS_2);
    let even = [p0 + q0, p1 + q1, p1 - q1, p0 - q0];
    let d = [c[1], c[3], c[5], c[7]];
    mirrored_8(
        even,
        [
            dot_4(d, [COS_1, COS_3, COS_5, COS_7]),
            dot_4(d, [COS_3, -COS_7, -COS_1, -COS_5]),
            dot_4(d, [COS_5, -COS_1, COS_7, COS_3]),
            dot_4(d, [COS_7, -COS_5, COS_3, -COS_1]),
        ],
    )
}

/// [`inverse_8`] where the last four are zero.
#[inline(always)]
fn inverse_8_of_4<T: Number>(c: [T; 4]) -> [T; 8] {
    let (p, q0, q1) = (c[0] * COS_4, c[2] * COS_2, c[2] * COS_6);
    mirrored_8(
        [p + q0, p + q1, p - q1, p - q0],
        [
            c[1] * COS_1 + c[3] * COS_3,
            c[1] * COS_3 - c[3] * COS_7,
            c[1] * COS_5 - c[3] * COS_1,
            c[1] * COS_7 - c[3] * COS_5,
        ],
    )
}

#[inline(always)]
fn mirrored_8<T: Number>(even: [T; 4], odd: [T; 4]) -> [T; 8] {
    let ([a, b, c, d], [e, f, g, h]) = (even, odd);
    [a + e, b + f, c + g, d + h, d - h, c - g, b - f, a - e]
}

const SQRT_HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// The even coefficients are the DCT of length 8 of the sums of mirrored texels, the odd ones a product with their
/// differences.
#[inline(always)]
pub(super) fn forward_16<T: Number>(x: [T; 16]) -> [T; 16] {
    let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p] = x;
    let sums = [a + p, b + o, c + n, d + m, e + l, f + k, g + j, h + i];
    let d = [a - p, b - o, c - n, d - m, e - l, f - k, g - j, h - i];
    let even = forward_8(sums);
    [
        even[0] * SQRT_HALF,
        dot_8(d, ODD_16[0]),
        even[1] * SQRT_HALF,
        dot_8(d, ODD_16[1]),
        even[2] * SQRT_HALF,
        dot_8(d, ODD_16[2]),
        even[3] * SQRT_HALF,
        dot_8(d, ODD_16[3]),
        even[4] * SQRT_HALF,
        dot_8(d, ODD_16[4]),
        even[5] * SQRT_HALF,
        dot_8(d, ODD_16[5]),
        even[6] * SQRT_HALF,
        dot_8(d, ODD_16[6]),
        even[7] * SQRT_HALF,
        dot_8(d, ODD_16[7]),
    ]
}

#[inline(always)]
pub(super) fn inverse_16<T: Number>(c: [T; 16]) -> [T; 16] {
    let even = inverse_8([c[0], c[2], c[4], c[6], c[8], c[10], c[12], c[14]]);
    let d = [c[1], c[3], c[5], c[7], c[9], c[11], c[13], c[15]];
    // The matrix is symmetric: its inverse is itself.
    mirrored_16(
        even,
        [
            dot_8(d, ODD_16[0]),
            dot_8(d, ODD_16[1]),
            dot_8(d, ODD_16[2]),
            dot_8(d, ODD_16[3]),
            dot_8(d, ODD_16[4]),
            dot_8(d, ODD_16[5]),
            dot_8(d, ODD_16[6]),
            dot_8(d, ODD_16[7]),
        ],
    )
}

/// [`inverse_16`] where the last eight are zero.
#[inline(always)]
pub(super) fn inverse_16_of_8<T: Number>(c: [T; 8]) -> [T; 16] {
    let d = [c[1], c[3], c[5], c[7]];
    mirrored_16(
        inverse_8_of_4([c[0], c[2], c[4], c[6]]),
        [
            dot_4_of_8(d, ODD_16[0]),
            dot_4_of_8(d, ODD_16[1]),
            dot_4_of_8(d, ODD_16[2]),
            dot_4_of_8(d, ODD_16[3]),
            dot_4_of_8(d, ODD_16[4]),
            dot_4_of_8(d, ODD_16[5]),
            dot_4_of_8(d, ODD_16[6]),
            dot_4_of_8(d, ODD_16[7]),
        ],
    )
}

/// The inverse of length 16 from the even half, still without its factor, and the odd half.
#[inline(always)]
fn mirrored_16<T: Number>(even: [T; 8], odd: [T; 8]) -> [T; 16] {
    let [a, b, c, d, e, f, g, h] = even;
    let [a, b, c, d] = [a * SQRT_HALF, b * SQRT_HALF, c * SQRT_HALF, d * SQRT_HALF];
    let [e, f, g, h] = [e * SQRT_HALF, f * SQRT_HALF, g * SQRT_HALF, h * SQRT_HALF];
    let [i, j, k, l, m, n, o, p] = odd;
    [
        a + i,
        b + j,
        c + k,
        d + l,
        e + m,
        f + n,
        g + o,
        h + p,
        h - p,
        g - o,
        f - n,
        e - m,
        d - l,
        c - k,
        b - j,
        a - i,
    ]
}

/// `[k][i]`: cos((2k + 1)(2i + 1)·π/32) · √(2/16), the odd rows of the orthonormal DCT of length 16 over its first
/// half.
const ODD_16: [[f32; 8]; 8] = {
    // COS[j] = cos(j·π/32) / √8 for odd j.
    const COS: [f32; 16] = [
        0.0,
        0.351_850_93,
        0.0,
        0.338_329_5,
        0.0,
        0.311_806_26,
        0.0,
        0.273_300_47,
        0.0,
        0.224_291_89,
        0.0,
        0.166_663_91,
        0.0,
        0.102_631_13,
        0.0,
        0.034_654_293,
    ];
    let mut matrix = [[0.0; 8]; 8];
    let mut k = 0;
    while k < 8 {
        let mut i = 0;
        while i < 8 {
            // The cosine has period 64 and is even about 0 and odd about 16.
            let angle = (2 * k + 1) * (2 * i + 1) % 64;
            let angle = if angle > 32 { 64 - angle } else { angle };
            matrix[k][i] = if angle > 16 { -COS[32 - angle] } else { COS[angle] };
            i += 1;
        }
        k += 1;
    }
    matrix
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_the_nearest_floats() {
        let found = [COS_1, COS_2, COS_3, COS_4, COS_5, COS_6, COS_7];
        for (k, found) in (1..).zip(found) {
            let wanted = (f64::from(k) * std::f64::consts::PI / 16.0).cos() / 2.0;
            assert_eq!(found, wanted as f32);
        }
        for (k, row) in ODD_16.iter().enumerate() {
            for (i, &found) in row.iter().enumerate() {
                let angle = ((2 * k + 1) * (2 * i + 1)) as f64 * std::f64::consts::PI / 32.0;
                assert_eq!(found, (angle.cos() / 8f64.sqrt()) as f32, "{k} {i}");
            }
        }
    }
}
