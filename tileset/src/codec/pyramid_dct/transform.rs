//! Orthonormal DCT-II of blocks of up to 16×16 texels and its inverse, for four components at once.
//!
//! The usual lengths, 16 and 8, are written out, see [`crate::codec::lines`]; any other, at the edges of images whose
//! sides are no multiples of 16, is a product with the matrix. Matrices come from additions, multiplications,
//! divisions and square roots alone, which IEEE 754 rounds the same way everywhere: a decoder must not depend on the
//! platform's cosine.

use std::sync::LazyLock;

use super::dispatch;
use crate::codec::lines::{forward_8, forward_16, inverse_8, inverse_16, inverse_16_of_8};
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
    fn run(self, _: impl dispatch::Processor) {
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
    fn run(self, _: impl dispatch::Processor) {
        inverse_here(self.block, self.size, self.nonzero);
    }
}

/// [`forward`] for whom is compiled for the processor already.
#[inline(always)]
pub(super) fn forward_here(block: &mut Block, (width, height): (usize, usize)) {
    forward_lines(block, height, width);
    transpose(block, width.max(height));
    forward_lines(block, width, height);
}

/// [`inverse`] for whom is compiled for the processor already.
#[inline(always)]
pub(super) fn inverse_here(block: &mut Block, (width, height): (usize, usize), nonzero: usize) {
    inverse_lines(block, width, height.min(nonzero), nonzero);
    transpose(block, width.max(height));
    inverse_lines(block, height, width, nonzero);
}

/// Exchanges rows and columns of the upper left corner of `side` × `side`.
#[inline(always)]
fn transpose(block: &mut Block, side: usize) {
    for y in 1..side.min(SIDE) {
        for x in 0..y {
            block.swap(y * SIDE + x, x * SIDE + y);
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
        let [a, b, c, d, e, f, g, h, ..] = line;
        inverse_16_of_8([a, b, c, d, e, f, g, h])
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

/// The orthonormal DCT-II of all lengths up to 16, `[length][k][x]`, 16 of each but the length, which counts from 0 to
/// 16: the value at `x` of the basis function of frequency `k`, or zero.
pub fn matrices() -> &'static [f32] {
    COSINES.as_flattened()
}

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
    fn cosines_are_those_of_the_platform() {
        for length in 1..=SIDE {
            for n in 0..4 * length {
                let wanted = (n as f64 / length as f64 * std::f64::consts::FRAC_PI_2).cos();
                assert!((cos_of_quarters(n, length) - wanted).abs() < 1e-15);
            }
        }
    }
}
