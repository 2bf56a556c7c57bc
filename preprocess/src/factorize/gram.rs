//! Gram matrices of tall f32 matrices in f64, block by block on all threads.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

/// Rows converted to f64 at a time: few enough to stay in the cache.
const BLOCK_ROWS: usize = 512;
/// Tasks at most, and bytes of all their sums.
const MAX_TASKS: usize = 32;
const SUM_BYTES: usize = 64 << 20;

/// XᵀX for the `rows` × `columns` matrix X, which `fill` writes piece by piece: it gets a range of rows and a
/// matrix of that many rows. Summed in an order that does not depend on the number of threads.
pub(crate) fn gram(
    rows: usize,
    columns: usize,
    fill: impl Fn(Range<usize>, MatMut<'_, f64>) + Sync,
) -> Mat<f64> {
    let tasks = (SUM_BYTES / (8 * columns * columns).max(1)).clamp(2, MAX_TASKS);
    let task_rows = rows.div_ceil(tasks).next_multiple_of(BLOCK_ROWS);
    let sums: Vec<Mat<f64>> = (0..rows.div_ceil(task_rows))
        .into_par_iter()
        .map(|task| {
            let mut sum = Mat::<f64>::zeros(columns, columns);
            let mut block = Mat::<f64>::zeros(BLOCK_ROWS.min(rows), columns);
            let range = task * task_rows..rows.min((task + 1) * task_rows);
            for start in range.clone().step_by(BLOCK_ROWS) {
                let end = range.end.min(start + BLOCK_ROWS);
                let mut block = block.as_mut().subrows_mut(0, end - start);
                fill(start..end, block.as_mut());
                matmul(
                    sum.as_mut(),
                    Accum::Add,
                    block.as_ref().transpose(),
                    block.as_ref(),
                    1.0,
                    Par::Seq,
                );
            }
            sum
        })
        .collect();
    sums.into_iter()
        .reduce(|a, b| a + b)
        .unwrap_or_else(|| Mat::zeros(columns, columns))
}

/// XᵀX of an f32 matrix.
pub(crate) fn gram_of(x: MatRef<'_, f32>) -> Mat<f64> {
    gram(x.nrows(), x.ncols(), |rows, out| {
        widen(x.subrows(rows.start, rows.len()), out)
    })
}

/// Copies f32 to f64.
pub(crate) fn widen(from: MatRef<'_, f32>, mut to: MatMut<'_, f64>) {
    for column in 0..from.ncols() {
        for (to, &from) in to
            .as_mut()
            .col_mut(column)
            .iter_mut()
            .zip(from.col(column).iter())
        {
            *to = from.into();
        }
    }
}
