//! What is lost when both factors are replaced by what is stored of them.

use half::f16;

use crate::Factors;
use crate::factorize::gram;

/// Mean squared difference of reflectance between U·V and Û·V̂, where Û is U in half floats and V̂ is
/// `texture(component, texel)`.
///
/// With A = U − Û and D = V − V̂ the difference is [A Û]·[V; D]; its squared norm is the sum over the products
/// of entries of both factors' Gram matrices. So it is exact, without forming the product, and nothing cancels:
/// each term is small because A or D is.
pub(super) fn mean_square(factors: &Factors, texture: impl Fn(usize, usize) -> f32 + Sync) -> f64 {
    let (rows, columns, components) = (factors.rows, factors.columns, factors.components);
    let left = gram(rows, 2 * components, |range, mut out| {
        for component in 0..components {
            for (i, row) in range.clone().enumerate() {
                let wanted = factors.u[component * rows + row];
                let stored = f16::from_f32(wanted).to_f32();
                out[(i, component)] = (wanted - stored).into();
                out[(i, components + component)] = stored.into();
            }
        }
    });
    let right = gram(columns, 2 * components, |range, mut out| {
        for component in 0..components {
            for (i, texel) in range.clone().enumerate() {
                let wanted = factors.v[component * columns + texel];
                out[(i, component)] = wanted.into();
                out[(i, components + component)] = f64::from(wanted) - f64::from(texture(component, texel));
            }
        }
    });
    let mut sum = 0.0;
    for j in 0..2 * components {
        for i in 0..2 * components {
            sum += left[(i, j)] * right[(i, j)];
        }
    }
    (sum / rows as f64 / columns as f64).max(0.0)
}
