//! From a subspace to singular values and factors: the Rayleigh-Ritz step.
//!
//! The basis Q is f32 and so orthonormal only to about 1e-6, but ‖B‖² − ‖B·Q‖² needs more. Its Gram matrix
//! QᵀQ = L·Lᵀ in f64 corrects that: Q·L⁻ᵀ is orthonormal to f64 rounding, and (B·Q)·L⁻ᵀ is the projection P on it.
//! The decomposition is that of PᵀP, which is small and in f64, wherever that resolves all terms that are kept.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};
use rayon::prelude::*;

use super::basis::inverse_cholesky;
use super::factors::square_sum;
use super::gram::{gram, widen};
use crate::{Error, Result};

/// A singular value at most this much of the largest is rounding of the f32 products and is left out.
pub(super) const RANK_TOLERANCE: f64 = 1e-6;
/// Where a term that is kept is smaller than this share of the first, its square in PᵀP has too little left of the
/// 1e-16 of f64 for orthogonal eigen-ABRDFs, and P itself is decomposed.
const SQUARE_TOLERANCE: f64 = 1e-4;
/// Rows multiplied at a time.
const PANEL_ROWS: usize = 1024;

/// The projection of D·B on the blocks of a subspace, as a small matrix.
pub(super) struct Projection<'a> {
    /// Qᵢᵀ and (B·Qᵢ)ᵀ.
    blocks: Vec<(MatRef<'a, f32>, MatRef<'a, f32>)>,
    weights: Option<&'a [f32]>,
    /// L⁻ᵀ.
    correction: Mat<f64>,
    /// PᵀP of the projection P = D·B·Q·L⁻ᵀ.
    square: Mat<f64>,
}

/// The terms of B ≈ Σ_c u_c·v_cᵀ within a subspace.
pub(super) struct Ritz {
    /// Norms of the terms.
    pub(super) norms: Vec<f64>,
    /// Singular values of the projection of D·B, falling; at least one.
    pub(super) singular_values: Vec<f64>,
    /// The sum of the squares of the other singular values of the projection.
    pub(super) cut_energy: f64,
    /// u scaled to unit root mean square, `[component][row]`.
    pub(super) u: Vec<f32>,
    /// v scaled by its norm / √rows, `[component][column]`.
    pub(super) v: Vec<f32>,
}

impl<'a> Projection<'a> {
    /// Of at least one block.
    pub(super) fn new(
        blocks: Vec<(MatRef<'a, f32>, MatRef<'a, f32>)>,
        weights: Option<&'a [f32]>,
    ) -> Result<Self> {
        let width = blocks.iter().map(|(q, _)| q.nrows()).sum();
        let (rows, columns) = (blocks[0].1.ncols(), blocks[0].0.ncols());
        let correction = inverse_cholesky(&gram(columns, width, |range, mut out| {
            let mut first = 0;
            for (q, _) in &blocks {
                let q = q.subcols(range.start, range.len()).transpose();
                widen(q, out.as_mut().subcols_mut(first, q.ncols()));
                first += q.ncols();
            }
        }))?;
        let mut projection = Self {
            blocks,
            weights,
            correction,
            square: Mat::new(),
        };
        let square = gram(rows, width, |range, out| projection.fill(range.start, out, true));
        projection.square = projection.correction.transpose() * square * &projection.correction;
        Ok(projection)
    }

    /// Vectors of the subspace.
    pub(super) fn width(&self) -> usize {
        self.square.nrows()
    }

    /// Writes rows of B·Q, or of D·B·Q, in f64.
    fn fill(&self, first_row: usize, mut out: MatMut<'_, f64>, weighted: bool) {
        let mut first = 0;
        for (_, y) in &self.blocks {
            let y = y.subcols(first_row, out.nrows()).transpose();
            widen(y, out.as_mut().subcols_mut(first, y.ncols()));
            first += y.ncols();
        }
        if let (Some(weights), true) = (self.weights, weighted) {
            for (row, &weight) in out.row_iter_mut().zip(&weights[first_row..]) {
                let scale = f64::from(weight).sqrt();
                row.iter_mut().for_each(|value| *value *= scale);
            }
        }
    }

    /// The best approximation of D·B of at most `components` terms within the subspace, unscaled by D⁻¹; no more terms
    /// than leave out `enough` of ‖D·B‖² or less.
    pub(super) fn ritz(&self, components: usize, enough: impl Fn(f64) -> bool) -> Result<Ritz> {
        let (mut values, mut vectors) = self.decompose_square()?;
        let mut kept = count(&values, components, &enough);
        if values[kept - 1] < SQUARE_TOLERANCE * values[0] {
            (values, vectors) = self.decompose()?;
            kept = count(&values, components, &enough);
        }
        let cut_energy = square_sum(&values[kept..]);
        values.truncate(kept);
        let mut rotation = Mat::<f64>::zeros(self.width(), kept);
        let vectors = vectors.as_ref().subcols(0, kept);
        matmul(
            rotation.as_mut(),
            Accum::Replace,
            &self.correction,
            vectors,
            1.0,
            Par::Seq,
        );
        let (u, norms, signs) = self.left(&rotation);
        let scale = (self.rows() as f64).sqrt();
        let rotation = Mat::from_fn(rotation.nrows(), kept, |i, c| {
            rotation[(i, c)] * norms[c] / scale * signs[c]
        });
        let v = self.right(&rotation);
        Ok(Ritz {
            norms,
            singular_values: values,
            cut_energy,
            u,
            v,
        })
    }

    fn rows(&self) -> usize {
        self.blocks[0].1.ncols()
    }

    /// Singular values, falling, of the projection on the first `width` vectors, from PᵀP: the correction is triangular,
    /// so that this is the projection that a subspace of no more vectors would have.
    pub(super) fn values(&self, width: usize) -> Result<Vec<f64>> {
        let square = self.square.as_ref().submatrix(0, 0, width, width);
        let squares = square
            .self_adjoint_eigenvalues(Side::Lower)
            .map_err(|_| Error::NotConverged("eigenvalues"))?;
        Ok(squares.iter().rev().map(|value| value.max(0.0).sqrt()).collect())
    }

    /// Singular values, falling, and right singular vectors of P, from PᵀP.
    fn decompose_square(&self) -> Result<(Vec<f64>, Mat<f64>)> {
        let eigen = self
            .square
            .self_adjoint_eigen(Side::Lower)
            .map_err(|_| Error::NotConverged("eigenvalues"))?;
        let width = self.width();
        let values = eigen
            .S()
            .column_vector()
            .iter()
            .rev()
            .map(|value| value.max(0.0).sqrt());
        let vectors = Mat::from_fn(width, width, |i, j| eigen.U()[(i, width - 1 - j)]);
        Ok((values.collect(), vectors))
    }

    /// The same from P itself, which takes its memory in f64 three times.
    fn decompose(&self) -> Result<(Vec<f64>, Mat<f64>)> {
        let mut projected = Mat::<f64>::zeros(self.rows(), self.width());
        self.by_panels(projected.as_mut(), &self.correction, true);
        let svd = projected
            .thin_svd()
            .map_err(|_| Error::NotConverged("singular value decomposition"))?;
        let values = svd.S().column_vector().iter().copied().collect();
        Ok((values, svd.V().to_owned()))
    }

    /// B·Q·X, or D·B·Q·X.
    fn by_panels(&self, out: MatMut<'_, f64>, x: &Mat<f64>, weighted: bool) {
        out.par_row_chunks_mut(PANEL_ROWS)
            .enumerate()
            .for_each(|(index, out)| {
                let mut wide = Mat::<f64>::zeros(out.nrows(), self.width());
                self.fill(index * PANEL_ROWS, wide.as_mut(), weighted);
                matmul(out, Accum::Replace, wide.as_ref(), x.as_ref(), 1.0, Par::Seq);
            });
    }

    /// Eigen-ABRDFs of unit root mean square and of positive mean, the norms they had, and the signs they got: the sign
    /// of a component is free, and this choice makes runs comparable.
    fn left(&self, rotation: &Mat<f64>) -> (Vec<f32>, Vec<f64>, Vec<f64>) {
        let (rows, kept) = (self.rows(), rotation.ncols());
        let mut product = Mat::<f64>::zeros(rows, kept);
        self.by_panels(product.as_mut(), rotation, false);
        let mut u = vec![0f32; kept * rows];
        let (norms, signs) = u
            .par_chunks_exact_mut(rows)
            .enumerate()
            .map(|(component, u)| {
                let column = product.col(component);
                let norm = column.iter().map(|value| value * value).sum::<f64>().sqrt();
                let sign = if column.iter().sum::<f64>() < 0.0 {
                    -1.0
                } else {
                    1.0
                };
                let scale = if norm > 0.0 {
                    sign * (rows as f64).sqrt() / norm
                } else {
                    0.0
                };
                for (out, value) in u.iter_mut().zip(column.iter()) {
                    *out = (value * scale) as f32;
                }
                (norm, sign)
            })
            .unzip();
        (u, norms, signs)
    }

    /// (Q·X)ᵀ, `[column of X][texel]`; in f64, for a texel is rounded once only.
    fn right(&self, rotation: &Mat<f64>) -> Vec<f32> {
        let (columns, kept) = (self.blocks[0].0.ncols(), rotation.ncols());
        let mut v = vec![0f32; kept * columns];
        let out = MatMut::from_column_major_slice_mut(&mut v, columns, kept);
        out.par_row_chunks_mut(PANEL_ROWS)
            .enumerate()
            .for_each(|(index, mut out)| {
                let mut wide = Mat::<f64>::zeros(out.nrows(), self.width());
                let mut first = 0;
                for (q, _) in &self.blocks {
                    let q = q.subcols(index * PANEL_ROWS, out.nrows()).transpose();
                    widen(q, wide.as_mut().subcols_mut(first, q.ncols()));
                    first += q.ncols();
                }
                let mut product = Mat::<f64>::zeros(out.nrows(), kept);
                matmul(product.as_mut(), Accum::Replace, &wide, rotation, 1.0, Par::Seq);
                for (out, product) in out.as_mut().col_iter_mut().zip(product.col_iter()) {
                    for (out, product) in out.iter_mut().zip(product.iter()) {
                        *out = *product as f32;
                    }
                }
            });
        v
    }
}

/// How many terms are kept, given what each number of them captures.
fn count(values: &[f64], components: usize, enough: impl Fn(f64) -> bool) -> usize {
    let threshold = values[0] * RANK_TOLERANCE;
    let mut captured = 0.0;
    let mut kept = 0;
    for &value in values
        .iter()
        .take(components)
        .take_while(|&&value| value > threshold)
    {
        captured += value * value;
        kept += 1;
        if enough(captured) {
            break;
        }
    }
    kept.max(1)
}
