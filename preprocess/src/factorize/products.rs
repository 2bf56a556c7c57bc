//! Products of a block of samples with a few vectors.
//!
//! The products are split into panels of texels, each a product on one thread: faer's own threads wait for each
//! other by spinning, which costs a factor of ten on a machine that does something else as well. B·Q runs
//! fastest where Q and the product are row-major, BᵀY where Z is column-major (110 against 85 and 60 GFLOP/s a
//! core), so that is how they are stored.
//!
//! Products are f32, and so are the sums of Z: an error in Z only turns the next subspace a little, and what a subspace
//! leaves out is measured later, exactly. B·Q goes into the result, and its sums are f64 but for short pieces.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::stream::{Block, PANEL_ROWS, Stream, Totals, task_texels};
use crate::Result;
use crate::progress::Phase;

/// Nonzero entries in each row of a sparse sketch: Nelson and Nguyên need a few, one would be CountSketch.
const SKETCH_ENTRIES: usize = 4;
/// A sketch of fewer rows for each of its vectors than this is dense: sparse rows would collide.
const DENSE_ROWS: usize = 32;
/// Terms of a sum in f32, before it goes on in f64. Sums of equal terms, as a constant material has, round the same way
/// again and again, by 2⁻²⁶ of the sum a term at worst: 4e-6. 128 would halve that, but cost a seventh of the speed;
/// [`super::refine`] mends it where it counts.
const SUM_TEXELS: usize = 256;

/// (Bᵢ·Q)ᵀ.
pub(super) fn forward(block: &Block<'_>, q: MatRef<'_, f32>) -> Mat<f32> {
    let parts = block.tasks(|range| {
        let mut sums = Mat::<f64>::zeros(q.ncols(), block.rows.len());
        let mut scratch = Mat::zeros(q.ncols(), block.rows.len().min(PANEL_ROWS));
        block.panels(range, |row, start, panel| {
            let q = q.subrows(start, panel.ncols());
            let sums = sums.as_mut().subcols_mut(row, panel.nrows());
            add_product(panel.as_ref(), q, scratch.as_mut(), sums);
        });
        sums
    });
    let sum = parts.into_iter().reduce(|a, b| a + b);
    let sum = sum.unwrap_or_else(|| Mat::zeros(q.ncols(), block.rows.len()));
    Mat::from_fn(sum.nrows(), sum.ncols(), |i, j| sum[(i, j)] as f32)
}

/// Sums += (panel·Q)ᵀ, in f64 but for [`SUM_TEXELS`] terms each; `scratch` has a column for each row of the panel or
/// more.
fn add_product(
    panel: MatRef<'_, f32>,
    q: MatRef<'_, f32>,
    scratch: MatMut<'_, f32>,
    mut sums: MatMut<'_, f64>,
) {
    let mut part = scratch.subcols_mut(0, panel.nrows());
    for start in (0..panel.ncols()).step_by(SUM_TEXELS) {
        let count = SUM_TEXELS.min(panel.ncols() - start);
        let (panel, q) = (panel.subcols(start, count), q.subrows(start, count));
        matmul(
            part.as_mut().transpose_mut(),
            Accum::Replace,
            panel,
            q,
            1.0,
            Par::Seq,
        );
        for (mut sums, part) in sums.as_mut().col_iter_mut().zip(part.as_ref().col_iter()) {
            let part = part.try_as_col_major().map_or(&[][..], |part| part.as_slice());
            let sums = sums.as_mut().try_as_col_major_mut();
            let sums = sums.map_or(&mut [][..], |sums| sums.as_slice_mut());
            for (sum, &part) in sums.iter_mut().zip(part) {
                *sum += f64::from(part);
            }
        }
    }
}

/// Z += Bᵢᵀ·Y, for `y` = Yᵀ.
pub(super) fn backward(block: &Block<'_>, y: MatRef<'_, f32>, z: MatMut<'_, f32>) {
    let task_texels = task_texels(z.nrows());
    z.par_row_chunks_mut(task_texels)
        .enumerate()
        .for_each(|(task, mut z)| {
            let first = task * task_texels;
            block.panels(first..first + z.nrows(), |row, start, panel| {
                let z = z.as_mut().subrows_mut(start - first, panel.ncols());
                let y = y.subcols(row, panel.nrows()).transpose();
                matmul(z, Accum::Add, panel.as_ref().transpose(), y, 1.0, Par::Seq);
            });
        });
}

/// Z += Bᵢᵀ·D·S for a random S, dense or of a few signs in each row, and the sums over the block, which is one of `rows` rows in all.
pub(super) fn sketch(
    block: &Block<'_>,
    rows: usize,
    seed: u64,
    weights: Option<&[f32]>,
    z: MatMut<'_, f32>,
) -> Totals {
    let width = z.ncols();
    let scale = |row: usize| weights.map_or(1.0, |weights| weights[row].sqrt());
    let dense = is_dense(rows, width).then(|| {
        Mat::from_fn(width, block.rows.len(), |vector, row| {
            let row = block.rows.start + row;
            // Uniform numbers: small square matrices of mere signs are singular too often.
            let bits = hash(seed, row as u64, vector as u64);
            scale(row) * ((bits >> 32) as i32) as f32 * 0.5f32.powi(31)
        })
    });
    let task_texels = task_texels(z.nrows());
    let mut totals = Vec::new();
    z.par_row_chunks_mut(task_texels)
        .enumerate()
        .map(|(task, mut z)| {
            let first = task * task_texels;
            let mut totals = block.no_totals();
            block.panels(first..first + z.nrows(), |first_row, start, mut panel| {
                let mut z = z.as_mut().subrows_mut(start - first, panel.ncols());
                block.add_totals(first_row, panel.as_mut(), &mut totals);
                if let Some(signs) = &dense {
                    let signs = signs.as_ref().subcols(first_row, panel.nrows()).transpose();
                    matmul(z, Accum::Add, panel.as_ref().transpose(), signs, 1.0, Par::Seq);
                    return;
                }
                for (index, samples) in panel.as_ref().row_iter().enumerate() {
                    let row = block.rows.start + first_row + index;
                    let samples = samples.try_as_row_major().map_or(&[][..], |row| row.as_slice());
                    for entry in 0..SKETCH_ENTRIES {
                        let bits = hash(seed, row as u64, entry as u64);
                        let sign = scale(row) * if bits & 1 == 0 { 1.0 } else { -1.0 };
                        let vector = (((bits >> 32) * width as u64) >> 32) as usize;
                        let sum = z.as_mut().col_mut(vector).try_as_col_major_mut();
                        let sum = sum.map_or(&mut [][..], |sum| sum.as_slice_mut());
                        for (sum, sample) in sum.iter_mut().zip(samples) {
                            *sum += sign * sample;
                        }
                    }
                }
            });
            totals
        })
        .collect_into_vec(&mut totals);
    block.sum_of(&totals)
}

/// How many vectors a sketch of this size multiplies each row with.
pub(super) fn sketch_terms(rows: usize, width: usize) -> usize {
    if is_dense(rows, width) {
        width
    } else {
        SKETCH_ENTRIES
    }
}

fn is_dense(rows: usize, width: usize) -> bool {
    rows < DENSE_ROWS * width
}

/// What a product leaves out of B.
pub(super) struct Rest {
    /// ‖B − U·V‖² by rows.
    pub(super) energies: Vec<f64>,
    /// ((B − U·V)·Vᵀ)ᵀ, `[vector][row]`, where it was asked for.
    pub(super) on_v: Option<Mat<f64>>,
}

/// B − U·V for `u` of a row per row of B and `v` of a column per texel, in one pass; with its product with V as well if
/// `on_v`.
pub(super) fn residual(
    stream: &mut Stream<'_>,
    u: MatRef<'_, f32>,
    v: MatRef<'_, f32>,
    on_v: bool,
) -> Result<Rest> {
    let width = if on_v { v.nrows() } else { 0 };
    let mut rest = Rest {
        energies: Vec::with_capacity(u.nrows()),
        on_v: on_v.then(|| Mat::zeros(width, u.nrows())),
    };
    stream.pass(Phase::Residual, 0, |block| {
        let u = u.subrows(block.rows.start, block.rows.len());
        let parts = block.tasks(|range| {
            let mut totals = block.no_totals();
            let mut sums = Mat::<f64>::zeros(width, block.rows.len());
            let mut scratch = Mat::zeros(width, block.rows.len().min(PANEL_ROWS));
            block.panels(range, |row, start, mut panel| {
                let u = u.subrows(row, panel.nrows());
                let v = v.subcols(start, panel.ncols());
                matmul(panel.as_mut(), Accum::Add, u, v, -1.0, Par::Seq);
                if on_v {
                    let sums = sums.as_mut().subcols_mut(row, panel.nrows());
                    add_product(panel.as_ref(), v.transpose(), scratch.as_mut(), sums);
                }
                block.add_totals(row, panel, &mut totals);
            });
            (totals, sums)
        });
        rest.energies
            .extend(block.sum_of(parts.iter().map(|(totals, _)| totals)).energies);
        if let Some(on_v) = &mut rest.on_v {
            for (_, sums) in &parts {
                let mut on_v = on_v.as_mut().subcols_mut(block.rows.start, block.rows.len());
                on_v += sums;
            }
        }
        Ok(())
    })?;
    stream.count_products(u.ncols() + width);
    Ok(rest)
}

/// Random bits that depend on nothing but these numbers (Steele, Lea, Flood: SplitMix, 2014, `mix64`).
fn hash(seed: u64, row: u64, entry: u64) -> u64 {
    let mut bits = seed
        .wrapping_add(row.wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add(entry.wrapping_mul(0xd1b5_4a32_d192_ed03));
    for _ in 0..2 {
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^= bits >> 31;
    }
    bits
}
