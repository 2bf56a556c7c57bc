//! Factors from a single pass, for input that is slow or impossible to read again.
//!
//! The pass takes two random products: Z = BᵀS, whose orthonormal basis is P, and B·Ω for more test vectors Ω. As
//! B ≈ X·Pᵀ, also B·Ω ≈ X·(PᵀΩ), which gives X by least squares. The basis was never sharpened, so the error is larger
//! than that of four passes, by up to a factor of two where the spectrum falls slowly; and it can only be estimated, with test
//! vectors that took no part in the solution: the mean of ‖(B − U·V)ω‖² over random ω is ‖B − U·V‖² times the variance of
//! ω's entries. What X misses of B·P is not orthogonal to the textures, so that what coding loses does not quite add to
//! it: a coarse quantizer even removes some of it. A ledger that must hold to a percent takes two passes or more.
//!
//! Sources: Tropp, Yurtsever, Udell, Cevher: Practical Sketching Algorithms for Low-Rank Matrix Approximation, 2017,
//! algorithm 4 and section 4.5 (sizes); the estimate: the same: Streaming Low-Rank Matrix Approximation with an
//! Application to Scientific Simulation, 2019, section 6.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

use super::basis::{cross, inverse_cholesky, orthonormal_rows, random_matrix};
use super::krylov::{Pass, Projected, State, Step};
use super::stream::Totals;
use crate::Result;

/// Test vectors that only the estimate of the error sees: its own error is about 1/√(2·32) of it or less.
const PROBES: usize = 32;
/// Rows multiplied at a time.
const PANEL_ROWS: usize = 1024;

/// All test vectors for a basis of `width`: twice as many as the basis has, and one.
pub(super) fn tests(width: usize) -> usize {
    2 * width + 1 + PROBES
}

/// Before the pass.
pub(super) fn start(rows: usize, columns: usize, width: usize, seed: u64) -> State {
    let tests = tests(width);
    State {
        blocks: Vec::new(),
        pass: Pass {
            step: Step::Once,
            next_row: 0,
            q: random_matrix(tests, columns, !seed),
            y: Mat::zeros(tests, rows),
            z: Mat::zeros(columns, width),
        },
        totals: Totals::default(),
        passes: 0,
        exponent: 0,
    }
}

/// What is left to estimate the error with.
pub(super) struct Probe {
    /// Test vectors, transposed, and their products with B, transposed.
    omega: Mat<f32>,
    y: Mat<f32>,
}

/// Solves for the projection on the basis, after the pass; and keeps the test vectors of the estimate.
pub(super) fn solve(pass: &mut Pass, seed: u64) -> Result<(Projected, Probe)> {
    let [omega, y, z] =
        [&mut pass.q, &mut pass.y, &mut pass.z].map(|matrix| std::mem::replace(matrix, Mat::new()));
    let q = orthonormal_rows(z, seed)?;
    let solving = omega.nrows() - PROBES;
    let seen = cross(q.as_ref(), omega.as_ref().subrows(0, solving).transpose());
    // X = Y·Mᵀ·(M·Mᵀ)⁻¹ with M = PᵀΩ, which is wide and well-conditioned.
    let factor = inverse_cholesky(&(&seen * seen.transpose()))?;
    let solution = &factor * (factor.transpose() * &seen);
    let solution = Mat::<f32>::from_fn(solution.nrows(), solution.ncols(), |i, j| solution[(i, j)] as f32);
    let mut x = Mat::<f32>::zeros(q.nrows(), y.ncols());
    x.as_mut()
        .par_col_chunks_mut(PANEL_ROWS)
        .enumerate()
        .for_each(|(index, x)| {
            let y = y.as_ref().submatrix(0, index * PANEL_ROWS, solving, x.ncols());
            matmul(x, Accum::Replace, solution.as_ref(), y, 1.0, Par::Seq);
        });
    let probe = Probe {
        omega: omega.as_ref().subrows(solving, PROBES).to_owned(),
        y: y.as_ref().subrows(solving, PROBES).to_owned(),
    };
    Ok((Projected { q, y: x }, probe))
}

impl Probe {
    /// Estimates of the squares that `u`·`v` leaves out of each row; `u` `[component][row]`, `v` `[component][texel]`.
    pub(super) fn left_out(&self, u: &[f32], v: &[f32]) -> Vec<f64> {
        let (rows, columns) = (self.y.ncols(), self.omega.ncols());
        let components = u.len() / rows;
        let v = MatRef::from_row_major_slice(v, components, columns);
        let seen = cross(v, self.omega.transpose());
        // Entries of the test vectors have the variance 1/columns, or that of a longer side.
        let scale = columns.max(PROBES) as f64 / PROBES as f64;
        (0..rows)
            .into_par_iter()
            .map(|row| {
                let left = |probe: usize| {
                    let product: f64 = (0..components)
                        .map(|c| f64::from(u[c * rows + row]) * seen[(c, probe)])
                        .sum();
                    (f64::from(self.y[(probe, row)]) - product).powi(2)
                };
                (0..PROBES).map(left).sum::<f64>() * scale
            })
            .collect()
    }
}
