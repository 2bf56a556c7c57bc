//! A subspace that grows by blocks, and the passes that grow it: randomized block Krylov iteration.
//!
//! The first pass is a sketch: Q₁ spans BᵀS for a sparse random S, which costs hardly more than reading. Each further
//! pass multiplies with the last block only, Yᵢ = B·Qᵢ and Z = Bᵀ·Yᵢ; what Z adds to the span of the blocks so far is
//! the next block. All blocks together hold the spans of BᵀS, (BᵀB)BᵀS, …: more than a subspace iteration that throws
//! away all but the last, for the same products.
//!
//! Sources: Musco, Musco: Randomized Block Krylov Methods for Stronger and Faster Approximate Singular Value
//! Decomposition, 2015, algorithm 2; the sparse sketch: Nelson, Nguyên: OSNAP, 2013. All blocks are orthogonalized
//! against each other, twice: in f32 the short recurrences of Lanczos do not hold.

use faer::{Mat, MatMut};

use super::basis::{orthonormal_rows, remove_span};
use super::products;
use super::stream::{Stream, Totals};
use crate::Result;
use crate::progress::Phase;

/// A finished block.
pub(super) struct Projected {
    /// Qᵢᵀ, orthonormal rows, `[vector][texel]`, a vector's texels a stride apart.
    pub(super) q: Mat<f32>,
    /// (B·Qᵢ)ᵀ.
    pub(super) y: Mat<f32>,
}

/// What a pass does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Z = BᵀD·S, and the sums over all samples.
    Sketch,
    /// Y = B·Q and Z = BᵀD²·Y.
    Both,
    /// Y = B·Q.
    Project,
    /// The sketch, and Y = B·Q for test vectors Q: see `once`.
    Once,
}

/// A pass: what it needs and what it sums up.
pub(super) struct Pass {
    pub(super) step: Step,
    /// First row that is not in the sums yet.
    pub(super) next_row: usize,
    /// Qᵀ; empty in a sketch.
    pub(super) q: Mat<f32>,
    /// Yᵀ; empty in a sketch.
    pub(super) y: Mat<f32>,
    /// Z; empty in a projection.
    pub(super) z: Mat<f32>,
}

/// All of the work done so far: what a run continues from.
pub(super) struct State {
    pub(super) blocks: Vec<Projected>,
    pub(super) pass: Pass,
    pub(super) totals: Totals,
    /// Passes finished.
    pub(super) passes: u32,
    /// All of it is of samples times two to the power of this, from the end of the first pass on: see [`State::rescale`].
    pub(super) exponent: i32,
}

/// Root mean squares from the inverse of this to this are left as they are: with them no product leaves f32.
const USUAL_RMS: f64 = (1u64 << 32) as f64;
/// Powers of two that f32 holds, and their inverses.
const MAX_EXPONENT: f64 = 126.0;

impl State {
    /// Before the first pass, for blocks of `width` vectors.
    pub(super) fn new(columns: usize, width: usize) -> Self {
        Self {
            blocks: Vec::new(),
            pass: Pass {
                step: Step::Sketch,
                next_row: 0,
                q: Mat::new(),
                y: Mat::new(),
                z: Mat::zeros(columns, width),
            },
            totals: Totals::default(),
            passes: 0,
            exponent: 0,
        }
    }

    /// What samples are multiplied by.
    pub(super) fn scale(&self) -> f64 {
        f64::from(self.exponent).exp2()
    }

    /// After the first pass: makes samples whose products would vanish in f32, or leave its range, of about unit size.
    /// By a power of two, so that nothing is rounded.
    fn rescale(&mut self, samples: f64) {
        let rms = (self.totals.energy() / samples).sqrt();
        if rms > 0.0 && !(USUAL_RMS.recip()..=USUAL_RMS).contains(&rms) {
            self.exponent = -rms.log2().round().clamp(-MAX_EXPONENT, MAX_EXPONENT) as i32;
            let scale = self.scale();
            self.totals.multiply(scale);
            for matrix in [&mut self.pass.y, &mut self.pass.z] {
                matrix
                    .as_mut()
                    .col_iter_mut()
                    .for_each(|column| column.iter_mut().for_each(|value| *value *= scale as f32));
            }
        }
    }

    /// Vectors of all blocks.
    pub(super) fn width(&self) -> usize {
        self.blocks.iter().map(|block| block.q.nrows()).sum()
    }

    /// Runs the pass, or the rest of it. `saved` is called between blocks.
    ///
    /// # Errors
    /// Those of the format, [`crate::Error::BadSample`] in a sketch, and those of `saved`.
    pub(super) fn run(
        &mut self,
        stream: &mut Stream<'_>,
        weights: Option<&[f32]>,
        seed: u64,
        mut saved: impl FnMut(&State) -> Result<()>,
    ) -> Result<()> {
        let step = self.pass.step;
        let phase = match step {
            Step::Sketch | Step::Once => Phase::Sketch,
            Step::Both => Phase::PowerIteration(self.passes),
            Step::Project => Phase::Projection,
        };
        let width = self.pass.q.nrows().max(self.pass.z.ncols());
        let rows = stream.rows();
        stream.scale = self.scale() as f32;
        stream.pass(phase, self.pass.next_row, |block| {
            let Pass { q, y, z, .. } = &mut self.pass;
            let range = block.rows.clone();
            if matches!(step, Step::Sketch | Step::Once) {
                let totals = products::sketch(block, rows, seed, weights, z.as_mut());
                block.check(&totals)?;
                self.totals.append(totals);
            }
            if matches!(step, Step::Both | Step::Project | Step::Once) {
                let part = products::forward(block, q.transpose());
                y.as_mut().subcols_mut(range.start, range.len()).copy_from(&part);
            }
            if step == Step::Both {
                let mut part = y.as_ref().subcols(range.start, range.len()).to_owned();
                if let Some(weights) = weights {
                    scale_columns(part.as_mut(), &weights[range.clone()]);
                }
                products::backward(block, part.as_ref(), z.as_mut());
            }
            self.pass.next_row = range.end;
            saved(self)
        })?;
        let products = match step {
            Step::Sketch => products::sketch_terms(rows, width),
            Step::Once => width + products::sketch_terms(rows, self.pass.z.ncols()),
            Step::Both => 2 * width,
            Step::Project => width,
        };
        stream.count_products(products);
        self.passes += 1;
        if matches!(step, Step::Sketch | Step::Once) {
            self.rescale(rows as f64 * stream.columns() as f64);
            stream.scale = self.scale() as f32;
        }
        Ok(())
    }

    /// Ends a pass that gave Z: keeps its block, and makes `step` with the next one of at most `width` vectors the
    /// pass to run.
    pub(super) fn advance(&mut self, step: Step, width: usize, rows: usize, seed: u64) -> Result<()> {
        let z = std::mem::replace(&mut self.pass.z, Mat::new());
        self.keep();
        let columns = z.nrows();
        let z = z.as_ref().subcols(0, width.min(z.ncols())).to_owned();
        let q = next_block(z, &self.blocks, seed ^ u64::from(self.passes) << 48)?;
        let width = q.nrows();
        self.pass = Pass {
            step,
            next_row: 0,
            y: Mat::zeros(width, rows),
            z: match step {
                Step::Both => Mat::zeros(columns, width),
                _ => Mat::new(),
            },
            q,
        };
        Ok(())
    }

    /// Moves the projected block of the pass to the finished ones.
    pub(super) fn keep(&mut self) {
        let q = std::mem::replace(&mut self.pass.q, Mat::new());
        let y = std::mem::replace(&mut self.pass.y, Mat::new());
        if q.nrows() > 0 {
            self.blocks.push(Projected { q, y });
        }
    }
}

/// Qᵀ, orthonormal and orthogonal to all blocks, of what `z` adds to their span.
fn next_block(mut z: Mat<f32>, blocks: &[Projected], seed: u64) -> Result<Mat<f32>> {
    if blocks.is_empty() {
        return orthonormal_rows(z, seed);
    }
    // What is left of Z may be so small that its rounding is as large: projected, normalized, and projected again.
    for block in blocks {
        remove_span(z.as_mut(), block.q.as_ref());
    }
    let mut q = orthonormal_rows(z, seed)?;
    for _ in 0..2 {
        z = q.transpose().to_owned();
        for block in blocks {
            remove_span(z.as_mut(), block.q.as_ref());
        }
        q = orthonormal_rows(z, seed ^ 1)?;
    }
    Ok(q)
}

fn scale_columns(mut matrix: MatMut<'_, f32>, factors: &[f32]) {
    for (column, &factor) in matrix.as_mut().col_iter_mut().zip(factors) {
        column.iter_mut().for_each(|value| *value *= factor);
    }
}
