//! From a subspace to singular values and factors: the Rayleigh-Ritz step.
//!
//! The basis Q is f32 and so orthonormal only to about 1e-6, but ‖B‖² − ‖B·Q‖² needs more. Its Gram matrix
//! QᵀQ = L·Lᵀ in f64 corrects that: Q·L⁻ᵀ is orthonormal to f64 rounding, and (B·Q)·L⁻ᵀ is the projection on it.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::basis::inverse_cholesky;
use super::gram::{gram_of, widen};
use crate::{Error, Result};

/// A singular value at most this much of the largest is rounding of the f32 products and is left out.
const RANK_TOLERANCE: f64 = 1e-6;
/// Rows multiplied at a time.
const PANEL_ROWS: usize = 1024;

/// Truncated singular value decomposition B ≈ Σ_c u_c·v_cᵀ.
pub(super) struct Ritz {
    /// Singular values, falling; at least one.
    pub(super) singular_values: Vec<f64>,
    /// Left singular vectors times √rows, `[component][row]`.
    pub(super) u: Vec<f32>,
    /// Right singular vectors times singular value / √rows, `[component][column]`.
    pub(super) v: Vec<f32>,
}

/// The best approximation of B of at most `components` terms within the span of `q`, from `y` = (B·q)ᵀ.
pub(super) fn ritz(q: MatRef<'_, f32>, y: Mat<f32>, components: usize) -> Result<Ritz> {
    let (rows, columns, width) = (y.ncols(), q.nrows(), q.ncols());
    let correction = inverse_cholesky(&gram_of(q))?;
    let projected = multiply_in_f64(y.transpose(), &correction);
    drop(y);
    let svd = projected
        .thin_svd()
        .map_err(|_| Error::NotConverged("singular value decomposition"))?;
    drop(projected);

    let all: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let threshold = all[0] * RANK_TOLERANCE;
    let kept = all
        .iter()
        .take(components)
        .take_while(|&&value| value > threshold)
        .count()
        .max(1);
    let singular_values = all[..kept].to_vec();

    let scale = (rows as f64).sqrt();
    let mut u = vec![0f32; kept * rows];
    let mut signs = vec![1.0; kept];
    for (component, u) in u.chunks_exact_mut(rows).enumerate() {
        let column = svd.U().col(component);
        // The sign of a component is free: U with a positive mean makes runs comparable.
        if column.iter().sum::<f64>() < 0.0 {
            signs[component] = -1.0;
        }
        for (out, value) in u.iter_mut().zip(column.iter()) {
            *out = (value * scale * signs[component]) as f32;
        }
    }

    let mut rotation = Mat::<f64>::zeros(width, kept);
    matmul(
        rotation.as_mut(),
        Accum::Replace,
        &correction,
        svd.V().subcols(0, kept),
        1.0,
        Par::Seq,
    );
    let rotation = Mat::from_fn(width, kept, |i, c| {
        (rotation[(i, c)] * singular_values[c] / scale * signs[c]) as f32
    });
    let mut v = vec![0f32; kept * columns];
    let out = MatMut::from_column_major_slice_mut(&mut v, columns, kept);
    out.par_row_chunks_mut(PANEL_ROWS)
        .enumerate()
        .for_each(|(index, out)| {
            let q = q.subrows(index * PANEL_ROWS, out.nrows());
            matmul(out, Accum::Replace, q, rotation.as_ref(), 1.0, Par::Seq);
        });
    Ok(Ritz {
        singular_values,
        u,
        v,
    })
}

/// Y·X in f64.
fn multiply_in_f64(y: MatRef<'_, f32>, x: &Mat<f64>) -> Mat<f64> {
    let mut product = Mat::<f64>::zeros(y.nrows(), x.ncols());
    product
        .as_mut()
        .par_row_chunks_mut(PANEL_ROWS)
        .enumerate()
        .for_each(|(index, out)| {
            let y = y.subrows(index * PANEL_ROWS, out.nrows());
            let mut wide = Mat::<f64>::zeros(y.nrows(), y.ncols());
            widen(y, wide.as_mut());
            matmul(out, Accum::Replace, wide.as_ref(), x.as_ref(), 1.0, Par::Seq);
        });
    product
}
