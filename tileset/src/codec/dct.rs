//! The orthonormal 8×8 DCT-II and its inverse, for four components at once.

use super::lines::{forward_8, inverse_8};
use super::texel::Texel;

/// Side of a block.
pub(crate) const BLOCK: usize = 8;
/// Coefficients in a block.
pub(crate) const BLOCK_AREA: usize = BLOCK * BLOCK;

/// One block, `[y][x]` or `[v][u]`.
pub(crate) type Block = [Texel; BLOCK_AREA];

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
}
