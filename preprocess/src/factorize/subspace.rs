//! Products of a BTF with a few vectors, one pass each: the steps of randomized subspace iteration.
//!
//! Source: Halko, Martinsson, Tropp: Finding Structure with Randomness, 2011, algorithms 4.4 and 5.1. Here an
//! iteration applies BᵀB block by block, Z = Σ Bᵢᵀ(Bᵢ·Q), so that the matrix is read once for two products.
//!
//! The products are split into panels of texels, each a product on one thread: faer's own threads wait for each
//! other by spinning, which costs a factor of ten on a machine that does something else as well. B·Q runs
//! fastest where Q and the product are row-major, BᵀY where Z is column-major (110 against 85 and 60 GFLOP/s a
//! core), so that is how they are stored.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

use super::stream::{Block, Stream, Totals, task_texels};
use crate::Result;
use crate::progress::Phase;

/// BᵀB·Q, in one pass.
///
/// Products and sums are f32: an error in Z only turns the next subspace a little, and what a subspace leaves
/// out is measured later, exactly.
pub(super) fn power_iteration(stream: &mut Stream<'_>, number: u32, q: MatRef<'_, f32>) -> Result<Mat<f32>> {
    let mut z = Mat::<f32>::zeros(q.nrows(), q.ncols());
    let task_texels = task_texels(q.nrows());
    stream.pass(Phase::PowerIteration(number), |block| {
        let (y, totals) = product(block, q);
        z.as_mut()
            .par_row_chunks_mut(task_texels)
            .enumerate()
            .for_each(|(task, mut z)| {
                let first = task * task_texels;
                block.panels(first..first + z.nrows(), |row, start, panel| {
                    let z = z.as_mut().subrows_mut(start - first, panel.ncols());
                    let y = y.as_ref().subcols(row, panel.nrows()).transpose();
                    matmul(z, Accum::Add, panel.as_ref().transpose(), y, 1.0, Par::Seq);
                });
            });
        totals
    })?;
    stream.count_products(2, q.ncols());
    Ok(z)
}

/// (B·Q)ᵀ, in one pass.
pub(super) fn project(stream: &mut Stream<'_>, q: MatRef<'_, f32>) -> Result<Mat<f32>> {
    let mut projected = Mat::<f32>::zeros(q.ncols(), stream.rows());
    stream.pass(Phase::Projection, |block| {
        let (y, totals) = product(block, q);
        projected
            .as_mut()
            .subcols_mut(block.rows.start, block.rows.len())
            .copy_from(y);
        totals
    })?;
    stream.count_products(1, q.ncols());
    Ok(projected)
}

/// ‖B − U·V‖² for `u` of a row per row of B and `v` of a column per texel, in one pass.
pub(super) fn residual(stream: &mut Stream<'_>, u: MatRef<'_, f32>, v: MatRef<'_, f32>) -> Result<f64> {
    let mut energy = 0.0;
    stream.pass(Phase::Residual, |block| {
        let u = u.subrows(block.rows.start, block.rows.len());
        let parts = block.tasks(|range| {
            let mut energy = 0.0;
            block.panels(range, |row, start, mut panel| {
                let u = u.subrows(row, panel.nrows());
                let v = v.subcols(start, panel.ncols());
                matmul(panel.as_mut(), Accum::Add, u, v, -1.0, Par::Seq);
                energy += block.totals(row, panel).energy;
            });
            energy
        });
        energy += parts.iter().sum::<f64>();
        Totals::default()
    })?;
    stream.count_products(1, u.ncols());
    Ok(energy)
}

/// (Bᵢ·Q)ᵀ, and the sums over the block if it is there for the first time.
fn product(block: &Block<'_>, q: MatRef<'_, f32>) -> (Mat<f32>, Totals) {
    let parts = block.tasks(|range| {
        let mut part = Mat::<f32>::zeros(q.ncols(), block.rows.len());
        let mut totals = Totals::default();
        block.panels(range, |row, start, mut panel| {
            let q = q.subrows(start, panel.ncols());
            let part = part.as_mut().subcols_mut(row, panel.nrows()).transpose_mut();
            matmul(part, Accum::Add, panel.as_ref(), q, 1.0, Par::Seq);
            if block.first_time {
                totals.add(block.totals(row, panel.as_mut()));
            }
        });
        (part, totals)
    });
    let mut sum = (Mat::zeros(q.ncols(), block.rows.len()), Totals::default());
    for (part, totals) in parts {
        sum.0 += part;
        sum.1.add(totals);
    }
    sum
}
