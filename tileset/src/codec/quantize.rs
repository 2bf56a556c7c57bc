//! Residual to quantized coefficients, chosen for the least error at the bytes they will take, and back.
//!
//! The choice between two neighbouring levels weighs squared error against code length (rate-distortion
//! optimal quantization). It is the encoder's alone: decoders only see levels. On eigen-textures of a woven
//! cloth it saves 3, 10 and 21 % of all bytes against plain rounding at a relative error of 0.024, 0.046
//! and 0.09, and 1, 4 and 9 % against the best fixed dead zone.

use super::{
    dct::{self, BLOCK, BLOCK_AREA, Block},
    region::Region,
    symbols::{Levels, MAX_LEVEL, code_from_level},
    texel::Texel,
};
use crate::{Error, Result};

/// Squared error, in squared steps, that one bit may save: at high rates the error is step²/12 and falls to a
/// quarter with each bit, so its slope is 2·ln 2 / 12.
const ERROR_PER_BIT: f32 = std::f32::consts::LN_2 / 6.0;
/// Rounding before anything is known of the distribution.
const FIRST_ROUNDING: f32 = 0.4;
/// Codes that are told apart when code lengths are estimated; larger ones are all taken to cost the same.
const CODE_CLASSES: usize = 64;

/// Transforms and quantizes a residual, block by block, row by row. Every level is one of the two next to its
/// coefficient, so a coefficient is never off by a whole step.
///
/// # Errors
/// [`Error::Invalid`] if the step is too small for the residual.
pub(super) fn quantize(region: &Region, residual: &[Texel], step: f32) -> Result<Vec<Levels>> {
    let inverse_step = 1.0 / step;
    let mut blocks = transform(region, residual);
    let mut largest = 0f32;
    for value in blocks.iter_mut().flatten().flat_map(|texel| &mut texel.0) {
        *value *= inverse_step;
        largest = largest.max(value.abs());
    }
    if largest > MAX_LEVEL as f32 - 1.0 {
        return Err(Error::Invalid {
            what: "quantizer step".into(),
            detail: format!("{step} is too small for the values, which need {largest} steps of {MAX_LEVEL}"),
        });
    }
    let mut levels = choose(&blocks, |_, _, fraction| fraction > 1.0 - FIRST_ROUNDING);
    for _ in 0..2 {
        let bits: Vec<[f32; CODE_CLASSES]> = (0..BLOCK_AREA)
            .map(|position| code_lengths(&levels, position))
            .collect();
        let cost = |position: usize, level: i32| {
            let code = code_from_level(level) as usize;
            ERROR_PER_BIT * bits[position][code.min(CODE_CLASSES - 1)]
        };
        levels = choose(&blocks, |position, [below, above], fraction| {
            (1.0 - fraction).powi(2) + cost(position, above) < fraction.powi(2) + cost(position, below)
        });
    }
    Ok(levels)
}

/// Adds the decoded residual to the prediction, in place.
pub(super) fn reconstruct(region: &Region, texels: &mut [Texel], levels: &[Levels], step: f32) {
    let (columns, _) = region.blocks();
    for (i, levels) in levels.iter().enumerate() {
        if levels.iter().all(|level| *level == [0; 4]) {
            continue;
        }
        let (left, top) = (i % columns * BLOCK, i / columns * BLOCK);
        let mut block: Block =
            std::array::from_fn(|position| Texel(levels[position].map(|level| level as f32 * step)));
        dct::inverse(&mut block);
        let width = BLOCK.min(region.width - left);
        for (y, line) in block.chunks_exact(BLOCK).enumerate().take(region.height - top) {
            let texels = &mut texels[(top + y) * region.width + left..][..width];
            for (texel, &residual) in texels.iter_mut().zip(line) {
                *texel = *texel + residual;
            }
        }
    }
}

fn transform(region: &Region, residual: &[Texel]) -> Vec<Block> {
    let (columns, rows) = region.blocks();
    (0..columns * rows)
        .map(|i| {
            let (left, top) = (i % columns * BLOCK, i / columns * BLOCK);
            // Beyond the region its last column and row go on, which costs few coefficients.
            let mut block: Block = std::array::from_fn(|texel| {
                let x = (left + texel % BLOCK).min(region.width - 1);
                let y = (top + texel / BLOCK).min(region.height - 1);
                residual[y * region.width + x]
            });
            dct::forward(&mut block);
            block
        })
        .collect()
}

/// Quantizes coefficients, given in steps. `above` is asked for the position, the levels next to the
/// coefficient towards zero and away from it, and how far the coefficient is from the first of them.
fn choose(blocks: &[Block], above: impl Fn(usize, [i32; 2], f32) -> bool) -> Vec<Levels> {
    let level = |position: usize, value: f32| {
        let magnitude = value.abs();
        let below = magnitude.floor();
        let sign = if value < 0.0 { -1 } else { 1 };
        let levels = [below as i32 * sign, (below as i32 + 1) * sign];
        levels[usize::from(above(position, levels, magnitude - below))]
    };
    blocks
        .iter()
        .map(|block| std::array::from_fn(|position| block[position].0.map(|value| level(position, value))))
        .collect()
}

/// Estimated bits for each code at one position, from how often it is taken there in the whole page.
fn code_lengths(levels: &[Levels], position: usize) -> [f32; CODE_CLASSES] {
    // What has not occurred is still possible, the less the larger it is.
    let mut counts: [f32; CODE_CLASSES] = std::array::from_fn(|code| 0.05 + 0.5 / (1 + code * code) as f32);
    for level in levels.iter().flat_map(|block| block[position]) {
        counts[(code_from_level(level) as usize).min(CODE_CLASSES - 1)] += 1.0;
    }
    let sum: f32 = counts.iter().sum();
    counts.map(|count| (sum / count).log2())
}
