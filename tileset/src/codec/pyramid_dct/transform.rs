//! Orthonormal DCT-II of blocks of up to 16×16 texels and its inverse, for four components at once.
//!
//! The usual lengths, 16 and 8, are written out by even and odd symmetry; any other, at the edges of images whose
//! sides are no multiples of 16, is a product with the matrix. Matrices come from additions, multiplications,
//! divisions and square roots alone, which IEEE 754 rounds the same way everywhere: a decoder must not depend on the
//! platform's cosine.

use std::sync::LazyLock;

use super::dispatch;
use crate::codec::texel::Texel;

/// Side of a block.
pub(crate) const SIDE: usize = 16;
/// Texels or coefficients of a block, in rows of [`SIDE`].
pub(crate) const AREA: usize = SIDE * SIDE;

/// A block `[y][x]` of texels, or `[u][v]` of coefficients, which spares a transposition; smaller ones fill its first
/// rows and columns.
pub(crate) type Block = [Texel; AREA];

/// Texels to coefficients, in place, of the upper left `width` × `height` corner. The rest must be zero, and stays so.
pub(crate) fn forward(block: &mut Block, size: (usize, usize)) {
    dispatch::run(Forward { block, size });
}

/// Coefficients to texels, in place. Coefficients whose frequency is `nonzero` or more in one
/// direction are known to be zero.
pub(crate) fn inverse(block: &mut Block, size: (usize, usize), nonzero: usize) {
    dispatch::run(Inverse { block, size, nonzero });
}

struct Forward<'a> {
    block: &'a mut Block,
    size: (usize, usize),
}

impl dispatch::Work for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        forward_here(self.block, self.size);
    }
}

struct Inverse<'a> {
    block: &'a mut Block,
    size: (usize, usize),
    nonzero: usize,
}

impl dispatch::Work for Inverse<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        inverse_here(self.block, self.size, self.nonzero);
    }
}

/// [`forward`] for whom is compiled for the processor already.
#[inline(always)]
pub(super) fn forward_here(block: &mut Block, (width, height): (usize, usize)) {
    forward_lines(block, height, width);
    transpose(block, width);
    forward_lines(block, width, height);
}

/// [`inverse`] for whom is compiled for the processor already.
#[inline(always)]
pub(super) fn inverse_here(block: &mut Block, (width, height): (usize, usize), nonzero: usize) {
    inverse_lines(block, width, height.min(nonzero), nonzero);
    transpose(block, SIDE);
    inverse_lines(block, height, width, nonzero);
}

/// Exchanges rows and columns; the first `count` of each row can be other than zero.
#[inline(always)]
fn transpose(block: &mut Block, count: usize) {
    let from = *block;
    let (rows, _) = from.as_chunks::<SIDE>();
    for (x, to) in block.as_chunks_mut::<SIDE>().0.iter_mut().enumerate().take(count) {
        for y in 0..SIDE {
            to[y] = rows[y][x];
        }
    }
}

/// Transforms the first `count` columns, of `length` texels.
#[inline(always)]
fn forward_lines(block: &mut Block, length: usize, count: usize) {
    match length {
        16 => each_line::<_, Forward16>(block, count),
        8 => each_line::<_, Forward8>(block, count),
        _ => any_length::<true>(block, length, count),
    }
}

/// Transforms the first `count` columns, of `length` coefficients, of which the first `nonzero` are not zero.
#[inline(always)]
fn inverse_lines(block: &mut Block, length: usize, count: usize, nonzero: usize) {
    match length {
        16 if nonzero <= 8 => each_line::<_, Inverse16Of8>(block, count),
        16 => each_line::<_, Inverse16>(block, count),
        8 => each_line::<_, Inverse8>(block, count),
        _ => any_length::<false>(block, length, count),
    }
}

/// A transform of one line of `N` numbers. Implementations are `#[inline(always)]`, which functions that are passed as
/// arguments are not.
trait Line<const N: usize> {
    fn transform(line: [f32; N]) -> [f32; N];
}

/// Transforms the first `count` columns.
///
/// One component of one column after the other, in a loop without branches: the compiler makes vectors of whatever
/// the processor has.
#[inline(always)]
fn each_line<const N: usize, L: Line<N>>(block: &mut Block, count: usize) {
    let rows: &mut [[f32; SIDE * 4]; SIDE] = bytemuck::cast_mut(block);
    #[allow(clippy::needless_range_loop, reason = "down the columns")]
    for lane in 0..(4 * count).next_multiple_of(8).min(SIDE * 4) {
        let mut line = [0.0; N];
        for i in 0..N {
            line[i] = rows[i][lane];
        }
        let line = L::transform(line);
        for i in 0..N {
            rows[i][lane] = line[i];
        }
    }
}

struct Forward8;
impl Line<8> for Forward8 {
    #[inline(always)]
    fn transform(line: [f32; 8]) -> [f32; 8] {
        forward_8(line)
    }
}

struct Forward16;
impl Line<SIDE> for Forward16 {
    #[inline(always)]
    fn transform(line: [f32; SIDE]) -> [f32; SIDE] {
        forward_16(line)
    }
}

struct Inverse8;
impl Line<8> for Inverse8 {
    #[inline(always)]
    fn transform(line: [f32; 8]) -> [f32; 8] {
        inverse_8(line)
    }
}

struct Inverse16;
impl Line<SIDE> for Inverse16 {
    #[inline(always)]
    fn transform(line: [f32; SIDE]) -> [f32; SIDE] {
        inverse_16(line)
    }
}

struct Inverse16Of8;
impl Line<SIDE> for Inverse16Of8 {
    #[inline(always)]
    fn transform(line: [f32; SIDE]) -> [f32; SIDE] {
        inverse_16_of_8(line)
    }
}

#[inline(never)]
fn any_length<const FORWARD: bool>(block: &mut Block, length: usize, count: usize) {
    let matrix = &COSINES[length];
    let from = *block;
    for i in 0..length {
        for x in 0..count {
            let mut sum = Texel::default();
            for j in 0..length {
                sum = sum + from[j * SIDE + x] * matrix[if FORWARD { i * SIDE + j } else { j * SIDE + i }];
            }
            block[i * SIDE + x] = sum;
        }
    }
}

/// Sum of products, from left to right.
#[inline(always)]
fn dot_4(a: [f32; 4], b: [f32; 4]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// Sum of products, from left to right.
#[inline(always)]
fn dot_8(a: [f32; 8], b: [f32; 8]) -> f32 {
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
fn forward_8(x: [f32; 8]) -> [f32; 8] {
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
fn inverse_8(c: [f32; 8]) -> [f32; 8] {
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
fn inverse_8_of_4(c: [f32; 4]) -> [f32; 8] {
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
fn mirrored_8(even: [f32; 4], odd: [f32; 4]) -> [f32; 8] {
    let ([a, b, c, d], [e, f, g, h]) = (even, odd);
    [a + e, b + f, c + g, d + h, d - h, c - g, b - f, a - e]
}

const SQRT_HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// The even coefficients are the DCT of length 8 of the sums of mirrored texels, the odd ones a product with their
/// differences.
#[inline(always)]
fn forward_16(x: [f32; SIDE]) -> [f32; SIDE] {
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
fn inverse_16(c: [f32; SIDE]) -> [f32; SIDE] {
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
fn inverse_16_of_8(c: [f32; SIDE]) -> [f32; SIDE] {
    let d = [c[1], c[3], c[5], c[7]];
    let odd = |row: [f32; 8]| dot_4(d, [row[0], row[1], row[2], row[3]]);
    mirrored_16(
        inverse_8_of_4([c[0], c[2], c[4], c[6]]),
        [
            odd(ODD_16[0]),
            odd(ODD_16[1]),
            odd(ODD_16[2]),
            odd(ODD_16[3]),
            odd(ODD_16[4]),
            odd(ODD_16[5]),
            odd(ODD_16[6]),
            odd(ODD_16[7]),
        ],
    )
}

/// The inverse of length 16 from the even half, still without its factor, and the odd half.
#[inline(always)]
fn mirrored_16(even: [f32; 8], odd: [f32; 8]) -> [f32; SIDE] {
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

/// For each length up to [`SIDE`] the orthonormal matrix `[k][x]`, rows of [`SIDE`].
static COSINES: LazyLock<[[f32; AREA]; SIDE + 1]> = LazyLock::new(|| {
    std::array::from_fn(|length| {
        let mut matrix = [0.0; AREA];
        for k in 0..length {
            let norm = (if k == 0 { 1.0 } else { 2.0 } / length as f64).sqrt();
            for x in 0..length {
                let angle = (2 * x + 1) * k % (4 * length);
                matrix[k * SIDE + x] = (norm * cos_of_quarters(angle, length)) as f32;
            }
        }
        matrix
    })
});

/// cos(π/2 · `numerator` / `denominator`), from its Taylor series about 0 or, by the sine, about π/2.
fn cos_of_quarters(numerator: usize, denominator: usize) -> f64 {
    // Into the first two quadrants, then into the first.
    let n = numerator % (4 * denominator);
    let n = if n > 2 * denominator {
        4 * denominator - n
    } else {
        n
    };
    if n > denominator {
        return -cos_of_quarters(2 * denominator - n, denominator);
    }
    let quarter = std::f64::consts::FRAC_PI_2;
    // x - x³/3! + … or 1 - x²/2! + …, whose argument is at most π/4.
    let series = |x: f64, mut term: f64, mut factor: f64| {
        let mut sum = 0.0;
        for _ in 0..12 {
            sum += term;
            term *= -x * x / (factor * (factor + 1.0));
            factor += 2.0;
        }
        sum
    };
    if 2 * n > denominator {
        let x = quarter * (denominator - n) as f64 / denominator as f64;
        series(x, x, 2.0)
    } else {
        let x = quarter * n as f64 / denominator as f64;
        series(x, 1.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise() -> Block {
        let mut state = 1u32;
        std::array::from_fn(|_| {
            Texel(std::array::from_fn(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 24) as f32 - 0.5
            }))
        })
    }

    /// The definition, in f64.
    fn dct(block: &Block, width: usize, height: usize, component: usize) -> Vec<f64> {
        let basis = |k: usize, x: usize, length: usize| {
            let norm = (if k == 0 { 1.0 } else { 2.0 } / length as f64).sqrt();
            norm * (std::f64::consts::PI * (x as f64 + 0.5) * k as f64 / length as f64).cos()
        };
        let mut coefficients = Vec::new();
        for v in 0..height {
            for u in 0..width {
                let mut sum = 0.0;
                for y in 0..height {
                    for x in 0..width {
                        let texel = f64::from(block[y * SIDE + x].0[component]);
                        sum += texel * basis(u, x, width) * basis(v, y, height);
                    }
                }
                coefficients.push(sum);
            }
        }
        coefficients
    }

    #[test]
    fn every_size_is_the_orthonormal_dct() {
        for size in [
            (16, 16),
            (8, 8),
            (16, 8),
            (1, 1),
            (16, 1),
            (1, 7),
            (5, 13),
            (15, 16),
            (3, 2),
            (12, 10),
        ] {
            let (width, height) = size;
            let original = noise();
            let mut block = original;
            forward(&mut block, size);
            for component in 0..4 {
                let wanted = dct(&original, width, height, component);
                for (i, wanted) in wanted.into_iter().enumerate() {
                    let found = block[i % width * SIDE + i / width].0[component];
                    assert!(
                        (f64::from(found) - wanted).abs() < 2e-6,
                        "{size:?} {i}: {found} {wanted}"
                    );
                }
            }
            inverse(&mut block, size, SIDE);
            for y in 0..height {
                for x in 0..width {
                    let (found, wanted) = (block[y * SIDE + x], original[y * SIDE + x]);
                    assert!(
                        (0..4).all(|c| (found.0[c] - wanted.0[c]).abs() < 2e-6),
                        "{size:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_is_zero_can_be_left_out() {
        for size in [(16, 16), (8, 16), (16, 5)] {
            for nonzero in [1, 3, 8, 9, 12, 13] {
                let mut block = noise();
                for (i, coefficient) in block.iter_mut().enumerate() {
                    if i / SIDE >= nonzero.min(size.0) || i % SIDE >= nonzero.min(size.1) {
                        *coefficient = Texel::default();
                    }
                }
                let mut short = block;
                inverse(&mut block, size, SIDE);
                inverse(&mut short, size, nonzero);
                let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
                assert!(
                    block
                        .iter()
                        .zip(&short)
                        .all(|(a, b)| (0..4).all(|c| near(a.0[c], b.0[c])))
                );
            }
        }
    }

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
        for length in 1..=SIDE {
            for n in 0..4 * length {
                let wanted = (n as f64 / length as f64 * std::f64::consts::FRAC_PI_2).cos();
                assert!((cos_of_quarters(n, length) - wanted).abs() < 1e-15);
            }
        }
    }
}
