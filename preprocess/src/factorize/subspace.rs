//! Products of a BTF with a few vectors, one pass each: the steps of randomized subspace iteration.
//!
//! Source: Halko, Martinsson, Tropp: Finding Structure with Randomness, 2011, algorithms 4.4 and 5.1. Here an
//! iteration applies BᵀB block by block, Z = Σ Bᵢᵀ(Bᵢ·Q), so that the matrix is read once for two products.
//!
//! The products are split into panels of texels, each a product on one thread: faer's own threads wait for each
//! other by spinning, which costs a factor of ten on a machine that does something else as well.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::stream::Stream;
use crate::Result;
use crate::progress::Phase;

/// Texels in a panel: enough to make a product worth its packing.
const MIN_PANEL_TEXELS: usize = 2048;
/// Bounds the memory of the partial products B·Q.
const MAX_PANELS: usize = 64;

/// BᵀB·Q, in one pass.
///
/// Products and sums are f32: an error in Z only turns the next subspace a little, and what a subspace leaves
/// out is measured later, exactly.
pub(super) fn power_iteration(stream: &mut Stream<'_>, number: u32, q: &Mat<f32>) -> Result<Mat<f32>> {
    let mut z = Mat::<f32>::zeros(q.nrows(), q.ncols());
    let panel = panel_texels(q.nrows());
    stream.pass(Phase::PowerIteration(number), |_, block| {
        let block = block.as_ref();
        let y = product(block, q);
        z.as_mut()
            .par_row_chunks_mut(panel)
            .enumerate()
            .for_each(|(index, z)| {
                let block = block.subcols(index * panel, z.nrows());
                matmul(z, Accum::Add, block.transpose(), y.as_ref(), 1.0, Par::Seq);
            });
    })?;
    stream.count_products(2, q.ncols());
    Ok(z)
}

/// B·Q, in one pass.
pub(super) fn project(stream: &mut Stream<'_>, q: &Mat<f32>) -> Result<Mat<f32>> {
    let mut y = Mat::<f32>::zeros(stream.rows(), q.ncols());
    stream.pass(Phase::Projection, |rows, block| {
        y.as_mut()
            .subrows_mut(rows.start, rows.len())
            .copy_from(product(block.as_ref(), q));
    })?;
    stream.count_products(1, q.ncols());
    Ok(y)
}

/// Bᵢ − Uᵢ·V, in place; `v` is row-major.
pub(super) fn subtract_product(block: MatMut<'_, f32>, u: MatRef<'_, f32>, v: MatRef<'_, f32>) {
    let panel = panel_texels(v.ncols());
    block
        .par_col_chunks_mut(panel)
        .enumerate()
        .for_each(|(index, block)| {
            let v = v.subcols(index * panel, block.ncols());
            matmul(block, Accum::Add, u, v, -1.0, Par::Seq);
        });
}

/// Bᵢ·Q: panels summed in order, so that the result does not depend on the number of threads.
fn product(block: MatRef<'_, f32>, q: &Mat<f32>) -> Mat<f32> {
    let panel = panel_texels(q.nrows());
    let ranges: Vec<Range<usize>> = (0..q.nrows())
        .step_by(panel)
        .map(|start| start..(start + panel).min(q.nrows()))
        .collect();
    let parts: Vec<Mat<f32>> = ranges
        .into_par_iter()
        .map(|range| {
            let mut part = Mat::<f32>::zeros(block.nrows(), q.ncols());
            let block = block.subcols(range.start, range.len());
            let q = q.as_ref().subrows(range.start, range.len());
            matmul(part.as_mut(), Accum::Replace, block, q, 1.0, Par::Seq);
            part
        })
        .collect();
    parts
        .into_iter()
        .reduce(|sum, part| sum + part)
        .unwrap_or_else(|| Mat::zeros(block.nrows(), q.ncols()))
}

fn panel_texels(texels: usize) -> usize {
    texels.div_ceil(MAX_PANELS).max(MIN_PANEL_TEXELS)
}
