//! Full blocks: 16×16 texels over 8×8 of the parent, from slot to slot without a copy between.
//!
//! The same sums in the same order as [`super::transform`] has for blocks of any size; which coefficients are known to be
//! zero decides which terms are left out. Two texels of four components are one [`Eight`]. A line of the first direction
//! runs through sixteen of them, and what comes out is exchanged between neighbours so that lines of the other direction
//! do: no transposition of its own.

use half::f16;

use super::dispatch::{Eight, Processor};
use super::transform::{Block, SIDE};
use crate::SLOT_TEXELS;
use crate::codec::lines::{forward_8, inverse_16, inverse_16_of_8};
use crate::codec::region::HALF_MAX;

/// Side of what the parent has under a block.
const LOW: usize = SIDE / 2;
/// Pairs of texels across a block.
const PAIRS: usize = SIDE / 2;
const SLOT_ROW: usize = SLOT_TEXELS as usize;

/// Of the parent's slot, from the first texel under a block to the last.
pub(super) type Under = [[f16; 4]; (LOW - 1) * SLOT_ROW + LOW];
/// Of a slot, from the first texel of a block to the last.
pub(super) type Over = [[f16; 4]; (SIDE - 1) * SLOT_ROW + SIDE];

/// Room for a block between both directions, `[v][pair of x]`.
pub(super) type Lines<P> = [[<P as Processor>::Eight; PAIRS]; SIDE];

/// That room; what it holds does not matter.
#[inline(always)]
pub(super) fn lines<P: Processor>(processor: P) -> Lines<P> {
    [[processor.eight([0.0; 8]); PAIRS]; SIDE]
}

/// The texels of a block from those of the parent and from its own coefficients, `[u][v]`: zero but on the first `end`
/// diagonals, and zero, or of no account, where the parent's come.
#[inline(always)]
pub(super) fn texels<P: Processor>(
    processor: P,
    parent: &Under,
    own: &Block,
    end: usize,
    lines: &mut Lines<P>,
    to: &mut Over,
) {
    let zero = processor.eight([0.0; 8]);
    let own: &[[f32; 4 * SIDE]; SIDE] = bytemuck::cast_ref(own);

    // The parent along y: `[x][pair of v]`.
    let mut low = [[zero; LOW / 2]; LOW];
    for pair in 0..LOW / 2 {
        let mut halves = [[f16::ZERO; 8]; LOW];
        for (y, halves) in halves.iter_mut().enumerate() {
            let at = y * SLOT_ROW + 2 * pair;
            *halves = bytemuck::cast([parent[at], parent[at + 1]]);
        }
        let line = processor.eights(&halves);
        let line = forward_8(line);
        for v in 0..LOW / 2 {
            [low[2 * pair][v], low[2 * pair + 1][v]] = line[2 * v].exchange(line[2 * v + 1]);
        }
    }

    // Along x, there and back.
    let pairs = end.div_ceil(2).clamp(LOW / 2, PAIRS);
    for pair in 0..pairs {
        let mut line = [zero; LOW];
        if pair < LOW / 2 {
            for (value, low) in line.iter_mut().zip(&low) {
                *value = low[pair];
            }
            line = forward_8(line);
            for value in &mut line {
                // The square root of four texels for one.
                *value = *value * 2.0;
            }
        } else {
            for (u, value) in line.iter_mut().enumerate() {
                *value = processor.eight(two(&own[u], pair));
            }
        }
        // The first diagonal with a coefficient above, u = 8 and v = 2·pair, and one more.
        let columns = if end > LOW + 2 * pair {
            let mut all = [zero; SIDE];
            all[..LOW].copy_from_slice(&line);
            for (u, value) in all.iter_mut().enumerate().skip(LOW) {
                *value = processor.eight(two(&own[u], pair));
            }
            inverse_16(all)
        } else {
            inverse_16_of_8(line)
        };
        for x in 0..PAIRS {
            [lines[2 * pair][x], lines[2 * pair + 1][x]] = columns[2 * x].exchange(columns[2 * x + 1]);
        }
    }

    // Along y.
    if end > LOW {
        for line in &mut lines[2 * pairs..] {
            *line = [zero; PAIRS];
        }
    }
    for pair in 0..PAIRS {
        let rows = if end > LOW {
            let mut line = [zero; SIDE];
            for (value, from) in line.iter_mut().zip(lines.iter()) {
                *value = from[pair];
            }
            inverse_16(line)
        } else {
            let mut line = [zero; LOW];
            for (value, from) in line.iter_mut().zip(lines.iter()) {
                *value = from[pair];
            }
            inverse_16_of_8(line)
        };
        let mut texels = [zero; SIDE];
        for (texels, row) in texels.iter_mut().zip(rows) {
            *texels = row.within(HALF_MAX);
        }
        for (y, halves) in processor.all_halves(&texels).into_iter().enumerate() {
            let at = y * SLOT_ROW + 2 * pair;
            [to[at], to[at + 1]] = bytemuck::cast(halves);
        }
    }
}

/// Two neighbours in a row of coefficients.
#[inline(always)]
fn two(row: &[f32; 4 * SIDE], pair: usize) -> [f32; 8] {
    row.as_chunks().0[pair]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::pyramid_dct::dispatch::{self, Any, Work};
    use crate::codec::pyramid_dct::transform::{AREA, forward, inverse};
    use crate::codec::texel::Texel;

    struct Texels<'a> {
        parent: &'a Under,
        own: &'a Block,
        end: usize,
        to: &'a mut Over,
    }

    impl Work for Texels<'_> {
        type Output = ();
        #[inline(always)]
        fn run(self, processor: impl Processor) {
            let mut lines = lines(processor);
            // What an earlier block leaves.
            for line in lines.as_flattened_mut() {
                *line = processor.eight([f32::NAN; 8]);
            }
            texels(processor, self.parent, self.own, self.end, &mut lines, self.to);
        }
    }

    /// The transforms of blocks of any size, one after the other.
    fn wanted(parent: &Under, own: &Block) -> Block {
        let mut block = *own;
        let mut low = [Texel::default(); AREA];
        for (at, texel) in low.iter_mut().enumerate() {
            if at / SIDE < LOW && at % SIDE < LOW {
                *texel = Texel(parent[at / SIDE * SLOT_ROW + at % SIDE].map(f16::to_f32));
            }
        }
        forward(&mut low, (LOW, LOW));
        for (at, texel) in block.iter_mut().enumerate() {
            if at / SIDE < LOW && at % SIDE < LOW {
                *texel = low[at] * 2.0;
            }
        }
        inverse(&mut block, (SIDE, SIDE), SIDE);
        block
    }

    #[test]
    fn full_blocks_are_transformed_as_blocks_of_any_size() {
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        for end in 0..2 * SIDE {
            let parent: Under = std::array::from_fn(|_| [0; 4].map(|_| f16::from_f32(noise())));
            let own: Block = std::array::from_fn(|at| {
                let (u, v) = (at / SIDE, at % SIDE);
                let coded = u + v < end && (u >= LOW || v >= LOW);
                Texel([0; 4].map(|_| if coded { noise() } else { 0.0 }))
            });
            let wanted = wanted(&parent, &own);
            let mut found = [[[f16::NAN; 4]; (SIDE - 1) * SLOT_ROW + SIDE]; 2];
            let [any, best] = &mut found;
            let texels = |to| Texels {
                parent: &parent,
                own: &own,
                end,
                to,
            };
            texels(any).run(Any);
            dispatch::run(texels(best));
            for (at, wanted) in wanted.iter().enumerate() {
                let wanted = wanted.0.map(f16::from_f32);
                for found in &found {
                    assert_eq!(found[at / SIDE * SLOT_ROW + at % SIDE], wanted, "{end} {at}");
                }
            }
        }
    }
}
