//! A BTF whose file holds factors: their product in the form of a singular value decomposition.
//!
//! Both factors are orthonormalized by the eigenvectors of their Gram matrices in f64 (SVQB, see `basis`), once more
//! by Cholesky, and the small matrix between them is decomposed: nothing of the size of the BTF is formed. Nor is anything of
//! the size of the texels' factor: its bases are products with small matrices, made panel by panel where they are needed, and
//! the result takes the place of the factor. Eigen-textures of 2048² texels and 100 terms are 1.7 GB once.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, Par, Side};
use rayon::prelude::*;

use super::basis::inverse_cholesky;
use super::factors::square_sum;
use super::gram::{gram, widen};
use super::{Factors, Settings, Statistics, Weighted};
use crate::source::LowRank;
use crate::{Btf, Error, Result};

/// Directions of a factor whose square is smaller than this share of the largest are rounding of its f32 numbers.
const DETERMINED: f64 = 1e-13;
/// Terms smaller than this share of the first are rounding of f32.
const RANK_TOLERANCE: f64 = 1e-7;
const PANEL_ROWS: usize = 1024;

/// The singular value decomposition of `product`, cut to the terms that the settings ask for. Its error is exact: what is
/// cut, and nothing for all terms. `btf` says what the product is; its samples are not read. What `v` takes is used again for
/// V', beside it stand only factors of directions.
///
/// # Errors
/// [`Error::Format`] if sizes contradict the BTF's or numbers are not finite.
pub fn factorize_product(btf: &Btf, product: LowRank, settings: &Settings) -> Result<Factors> {
    let (rows, columns) = (btf.rows(), btf.columns());
    let LowRank { terms, u, v } = product;
    if terms == 0 || u.len() != terms * rows || v.len() != terms * columns {
        let detail = format!(
            "factors of {} and {} numbers; {terms} terms of {rows} rows and {columns} texels need other sizes",
            u.len(),
            v.len()
        );
        return Err(Error::format(btf.path(), detail));
    }
    if let Some(bad) = u.iter().chain(&v).find(|value| !value.is_finite()) {
        return Err(Error::format(
            btf.path(),
            format!("one of its factors holds {bad}"),
        ));
    }
    let began = std::time::Instant::now();
    // ‖b_row‖² = u_row·(VᵀV)·u_rowᵀ.
    let (left, right) = (Factor::new(u, rows, None), Factor::new(v, columns, None));
    let energies = left.squares(&right.gram);
    let energy: f64 = energies.iter().sum();
    let weights = settings
        .weights
        .of_directions(btf.sampling())
        .or_else(|| settings.weights.of_energies(&energies));
    let mean_rgb = mean_rgb(&left, &right);
    let left = match &weights {
        Some(weights) => Factor::new(left.values, rows, Some(weights)),
        None => left,
    };

    let (left_basis, left_small) = left.orthonormal()?;
    let (right_basis, right_small) = right.orthonormal()?;
    let svd = (&left_small * right_small.transpose())
        .thin_svd()
        .map_err(|_| Error::NotConverged("singular value decomposition"))?;
    let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let weighted_energy = square_sum(&values);
    let determined = values
        .iter()
        .take_while(|&&value| value > values[0] * RANK_TOLERANCE)
        .count();
    let samples = rows as f64 * columns as f64;
    let enough = settings
        .enough
        .map_or(0.0, |enough| enough.energy(samples, weighted_energy));
    let mut kept = determined.min(settings.components as usize).max(1);
    while kept > 1 && square_sum(&values[kept - 1..]) <= enough {
        kept -= 1;
    }

    // Norms of U·Σ without the weights, and both factors in the house's scaling.
    let u = left.times(&(left_basis * svd.U().subcols(0, kept)));
    let root = (rows as f64).sqrt();
    let (mut norms, mut u_scaled) = (Vec::with_capacity(kept), Vec::with_capacity(kept * rows));
    let mut rotation = right_basis * svd.V().subcols(0, kept);
    for (component, rotation) in rotation.as_mut().col_iter_mut().enumerate() {
        let mut u: Vec<f64> = u.col(component).iter().copied().collect();
        if let Some(weights) = &weights {
            for (value, &weight) in u.iter_mut().zip(weights) {
                *value /= f64::from(weight).sqrt();
            }
        }
        let length = square_sum(&u).sqrt();
        let sign = if u.iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
        let norm = length * values[component];
        let scale = if length > 0.0 { sign * root / length } else { 0.0 };
        u_scaled.extend(u.iter().map(|value| (value * scale) as f32));
        rotation.iter_mut().for_each(|value| *value *= sign * norm / root);
        norms.push(norm);
    }
    let v_scaled = right.rotated(&rotation);
    let weighted = weights.map(|weights| Weighted {
        weights,
        energy: weighted_energy,
        residual_energy: square_sum(&values[kept..]),
        singular_values: values[..kept].to_vec(),
    });
    // With weights the unweighted rest is a difference of sums in f64, without it is what was cut.
    let residual_energy = if weighted.is_some() {
        (energy - square_sum(&norms)).max(0.0)
    } else {
        square_sum(&values[kept..])
    };
    Ok(Factors {
        rows,
        columns,
        components: kept,
        u: u_scaled,
        v: v_scaled,
        singular_values: norms,
        energy,
        residual_energy,
        estimated: false,
        weighted,
        mean_rgb,
        statistics: Statistics {
            decompose_seconds: began.elapsed().as_secs_f64(),
            ..Statistics::default()
        },
    })
}

/// Means of the red, green and blue samples of the product.
fn mean_rgb(left: &Factor, right: &Factor) -> [f64; 3] {
    let mut mean = [0.0; 3];
    for (u, v) in left
        .values
        .chunks_exact(left.length)
        .zip(right.values.chunks_exact(right.length))
    {
        let texture = v.iter().map(|&value| f64::from(value)).sum::<f64>() / right.length as f64;
        for (channel, mean) in mean.iter_mut().enumerate() {
            let abrdf: f64 = u[channel..]
                .iter()
                .step_by(3)
                .map(|&value| f64::from(value))
                .sum();
            *mean += abrdf / (left.length as f64 / 3.0) * texture;
        }
    }
    mean
}

/// One factor, `[term][index]`, and its Gram matrix; of √w·values if there are weights.
struct Factor {
    values: Vec<f32>,
    length: usize,
    scales: Option<Vec<f64>>,
    gram: Mat<f64>,
}

impl Factor {
    fn new(values: Vec<f32>, length: usize, weights: Option<&Vec<f32>>) -> Self {
        let terms = values.len() / length;
        let scales = weights.map(|weights| weights.iter().map(|&weight| f64::from(weight).sqrt()).collect());
        let mut factor = Self {
            values,
            length,
            scales,
            gram: Mat::new(),
        };
        factor.gram = gram(length, terms, |range, out| factor.fill(range.start, out));
        factor
    }

    fn terms(&self) -> usize {
        self.values.len() / self.length
    }

    /// Rows from `first` on, in f64.
    fn fill(&self, first: usize, mut out: MatMut<'_, f64>) {
        for (term, values) in self.values.chunks_exact(self.length).enumerate() {
            for (index, out) in out.as_mut().col_mut(term).iter_mut().enumerate() {
                let scale = self.scales.as_ref().map_or(1.0, |scales| scales[first + index]);
                *out = f64::from(values[first + index]) * scale;
            }
        }
    }

    /// x·G·xᵀ for each row x.
    fn squares(&self, gram: &Mat<f64>) -> Vec<f64> {
        let mut squares = vec![0.0; self.length];
        squares
            .par_chunks_mut(PANEL_ROWS)
            .enumerate()
            .for_each(|(panel, squares)| {
                let mut rows = Mat::<f64>::zeros(squares.len(), self.terms());
                self.fill(panel * PANEL_ROWS, rows.as_mut());
                let product = &rows * gram;
                for (index, square) in squares.iter_mut().enumerate() {
                    let sum: f64 = (0..self.terms())
                        .map(|term| rows[(index, term)] * product[(index, term)])
                        .sum();
                    *square = sum.max(0.0);
                }
            });
        squares
    }

    /// X for which factor·X is an orthonormal basis, and the small R with factor·X·R = the factor, as far as f32 determines
    /// it. The basis itself, of the factor's size in f64, is never whole.
    fn orthonormal(&self) -> Result<(Mat<f64>, Mat<f64>)> {
        let terms = self.terms();
        let lengths: Vec<f64> = (0..terms).map(|term| self.gram[(term, term)].sqrt()).collect();
        let inverse = |length: f64| if length > 0.0 { length.recip() } else { 0.0 };
        let scaled = Mat::from_fn(terms, terms, |i, j| {
            self.gram[(i, j)] * inverse(lengths[i]) * inverse(lengths[j])
        });
        let eigen = scaled
            .self_adjoint_eigen(Side::Lower)
            .map_err(|_| Error::NotConverged("orthonormalization"))?;
        let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect(); // rising
        let first = values
            .iter()
            .position(|&value| value > values[terms - 1] * DETERMINED);
        let determined: Vec<usize> = (first.unwrap_or(terms - 1)..terms).rev().collect();
        // S⁻¹·E·Λ^(−½) makes the basis, Λ^½·Eᵀ·S what it is multiplied with.
        let root = |column: usize| values[determined[column]].max(0.0).sqrt();
        let make = Mat::from_fn(terms, determined.len(), |i, j| {
            inverse(lengths[i]) * eigen.U()[(i, determined[j])] * inverse(root(j))
        });
        let small = Mat::from_fn(determined.len(), terms, |i, j| {
            root(i) * eigen.U()[(j, determined[i])] * lengths[j]
        });
        let again = gram(self.length, make.ncols(), |range, out| {
            self.panel_times(range.start, &make, out);
        });
        if again[(0, 0)] == 0.0 {
            return Ok((make, small)); // all zero
        }
        let correction = inverse_cholesky(&again)?;
        // X ← X·L⁻ᵀ, R ← Lᵀ·R with Lᵀ = L⁻¹·G.
        let small = correction.transpose() * again * small;
        Ok((make * correction, small))
    }

    /// Rows of the factor from `first` on, as many as `out` has, times X.
    fn panel_times(&self, first: usize, x: &Mat<f64>, out: MatMut<'_, f64>) {
        let mut rows = Mat::<f64>::zeros(out.nrows(), self.terms());
        self.fill(first, rows.as_mut());
        matmul(out, Accum::Replace, rows.as_ref(), x.as_ref(), 1.0, Par::Seq);
    }

    /// The factor times X.
    fn times(&self, x: &Mat<f64>) -> Mat<f64> {
        let mut product = Mat::<f64>::zeros(self.length, x.ncols());
        product
            .as_mut()
            .par_row_chunks_mut(PANEL_ROWS)
            .enumerate()
            .for_each(|(panel, out)| self.panel_times(panel * PANEL_ROWS, x, out));
        product
    }

    /// The factor, which has no weights, times X of no more columns than terms: in the memory of the factor, `[column of X][index]`.
    fn rotated(self, x: &Mat<f64>) -> Vec<f32> {
        let (terms, kept) = (self.terms(), x.ncols());
        let mut values = self.values;
        MatMut::from_column_major_slice_mut(&mut values, self.length, terms)
            .par_row_chunks_mut(PANEL_ROWS)
            .for_each(|mut panel| {
                let mut rows = Mat::<f64>::zeros(panel.nrows(), terms);
                widen(panel.as_ref(), rows.as_mut());
                let mut product = Mat::<f64>::zeros(panel.nrows(), kept);
                matmul(product.as_mut(), Accum::Replace, &rows, x, 1.0, Par::Seq);
                for (to, from) in panel.as_mut().col_iter_mut().zip(product.col_iter()) {
                    to.iter_mut()
                        .zip(from.iter())
                        .for_each(|(to, from)| *to = *from as f32);
                }
            });
        values.truncate(kept * self.length);
        values.shrink_to_fit();
        values
    }
}
