//! Orthonormal bases of the span of a tall f32 matrix.
//!
//! Done by its Gram matrix in f64, which takes one read of the matrix and no copy of it. Well-conditioned
//! columns are orthonormalized by Cholesky, which keeps their order; ill-conditioned ones by the eigenvectors
//! of the Gram matrix (Stathopoulos, Wu: A Block Orthogonalization Procedure with Constant Synchronization
//! Requirements, 2002, "SVQB"), and again until Cholesky takes them. What the columns do not determine, down to
//! a matrix of zeros, is filled with random columns.
//!
//! faer's Householder QR would be the textbook's choice, but in f32 it takes columns for dependent that differ
//! from the span of the others by less than about rows·ε, 0.4 % at 65,536 rows, and drops them.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use super::gram::gram_of;
use crate::{Error, Result};

/// Smallest eigenvalue, relative to the largest, of a Gram matrix that Cholesky takes: f32 then keeps
/// orthogonality to about 6e-8/√1e-6 = 6e-5, and [`super::ritz`] corrects the rest in f64.
const WELL_CONDITIONED: f64 = 1e-6;
/// Eigenvalues of the Gram matrix below this, relative to the largest, are rounding.
const DETERMINED: f64 = 1e-13;
/// Columns shorter than this count as zero: their inverse lengths would leave the range of f32.
const SHORTEST_COLUMN: f64 = 1e-30;
/// Two are usual, three where columns were replaced; a random matrix fails this often with no probability.
const MAX_SWEEPS: u32 = 12;
/// Rows multiplied at a time.
const PANEL_ROWS: usize = 1024;
/// Tasks that sum up products of two blocks at most: bounds the memory of their sums.
const CROSS_TASKS: usize = 16;

/// A random `rows` × `columns` matrix of independent, uniform entries, the vectors along its longer side of about
/// unit length; the same on every platform.
pub(super) fn random_matrix(rows: usize, columns: usize, seed: u64) -> Mat<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let scale = (3.0 / rows.max(columns) as f32).sqrt() * 0.5f32.powi(31);
    Mat::from_fn(rows, columns, |_, _| random.next_u32() as i32 as f32 * scale)
}

/// Qᵀ for an orthonormal basis Q of a space that contains the span of the columns of `z`, as far as f32 determines
/// it. `z` has at least as many rows as columns, and finite entries.
///
/// # Errors
/// [`Error::NotConverged`] if the decompositions of the Gram matrix fail, which finite input cannot cause.
pub(super) fn orthonormal_rows(mut z: Mat<f32>, seed: u64) -> Result<Mat<f32>> {
    for sweep in 0..MAX_SWEEPS {
        let mut gram = gram_of(z.as_ref());
        let scale: Vec<f64> = (0..z.ncols())
            .map(|column| {
                let length = gram[(column, column)].sqrt();
                if length > SHORTEST_COLUMN {
                    length.recip()
                } else {
                    0.0
                }
            })
            .collect();
        let columns = scale.len();
        gram = Mat::from_fn(columns, columns, |i, j| gram[(i, j)] * scale[i] * scale[j]);
        let eigen = gram
            .self_adjoint_eigen(Side::Lower)
            .map_err(|_| Error::NotConverged("orthonormalization"))?;
        let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect(); // rising
        let largest = values[columns - 1];
        if values[0] > WELL_CONDITIONED * largest {
            let rotation = inverse_cholesky(&gram)?;
            let rotation = Mat::from_fn(columns, columns, |i, j| (scale[i] * rotation[(i, j)]) as f32);
            return Ok(transposed_product(&z, &rotation));
        }
        // Falling eigenvalues: the basis begins with what all columns share, so that later products with it
        // do not lose small components in the rounding of large ones.
        let determined = |column: usize| values[columns - 1 - column] > DETERMINED * largest;
        let rotation = Mat::from_fn(columns, columns, |i, j| {
            let from = columns - 1 - j;
            if determined(j) {
                (scale[i] * eigen.U()[(i, from)] / values[from].sqrt()) as f32
            } else {
                0.0
            }
        });
        multiply_in_place(&mut z, &rotation);
        for column in (0..columns).filter(|&column| !determined(column)) {
            let seed = seed ^ (u64::from(sweep) << 32 | column as u64) << 16;
            let random = random_matrix(z.nrows(), 1, seed);
            z.col_mut(column).copy_from(random.col(0));
        }
    }
    Err(Error::NotConverged("orthonormalization"))
}

/// QᵀZ for `q` = Qᵀ: products in f32, their sums in f64.
pub(super) fn cross(q: MatRef<'_, f32>, z: MatRef<'_, f32>) -> Mat<f64> {
    let (rows, columns, width) = (z.nrows(), z.ncols(), q.nrows());
    let task_rows = rows.div_ceil(CROSS_TASKS).next_multiple_of(PANEL_ROWS);
    let sums: Vec<Mat<f64>> = (0..rows.div_ceil(task_rows))
        .into_par_iter()
        .map(|task| {
            let mut sum = Mat::<f64>::zeros(width, columns);
            let mut part = Mat::<f32>::zeros(width, columns);
            let end = rows.min((task + 1) * task_rows);
            for start in (task * task_rows..end).step_by(PANEL_ROWS) {
                let count = PANEL_ROWS.min(end - start);
                let (q, z) = (q.subcols(start, count), z.subrows(start, count));
                matmul(part.as_mut(), Accum::Replace, q, z, 1.0, Par::Seq);
                sum += Mat::<f64>::from_fn(width, columns, |i, j| part[(i, j)].into());
            }
            sum
        })
        .collect();
    let sum = sums.into_iter().reduce(|a, b| a + b);
    sum.unwrap_or_else(|| Mat::zeros(width, columns))
}

/// Z ← Z − Q·(QᵀZ), for `q` = Qᵀ.
pub(super) fn remove_span(mut z: MatMut<'_, f32>, q: MatRef<'_, f32>) {
    let (columns, width) = (z.ncols(), q.nrows());
    let sum = cross(q, z.as_ref());
    let coefficients = Mat::<f32>::from_fn(width, columns, |i, j| sum[(i, j)] as f32);
    z.as_mut()
        .par_row_chunks_mut(PANEL_ROWS)
        .enumerate()
        .for_each(|(index, z)| {
            let q = q.subcols(index * PANEL_ROWS, z.nrows()).transpose();
            matmul(z, Accum::Add, q, coefficients.as_ref(), -1.0, Par::Seq);
        });
}

/// L⁻ᵀ for G = L·Lᵀ: what makes columns with the Gram matrix G orthonormal.
pub(super) fn inverse_cholesky(gram: &Mat<f64>) -> Result<Mat<f64>> {
    let cholesky = gram
        .llt(Side::Lower)
        .map_err(|_| Error::NotConverged("orthonormalization"))?;
    let mut inverse = Mat::<f64>::identity(gram.nrows(), gram.nrows());
    cholesky
        .L()
        .transpose()
        .solve_upper_triangular_in_place(inverse.as_mut());
    Ok(inverse)
}

/// Z ← Z·X.
fn multiply_in_place(z: &mut Mat<f32>, x: &Mat<f32>) {
    z.as_mut().par_row_chunks_mut(PANEL_ROWS).for_each(|mut panel| {
        let copy = panel.as_ref().to_owned();
        matmul(
            panel.as_mut(),
            Accum::Replace,
            copy.as_ref(),
            x.as_ref(),
            1.0,
            Par::Seq,
        );
    });
}

/// (Z·X)ᵀ.
fn transposed_product(z: &Mat<f32>, x: &Mat<f32>) -> Mat<f32> {
    let mut product = Mat::<f32>::zeros(x.ncols(), z.nrows());
    product
        .as_mut()
        .par_col_chunks_mut(PANEL_ROWS)
        .enumerate()
        .for_each(|(index, out)| {
            let z = z.as_ref().subrows(index * PANEL_ROWS, out.ncols());
            matmul(out.transpose_mut(), Accum::Replace, z, x.as_ref(), 1.0, Par::Seq);
        });
    product
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest deviation of QᵀQ from the identity.
    fn defect(q: &Mat<f32>) -> f64 {
        let gram = gram_of(q.as_ref());
        let entry = |i: usize, j: usize| (gram[(i, j)] - f64::from(i == j)).abs();
        (0..q.ncols())
            .flat_map(|i| (0..q.ncols()).map(move |j| (i, j)))
            .map(|(i, j)| entry(i, j))
            .fold(0.0, f64::max)
    }

    /// What the projection of `z` on the basis `q` leaves out, relative to `z`.
    fn left_out(z: &Mat<f32>, q: &Mat<f32>) -> f64 {
        let rest = z - q * (q.transpose() * z);
        f64::from(rest.norm_l2() / z.norm_l2())
    }

    #[test]
    fn bases_are_orthonormal_and_span_the_columns() {
        let random = random_matrix(3000, 20, 3);
        // From independent columns to nearly parallel ones, as a power iteration makes them.
        for closeness in [0.0f32, 1.0, 1e3, 1e6] {
            let z = Mat::from_fn(3000, 20, |i, j| random[(i, j)] + closeness * random[(i, 0)]);
            let q = orthonormal_rows(z.clone(), 1).unwrap().transpose().to_owned();
            assert!(defect(&q) < 1e-4, "closeness {closeness}: {}", defect(&q));
            assert!(
                left_out(&z, &q) < 1e-5,
                "closeness {closeness}: {}",
                left_out(&z, &q)
            );
        }
    }

    #[test]
    fn small_directions_among_nearly_parallel_columns_survive() {
        // Columns that differ by 1e-4 of their length, in 40,000 rows: faer's f32 QR drops such directions.
        let random = random_matrix(40_000, 8, 5);
        let z = Mat::from_fn(40_000, 8, |i, j| random[(i, 0)] + 1e-4 * random[(i, j)]);
        let q = orthonormal_rows(z.clone(), 1).unwrap().transpose().to_owned();
        for j in 1..8 {
            let direction = Mat::from_fn(40_000, 1, |i, _| random[(i, j)]);
            assert!(left_out(&direction, &q) < 0.01);
        }
    }

    #[test]
    fn deficient_matrices_are_filled_up() {
        let random = random_matrix(50, 1, 3);
        let rank_one = Mat::from_fn(50, 7, |i, j| random[(i, 0)] * j as f32);
        let extreme = Mat::from_fn(50, 7, |i, j| {
            random[(i, 0)] * 10f32.powi(8 * j as i32 - 20) * (1 + i % (j + 1)) as f32
        });
        for z in [
            Mat::zeros(50, 7),
            Mat::zeros(7, 7),
            Mat::zeros(1, 1),
            rank_one,
            extreme,
        ] {
            let q = orthonormal_rows(z.clone(), 1).unwrap().transpose().to_owned();
            assert!(defect(&q) < 1e-4, "{}", defect(&q));
        }
    }
}
