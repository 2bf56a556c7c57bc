//! The orthonormal 8×8 DCT-II and its inverse, for four components at once.
//!
//! Written out by even and odd symmetry from constants. A library's transform would compute its factors with
//! the platform's sine, which differs in the last bit between platforms; a decoder must not.

use super::texel::Texel;

/// Side of a block.
pub(crate) const BLOCK: usize = 8;
/// Coefficients in a block.
pub(crate) const BLOCK_AREA: usize = BLOCK * BLOCK;

/// One block, `[y][x]` or `[v][u]`.
pub(crate) type Block = [Texel; BLOCK_AREA];

// COS_K = cos(K·π/16) / 2, the factors of the orthonormal transform of length 8.
const COS_1: f32 = 0.490_392_63;
const COS_2: f32 = 0.461_939_75;
const COS_3: f32 = 0.415_734_8;
const COS_4: f32 = 0.353_553_38;
const COS_5: f32 = 0.277_785_12;
const COS_6: f32 = 0.191_341_72;
const COS_7: f32 = 0.097_545_16;

/// Texels to coefficients, in place.
pub(crate) fn forward(block: &mut Block) {
    transform::<false>(block);
}

/// Coefficients to texels, in place.
pub(crate) fn inverse(block: &mut Block) {
    transform::<true>(block);
}

/// Columns first, then rows as the columns of the transposed block.
#[inline(always)]
fn transform<const INVERSE: bool>(block: &mut Block) {
    for _ in 0..2 {
        transform_columns::<INVERSE>(bytemuck::cast_mut(block));
        for y in 0..BLOCK {
            for x in 0..y {
                block.swap(y * BLOCK + x, x * BLOCK + y);
            }
        }
    }
}

/// Transforms the eight columns of four components each. One lane after the other, so that the compiler
/// works on many of them at once.
#[inline(always)]
#[allow(
    clippy::needless_range_loop,
    reason = "a lane is an index into each row, not into the rows"
)]
fn transform_columns<const INVERSE: bool>(rows: &mut [[f32; BLOCK * 4]; BLOCK]) {
    for lane in 0..BLOCK * 4 {
        let column = std::array::from_fn(|y| rows[y][lane]);
        let column = if INVERSE {
            inverse_8(column)
        } else {
            forward_8(column)
        };
        for y in 0..BLOCK {
            rows[y][lane] = column[y];
        }
    }
}

#[inline(always)]
fn forward_8(x: [f32; BLOCK]) -> [f32; BLOCK] {
    let sums: [f32; 4] = std::array::from_fn(|i| x[i] + x[7 - i]);
    let [d0, d1, d2, d3]: [f32; 4] = std::array::from_fn(|i| x[i] - x[7 - i]);
    let (a0, a1) = (sums[0] + sums[3], sums[1] + sums[2]);
    let (b0, b1) = (sums[0] - sums[3], sums[1] - sums[2]);
    [
        (a0 + a1) * COS_4,
        d0 * COS_1 + d1 * COS_3 + d2 * COS_5 + d3 * COS_7,
        b0 * COS_2 + b1 * COS_6,
        d0 * COS_3 - d1 * COS_7 - d2 * COS_1 - d3 * COS_5,
        (a0 - a1) * COS_4,
        d0 * COS_5 - d1 * COS_1 + d2 * COS_7 + d3 * COS_3,
        b0 * COS_6 - b1 * COS_2,
        d0 * COS_7 - d1 * COS_5 + d2 * COS_3 - d3 * COS_1,
    ]
}

#[inline(always)]
fn inverse_8(c: [f32; BLOCK]) -> [f32; BLOCK] {
    let (p0, p1) = ((c[0] + c[4]) * COS_4, (c[0] - c[4]) * COS_4);
    let (q0, q1) = (c[2] * COS_2 + c[6] * COS_6, c[2] * COS_6 - c[6] * COS_2);
    let even = [p0 + q0, p1 + q1, p1 - q1, p0 - q0];
    let odd = [
        c[1] * COS_1 + c[3] * COS_3 + c[5] * COS_5 + c[7] * COS_7,
        c[1] * COS_3 - c[3] * COS_7 - c[5] * COS_1 - c[7] * COS_5,
        c[1] * COS_5 - c[3] * COS_1 + c[5] * COS_7 + c[7] * COS_3,
        c[1] * COS_7 - c[3] * COS_5 + c[5] * COS_3 - c[7] * COS_1,
    ];
    std::array::from_fn(|i| {
        if i < 4 {
            even[i] + odd[i]
        } else {
            even[7 - i] - odd[7 - i]
        }
    })
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

    #[test]
    fn forward_is_the_orthonormal_dct_of_rustdct() {
        let mut block = noise();
        let dct = rustdct::DctPlanner::<f64>::new().plan_dct2(BLOCK);
        for component in 0..4 {
            let mut wanted: Vec<f64> = block.iter().map(|texel| texel.0[component].into()).collect();
            for _ in 0..2 {
                for line in wanted.chunks_mut(BLOCK) {
                    dct.process_dct2(line);
                    line.iter_mut().for_each(|value| *value *= 0.5);
                    line[0] *= 0.5f64.sqrt();
                }
                wanted = (0..BLOCK_AREA)
                    .map(|i| wanted[i % BLOCK * BLOCK + i / BLOCK])
                    .collect();
            }
            let mut found = block;
            forward(&mut found);
            for (found, wanted) in found.iter().zip(wanted) {
                assert!((f64::from(found.0[component]) - wanted).abs() < 1e-6);
            }
        }
        forward(&mut block);
        inverse(&mut block);
        for (found, wanted) in block.iter().zip(noise()) {
            assert!((0..4).all(|c| (found.0[c] - wanted.0[c]).abs() < 1e-6));
        }
    }

    #[test]
    fn constants_are_the_nearest_floats() {
        let found = [COS_1, COS_2, COS_3, COS_4, COS_5, COS_6, COS_7];
        for (k, found) in (1..).zip(found) {
            let wanted = (f64::from(k) * std::f64::consts::PI / 16.0).cos() / 2.0;
            assert_eq!(found, wanted as f32);
        }
    }
}
