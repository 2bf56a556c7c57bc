//! Factors made more exact by what they leave out: iterative refinement.
//!
//! B·Q in f32 is off by some 1e-7 of B, and by more where many samples are equal, so that their products round the same
//! way. Where the factors leave out next to nothing that is a good part of their error. The pass that measures the rest
//! R = B − U·V gives R·Vᵀ as well, whose own rounding is that small a part of R: U·V·Qᵀ + R·Qᵀ is B·Q to the rounding of
//! one f32 number. It is decomposed once more, for orthogonal factors.
//!
//! Source: Wilkinson, Rounding Errors in Algebraic Processes, 1963, chapter 3, for linear systems; here the system is
//! that of least squares for U.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use rayon::prelude::*;

use super::gram::{gram, widen};
use super::products::Rest;
use super::ritz::{Projection, Ritz};
use crate::Result;

/// Rows multiplied at a time.
const PANEL_ROWS: usize = 1024;

/// Better factors of the same span of textures, and the squares that they leave out, by rows.
pub(super) fn refine(ritz: Ritz, rest: Rest, weights: Option<&[f32]>) -> Result<(Ritz, Vec<f64>)> {
    let Rest { mut energies, on_v } = rest;
    let (rows, components) = (energies.len(), ritz.norms.len());
    let columns = ritz.v.len() / components;
    let v = MatRef::from_column_major_slice(&ritz.v, columns, components);
    let square = gram(columns, components, |range, out| {
        widen(v.subrows(range.start, range.len()), out)
    });
    let lengths: Vec<f64> = (0..components).map(|c| square[(c, c)].sqrt()).collect();
    let Some(on_v) = on_v.filter(|_| lengths.iter().all(|&length| length > 0.0)) else {
        return Ok((ritz, energies)); // all zero
    };
    // V·Qᵀ with Q = V of unit length.
    let on_q = Mat::from_fn(components, components, |i, j| square[(i, j)] / lengths[j]);
    let q = Mat::from_fn(components, columns, |c, texel| {
        (f64::from(v[(texel, c)]) / lengths[c]) as f32
    });
    let u = MatRef::from_column_major_slice(&ritz.u, rows, components);
    let mut y = Mat::<f32>::zeros(components, rows);
    y.as_mut()
        .par_col_chunks_mut(PANEL_ROWS)
        .zip(energies.par_chunks_mut(PANEL_ROWS))
        .enumerate()
        .for_each(|(index, (mut y, energies))| {
            let first = index * PANEL_ROWS;
            let mut wide = Mat::<f64>::zeros(energies.len(), components);
            widen(u.subrows(first, energies.len()), wide.as_mut());
            let mut product = Mat::<f64>::zeros(energies.len(), components);
            matmul(product.as_mut(), Accum::Replace, &wide, &on_q, 1.0, Par::Seq);
            for (row, energy) in energies.iter_mut().enumerate() {
                for c in 0..components {
                    let rest = on_v[(c, first + row)] / lengths[c];
                    y[(c, row)] = (product[(row, c)] + rest) as f32;
                    *energy -= rest * rest;
                }
                *energy = energy.max(0.0);
            }
        });
    drop(ritz);
    let ritz = Projection::new(vec![(q.as_ref(), y.as_ref())], weights)?.ritz(components, |_| false)?;
    Ok((ritz, energies))
}
