//! Runs of the factorization, and what every one of them must hold.

use preprocess::factorize::factorize;
use preprocess::npy::Dtype;
use preprocess::{Btf, Factors, Settings};

use crate::common::{Shape, product_error, singular_values, stored, write_btf};

pub(crate) fn run(shape: Shape, dtype: Dtype, samples: &[f32], settings: Settings) -> Factors {
    let folder = tempfile::tempdir().unwrap();
    let btf = Btf::open(&write_btf(folder.path(), shape, dtype, samples)).unwrap();
    factorize(&btf, &settings, &|_| ()).unwrap()
}

pub(crate) fn settings(components: u32) -> Settings {
    Settings {
        components,
        memory_bytes: 1 << 30,
        ..Settings::default()
    }
}

/// Largest deviation of the scaled Gram matrix of `factor` `[component][index]` from the identity.
pub(crate) fn defect(factor: &[f32], length: usize, components: usize) -> f64 {
    let mut worst = 0f64;
    for i in 0..components {
        for j in 0..components {
            let (a, b) = (&factor[i * length..][..length], &factor[j * length..][..length]);
            let product: f64 = a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum();
            worst = worst.max((product / length as f64 - f64::from(i == j)).abs());
        }
    }
    worst
}

/// Where what a BTF has besides its leading terms is less than this share of its norm, passes end: further ones are not worth their time, and
/// of the tail the subspace holds what it happens to. A third of what rounding factors to half floats costs.
const TAIL: f64 = 1e-4;

/// Everything that must hold for every BTF, whatever its spectrum.
pub(crate) fn check(shape: Shape, dtype: Dtype, samples: &[f32], components: u32) {
    let factors = run(shape, dtype, samples, settings(components));
    let (rows, columns) = (shape.rows(), shape.columns());
    let exact = stored(samples, dtype);
    let truth = singular_values(&exact, rows, columns);
    let norm = exact.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert_eq!((factors.rows, factors.columns), (rows, columns));
    assert!((factors.energy.sqrt() - norm).abs() <= 1e-12 * norm);

    // Stated and true error of these very factors.
    let measured = product_error(&exact, rows, columns, &factors.u, &factors.v);
    let stated = factors.relative_error();
    assert!(
        (stated - measured).abs() <= 0.01 * measured + 2e-7,
        "stated {stated}, measured {measured}"
    );

    // No worse than the best of this rank, but for what a random subspace misses.
    let kept = truth.len().min(components as usize);
    let best = truth[kept..].iter().map(|x| x * x).sum::<f64>().sqrt() / norm.max(f64::MIN_POSITIVE);
    assert!(measured <= best * 1.02 + TAIL, "measured {measured}, best {best}");

    // Never above the truth; below it by what the subspace misses, which is most where noise is flat.
    for (value, truth) in factors.singular_values.iter().zip(&truth) {
        assert!(
            *value <= truth * (1.0 + 1e-5) + 1e-6 * norm,
            "{value} for {truth}"
        );
        assert!(*value >= truth * 0.9 - TAIL * norm, "{value} for {truth}");
    }
    if norm > 0.0 {
        let defect = defect(&factors.u, rows, factors.components);
        assert!(defect < 1e-5, "U' is orthonormal but for {defect}");
    }
    assert!(factors.u.iter().chain(&factors.v).all(|value| value.is_finite()));
}
