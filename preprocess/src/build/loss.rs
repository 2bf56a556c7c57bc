//! What is lost when both factors are replaced by others, exactly and without forming the product.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, Par};
use rayon::prelude::*;

/// Rows multiplied at a time: their products are summed in f32, the blocks' sums in f64.
const BLOCK_ROWS: usize = 512;
/// Blocks summed by one task: few enough tasks that their sums take no memory worth counting.
const MAX_TASKS: usize = 32;

/// A pair of factors, by entry: `abrdf(component, row)` and `texture(component, texel)`.
pub(crate) struct Product<A, T> {
    pub(crate) abrdf: A,
    pub(crate) texture: T,
}

/// Sizes of the factors.
#[derive(Clone, Copy)]
pub(crate) struct Sizes {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) components: usize,
}

/// Mean squared difference of reflectance between two products U·V and Û·V̂.
///
/// With A = U − Û and D = V − V̂ the difference is [A Û]·[V; D]; its squared norm is the sum over the products
/// of entries of both factors' Gram matrices. Nothing cancels: each term is small because A or D is, so products in f32
/// give it to a few parts in a million.
pub(crate) fn mean_square<A, T, A2, T2>(sizes: Sizes, wanted: &Product<A, T>, stored: &Product<A2, T2>) -> f64
where
    A: Fn(usize, usize) -> f32 + Sync,
    T: Fn(usize, usize) -> f32 + Sync,
    A2: Fn(usize, usize) -> f32 + Sync,
    T2: Fn(usize, usize) -> f32 + Sync,
{
    let Sizes {
        rows,
        columns,
        components,
    } = sizes;
    // Sums of squares have the range of f32: textures are taken in units of their largest value, to a power of two.
    let largest = (0..components)
        .into_par_iter()
        .map(|component| {
            (0..columns).fold(0f32, |largest, texel| {
                let both = [
                    (wanted.texture)(component, texel),
                    (stored.texture)(component, texel),
                ];
                both.into_iter().map(f32::abs).fold(largest, f32::max)
            })
        })
        .reduce(|| 0.0, f32::max);
    if largest == 0.0 {
        return 0.0; // no material: every product is zero
    }
    let unit = f64::from(largest).log2().floor().exp2();
    let in_units = |value: f32| (f64::from(value) / unit) as f32;
    let left = gram(rows, 2 * components, |first, mut out| {
        for component in 0..components {
            for i in 0..out.nrows() {
                let kept = (stored.abrdf)(component, first + i);
                out[(i, component)] = (wanted.abrdf)(component, first + i) - kept;
                out[(i, components + component)] = kept;
            }
        }
    });
    let right = gram(columns, 2 * components, |first, mut out| {
        for component in 0..components {
            for i in 0..out.nrows() {
                let value = (wanted.texture)(component, first + i);
                let lost = value - (stored.texture)(component, first + i);
                (out[(i, component)], out[(i, components + component)]) = (in_units(value), in_units(lost));
            }
        }
    });
    let mut sum = 0.0;
    for j in 0..2 * components {
        for i in 0..2 * components {
            sum += left[(i, j)] * right[(i, j)];
        }
    }
    (sum / rows as f64 / columns as f64).max(0.0) * unit * unit
}

/// XᵀX for the `rows` × `columns` matrix X, which `fill` writes piece by piece: it gets the first row and a matrix of
/// some rows. Summed in an order that does not depend on the number of threads.
fn gram(rows: usize, columns: usize, fill: impl Fn(usize, MatMut<'_, f32>) + Sync) -> Mat<f64> {
    let task_rows = rows.div_ceil(MAX_TASKS).next_multiple_of(BLOCK_ROWS);
    let sums: Vec<Mat<f64>> = (0..rows.div_ceil(task_rows))
        .into_par_iter()
        .map(|task| {
            let mut sum = Mat::<f64>::zeros(columns, columns);
            let mut product = Mat::<f32>::zeros(columns, columns);
            let mut block = Mat::<f32>::zeros(BLOCK_ROWS.min(rows), columns);
            let end = rows.min((task + 1) * task_rows);
            for first in (task * task_rows..end).step_by(BLOCK_ROWS) {
                let mut block = block.as_mut().subrows_mut(0, BLOCK_ROWS.min(end - first));
                fill(first, block.as_mut());
                let block = block.as_ref();
                matmul(
                    product.as_mut(),
                    Accum::Replace,
                    block.transpose(),
                    block,
                    1.0,
                    Par::Seq,
                );
                for j in 0..columns {
                    for i in 0..columns {
                        sum[(i, j)] += f64::from(product[(i, j)]);
                    }
                }
            }
            sum
        })
        .collect();
    sums.into_iter()
        .reduce(|a, b| a + b)
        .unwrap_or_else(|| Mat::zeros(columns, columns))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loss_is_that_of_the_products() {
        let sizes = Sizes {
            rows: 700,
            columns: 1300,
            components: 3,
        };
        let noise = |a: usize, b: usize| ((a * 7919 + b * 104_729) % 1009) as f32 / 1009.0 - 0.5;
        let wanted = Product {
            abrdf: |c: usize, row: usize| noise(c, row),
            texture: |c: usize, texel: usize| noise(c + 5, texel),
        };
        let stored = Product {
            abrdf: |c: usize, row: usize| noise(c, row) + 1e-3 * noise(c + 9, row),
            texture: |c: usize, texel: usize| noise(c + 5, texel) + 2e-3 * noise(c + 13, texel),
        };
        let mut sum = 0.0;
        for row in 0..sizes.rows {
            for texel in 0..sizes.columns {
                let difference: f64 = (0..sizes.components)
                    .map(|c| {
                        f64::from((wanted.abrdf)(c, row)) * f64::from((wanted.texture)(c, texel))
                            - f64::from((stored.abrdf)(c, row)) * f64::from((stored.texture)(c, texel))
                    })
                    .sum();
                sum += difference * difference;
            }
        }
        let exact = sum / (sizes.rows * sizes.columns) as f64;
        let found = mean_square(sizes, &wanted, &stored);
        assert!((found / exact - 1.0).abs() < 1e-4, "{found} {exact}");
        assert_eq!(mean_square(sizes, &wanted, &wanted), 0.0);

        // Values whose squares no f32 holds, all lost.
        let tiny = Product {
            abrdf: wanted.abrdf,
            texture: |c: usize, texel: usize| 1e-36 * noise(c + 5, texel),
        };
        let nothing = Product {
            abrdf: wanted.abrdf,
            texture: |_: usize, _: usize| 0.0,
        };
        let of_ones = mean_square(sizes, &wanted, &nothing);
        let found = mean_square(sizes, &tiny, &nothing);
        assert!((found / of_ones * 1e72 - 1.0).abs() < 1e-4, "{found} {of_ones}");
    }
}
