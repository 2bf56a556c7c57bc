//! What is lost when both factors are replaced by others, exactly and without forming the product.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

/// Rows multiplied at a time: their products are summed in f32, the blocks' sums in f64.
const BLOCK_ROWS: usize = 512;
/// Tasks at most, and bytes of all their sums.
const MAX_TASKS: usize = 32;
const SUM_BYTES: usize = 128 << 20;

/// Writes entries of a component of a factor: the component, the first row or texel, and as many as there is room for.
type Entries<'a> = Box<dyn Fn(usize, usize, &mut [f32]) + Sync + 'a>;

/// A pair of factors.
pub(crate) struct Product<'a> {
    pub(crate) abrdf: Entries<'a>,
    pub(crate) texture: Entries<'a>,
}

/// Sizes of the factors.
#[derive(Clone, Copy)]
pub(crate) struct Sizes {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) components: usize,
}

/// Products of which each replaces the one before it.
///
/// With A = U − Û and D = V − V̂ the difference of two products U·V and Û·V̂ is [A Û]·[V; D]; its squared norm is the sum over the
/// products of entries of both factors' Gram matrices. Nothing cancels: each term is small because A or D is, so products
/// in f32 give it to a few parts in a million. The Gram matrices are those of the first product and of the differences
/// between neighbours, from which those of any two follow: one pass over the factors serves all pairs.
pub(crate) struct Chain {
    sizes: Sizes,
    /// Of the first product's factor and of the differences, blocks of a column for each component.
    left: Mat<f64>,
    right: Mat<f64>,
    /// What the textures were divided by.
    unit: f64,
}

impl Chain {
    pub(crate) fn new(sizes: Sizes, products: &[Product<'_>]) -> Self {
        // Sums of squares have the range of f32: textures are taken in units of their largest value, to a power of two.
        let largest = largest(sizes, products);
        let unit = if largest > 0.0 {
            f64::from(largest).log2().floor().exp2()
        } else {
            1.0
        };
        let abrdfs: Vec<&Entries<'_>> = products.iter().map(|product| &product.abrdf).collect();
        let textures: Vec<&Entries<'_>> = products.iter().map(|product| &product.texture).collect();
        Self {
            left: gram(sizes.rows, sizes.components, &abrdfs, 1.0),
            right: gram(sizes.columns, sizes.components, &textures, unit.recip()),
            sizes,
            unit,
        }
    }

    /// Mean squared difference of reflectance between product `a` of the chain and `b`, which comes later.
    pub(crate) fn mean_square(&self, a: usize, b: usize) -> f64 {
        let blocks = self.left.nrows() / self.sizes.components;
        // In the blocks of the Gram matrices: a product is the first one less all differences until it.
        let until = |n: usize| (0..blocks).map(move |k| if k == 0 { 1.0 } else { -f64::from(k <= n) });
        let product = |n: usize| until(n).collect::<Vec<f64>>();
        let difference: Vec<f64> = (0..blocks).map(|k| f64::from(a < k && k <= b)).collect();
        let (wanted, stored) = (product(a), product(b));
        let terms = [(&difference, &wanted), (&stored, &difference)];
        let mut sum = 0.0;
        for (left, right) in terms {
            for (left_2, right_2) in terms {
                for j in 0..self.sizes.components {
                    for i in 0..self.sizes.components {
                        sum += self.entry(&self.left, [left, left_2], [i, j])
                            * self.entry(&self.right, [right, right_2], [i, j]);
                    }
                }
            }
        }
        (sum / self.sizes.rows as f64 / self.sizes.columns as f64).max(0.0) * self.unit * self.unit
    }

    /// The scalar product of columns that are sums of the blocks' columns.
    fn entry(&self, gram: &Mat<f64>, [x, y]: [&Vec<f64>; 2], [i, j]: [usize; 2]) -> f64 {
        let mut sum = 0.0;
        for (p, x) in x.iter().enumerate().filter(|(_, x)| **x != 0.0) {
            for (q, y) in y.iter().enumerate().filter(|(_, y)| **y != 0.0) {
                let at = (p * self.sizes.components + i, q * self.sizes.components + j);
                // The lower half is there.
                sum += x * y * gram[(at.0.max(at.1), at.0.min(at.1))];
            }
        }
        sum
    }
}

/// The largest value of all textures.
fn largest(sizes: Sizes, products: &[Product<'_>]) -> f32 {
    (0..sizes.components)
        .into_par_iter()
        .map(|component| {
            let mut values = vec![0.0; BLOCK_ROWS.min(sizes.columns)];
            let mut largest = 0f32;
            for first in (0..sizes.columns).step_by(BLOCK_ROWS) {
                let values = &mut values[..BLOCK_ROWS.min(sizes.columns - first)];
                for product in products {
                    (product.texture)(component, first, values);
                    largest = values
                        .iter()
                        .fold(largest, |largest, value| largest.max(value.abs()));
                }
            }
            largest
        })
        .reduce(|| 0.0, f32::max)
}

/// The lower half of XᵀX for X = [F₀, F₀ − F₁, F₁ − F₂ …]·scale with the `rows` × `components` factors F. Summed in an order that does not
/// depend on the number of threads.
fn gram(rows: usize, components: usize, factors: &[&Entries<'_>], scale: f64) -> Mat<f64> {
    let columns = components * factors.len();
    let tasks = (SUM_BYTES / (8 * columns * columns).max(1)).clamp(2, MAX_TASKS);
    let task_rows = rows.div_ceil(tasks).next_multiple_of(BLOCK_ROWS);
    let sums: Vec<Mat<f64>> = (0..rows.div_ceil(task_rows))
        .into_par_iter()
        .map(|task| {
            let mut sum = Mat::<f64>::zeros(columns, columns);
            let mut product = Mat::<f32>::zeros(columns, columns);
            // `[column][row]`
            let mut block = vec![0f32; BLOCK_ROWS.min(rows) * columns];
            let end = rows.min((task + 1) * task_rows);
            for first in (task * task_rows..end).step_by(BLOCK_ROWS) {
                let count = BLOCK_ROWS.min(end - first);
                let block = &mut block[..count * columns];
                fill(block, [first, count, components], factors, scale);
                let block = faer::MatRef::from_column_major_slice(block, count, columns);
                matmul(
                    product.as_mut(),
                    BlockStructure::TriangularLower,
                    Accum::Replace,
                    block.transpose(),
                    BlockStructure::Rectangular,
                    block,
                    BlockStructure::Rectangular,
                    1.0,
                    Par::Seq,
                );
                for (sum, product) in sum.as_mut().col_iter_mut().zip(product.col_iter()) {
                    for (sum, product) in sum.iter_mut().zip(product.iter()) {
                        *sum += f64::from(*product);
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

/// Writes `count` rows of X from `first` on, `[column][row]`.
fn fill(block: &mut [f32], [first, count, components]: [usize; 3], factors: &[&Entries<'_>], scale: f64) {
    let mut last = vec![0f32; count];
    for component in 0..components {
        for (n, factor) in factors.iter().enumerate() {
            let column = &mut block[(n * components + component) * count..][..count];
            factor(component, first, column);
            if n == 0 {
                last.copy_from_slice(column);
            } else {
                for (last, value) in last.iter_mut().zip(column.iter_mut()) {
                    (*last, *value) = (*value, *last - *value);
                }
            }
            if scale != 1.0 {
                column
                    .iter_mut()
                    .for_each(|value| *value = (f64::from(*value) * scale) as f32);
            }
        }
    }
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
        type Entry = fn(usize, usize) -> f32;
        fn noise(a: usize, b: usize) -> f32 {
            ((a * 7919 + b * 104_729) % 1009) as f32 / 1009.0 - 0.5
        }
        fn entries<'a>(entry: Entry) -> Entries<'a> {
            Box::new(move |component, first, out| {
                let numbered = out.iter_mut().enumerate();
                numbered.for_each(|(n, out)| *out = entry(component, first + n));
            })
        }
        fn product<'a>([abrdf, texture]: [Entry; 2]) -> Product<'a> {
            Product {
                abrdf: entries(abrdf),
                texture: entries(texture),
            }
        }
        let wanted: [Entry; 2] = [
            |c: usize, row: usize| noise(c, row),
            |c: usize, texel: usize| noise(c + 5, texel),
        ];
        let rounded: [Entry; 2] = [
            |c: usize, row: usize| noise(c, row) + 1e-3 * noise(c + 9, row),
            |c: usize, texel: usize| noise(c + 5, texel) + 2e-3 * noise(c + 13, texel),
        ];
        let stored: [Entry; 2] = [
            |c: usize, row: usize| noise(c, row) - 4e-3 * noise(c + 10, row),
            |c: usize, texel: usize| noise(c + 5, texel) + 3e-3 * noise(c + 17, texel),
        ];
        let chain = Chain::new(sizes, &[wanted, rounded, stored].map(product));
        for (a, b, [x, y]) in [
            (0, 1, [wanted, rounded]),
            (1, 2, [rounded, stored]),
            (0, 2, [wanted, stored]),
        ] {
            let mut sum = 0.0;
            for row in 0..sizes.rows {
                for texel in 0..sizes.columns {
                    let difference: f64 = (0..sizes.components)
                        .map(|c| {
                            f64::from(x[0](c, row)) * f64::from(x[1](c, texel))
                                - f64::from(y[0](c, row)) * f64::from(y[1](c, texel))
                        })
                        .sum();
                    sum += difference * difference;
                }
            }
            let exact = sum / (sizes.rows * sizes.columns) as f64;
            let found = chain.mean_square(a, b);
            assert!((found / exact - 1.0).abs() < 1e-4, "{found} {exact}");
        }
        let same = Chain::new(sizes, &[wanted, wanted].map(product));
        assert_eq!(same.mean_square(0, 1), 0.0);

        // Values whose squares no f32 holds, all lost.
        let tiny: [Entry; 2] = [wanted[0], |c, texel| 1e-36 * noise(c + 5, texel)];
        let nothing: [Entry; 2] = [wanted[0], |_, _| 0.0];
        let loss = |x, y| Chain::new(sizes, &[x, y].map(product)).mean_square(0, 1);
        let (of_ones, found) = (loss(wanted, nothing), loss(tiny, nothing));
        assert!((found / of_ones * 1e72 - 1.0).abs() < 1e-4, "{found} {of_ones}");
        assert_eq!(loss(nothing, nothing), 0.0, "no material");
    }
}
