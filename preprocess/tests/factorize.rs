//! Factorization against naive f64 algebra.

mod common;

use common::{Shape, material, noise, product_error, singular_values, stored, write_btf};
use preprocess::factorize::factorize;
use preprocess::npy::Dtype;
use preprocess::{Btf, Error, Factors, Settings};
use proptest::prelude::*;

fn run(shape: Shape, dtype: Dtype, samples: &[f32], settings: Settings) -> Factors {
    let folder = tempfile::tempdir().unwrap();
    let btf = Btf::open(&write_btf(folder.path(), shape, dtype, samples)).unwrap();
    factorize(&btf, &settings, &|_| ()).unwrap()
}

fn settings(components: u32) -> Settings {
    Settings {
        components,
        memory_bytes: 1 << 30,
        ..Settings::default()
    }
}

/// Largest deviation of the scaled Gram matrix of `factor` `[component][index]` from the identity.
fn defect(factor: &[f32], length: usize, components: usize) -> f64 {
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

/// Everything that must hold for every BTF, whatever its spectrum.
fn check(shape: Shape, dtype: Dtype, samples: &[f32], components: u32) {
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
    assert!(measured <= best * 1.02 + 2e-6, "measured {measured}, best {best}");

    // Never above the truth; below it by what the subspace misses, which is most where noise is flat.
    for (value, truth) in factors.singular_values.iter().zip(&truth) {
        assert!(
            *value <= truth * (1.0 + 1e-5) + 1e-6 * norm,
            "{value} for {truth}"
        );
        assert!(*value >= truth * 0.9 - 1e-6 * norm, "{value} for {truth}");
    }
    if norm > 0.0 {
        let defect = defect(&factors.u, rows, factors.components);
        assert!(defect < 1e-5, "U' is orthonormal but for {defect}");
    }
    assert!(factors.u.iter().chain(&factors.v).all(|value| value.is_finite()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn errors_are_true_and_factors_orthonormal(
        (views, lights) in (1usize..5, 1usize..5),
        (width, height) in (1usize..12, 1usize..9),
        components in 1u32..20,
        terms in 0usize..12,
        noise_size in prop::sample::select(vec![0.0f32, 1e-3, 0.1, 2.0]),
        half in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let shape = Shape { views, lights, width, height };
        let samples = material(shape, terms, noise_size, seed);
        check(shape, if half { Dtype::F16 } else { Dtype::F32 }, &samples, components);
    }
}

#[test]
fn more_texels_than_panels_and_chunks() {
    // Several panels of texels, several blocks of rows, odd sizes.
    let shape = Shape {
        views: 5,
        lights: 3,
        width: 149,
        height: 61,
    };
    let samples = material(shape, 10, 0.05, 3);
    check(shape, Dtype::F16, &samples, 7);
}

#[test]
fn degenerate_materials() {
    let shape = Shape {
        views: 2,
        lights: 3,
        width: 5,
        height: 3,
    };
    let mut random = noise(1);
    let constant = vec![0.25f32; shape.samples()];
    let zero = vec![0f32; shape.samples()];
    let rank_one: Vec<f32> = {
        let v: Vec<f32> = (0..shape.columns()).map(|_| random()).collect();
        (0..shape.rows())
            .flat_map(|row| v.iter().map(move |v| v * (row as f32 - 7.0)))
            .collect()
    };
    let mut spike = zero.clone();
    spike[17] = 3.0;
    for samples in [&constant, &zero, &rank_one, &spike] {
        check(shape, Dtype::F32, samples, 4);
    }
    for (samples, components) in [(&zero, 1), (&constant, 1), (&rank_one, 1), (&spike, 1)] {
        assert_eq!(
            run(shape, Dtype::F32, samples, settings(4)).components,
            components
        );
    }
    for (views, lights, width, height) in [(1, 1, 1, 1), (1, 1, 7, 5), (4, 2, 1, 1), (1, 9, 2, 1)] {
        let shape = Shape {
            views,
            lights,
            width,
            height,
        };
        check(shape, Dtype::F16, &material(shape, 2, 0.1, 9), 100);
    }
}

#[test]
fn high_dynamic_range() {
    // Texels of 1e5 beside texels of 1e-6, as a highlight beside a shadow.
    let shape = Shape {
        views: 3,
        lights: 4,
        width: 9,
        height: 7,
    };
    let mut random = noise(2);
    let samples: Vec<f32> = (0..shape.samples())
        .map(|i| (1.0 + 0.5 * random()) * if i % 2 == 0 { 1e5 } else { 1e-6 })
        .collect();
    check(shape, Dtype::F32, &samples, 6);
    for scale in [1e-12f32, 1e-6, 1e11] {
        let scaled: Vec<f32> = material(shape, 5, 0.1, 4)
            .iter()
            .map(|x| x * scale / 10.0)
            .collect();
        check(shape, Dtype::F32, &scaled, 6);
    }
}

#[test]
fn slowly_falling_spectra_below_the_precision_of_one_product() {
    // Components down to 1e-5 of the first: their squares, which BᵀB holds, vanish in f32 beside its square.
    let shape = Shape {
        views: 4,
        lights: 4,
        width: 24,
        height: 20,
    };
    let mut random = noise(5);
    let (rows, columns) = (shape.rows(), shape.columns());
    let u: Vec<Vec<f32>> = (0..12).map(|_| (0..rows).map(|_| random()).collect()).collect();
    let v: Vec<Vec<f32>> = (0..12)
        .map(|_| (0..columns).map(|_| random()).collect())
        .collect();
    let sigma = |c: usize| 10f32.powf(-0.45 * c as f32);
    let entry = |row: usize, column: usize| (0..12).map(|c| sigma(c) * u[c][row] * v[c][column]).sum::<f32>();
    let samples: Vec<f32> = (0..rows)
        .flat_map(|r| (0..columns).map(move |c| (r, c)))
        .map(|(r, c)| entry(r, c))
        .collect();
    for components in [4, 8, 10] {
        check(shape, Dtype::F32, &samples, components);
    }
}

#[test]
fn memory_changes_blocks_but_not_the_result() {
    let shape = Shape {
        views: 8,
        lights: 8,
        width: 96,
        height: 64,
    };
    let samples = material(shape, 12, 0.02, 6);
    let folder = tempfile::tempdir().unwrap();
    let btf = Btf::open(&write_btf(folder.path(), shape, Dtype::F16, &samples)).unwrap();
    let with = |memory_bytes| {
        factorize(
            &btf,
            &Settings {
                components: 8,
                memory_bytes,
                ..Settings::default()
            },
            &|_| (),
        )
    };
    let Err(Error::OverBudget { needed_bytes, .. }) = with(1 << 20) else {
        panic!("a MiB cannot be enough")
    };
    let (small, large) = (with(needed_bytes).unwrap(), with(1 << 30).unwrap());
    assert!(small.statistics.block_rows < large.statistics.block_rows);
    assert!((small.relative_error() / large.relative_error() - 1.0).abs() < 1e-4);
    for (a, b) in small.singular_values.iter().zip(&large.singular_values) {
        assert!((a / b - 1.0).abs() < 1e-5);
    }
    let again = with(1 << 30).unwrap();
    assert!(
        again.u == large.u && again.v == large.v,
        "the same seed gives the same bits"
    );
    let passes = u64::from(large.statistics.passes);
    assert_eq!(large.statistics.bytes_read, passes * btf.stored_bytes());
}

#[test]
fn bad_samples_are_named() {
    let shape = Shape {
        views: 3,
        lights: 2,
        width: 5,
        height: 4,
    };
    for (dtype, bad, printed) in [
        (Dtype::F16, f32::NAN, "NaN"),
        (Dtype::F16, f32::INFINITY, "inf"),
        (Dtype::F32, f32::NEG_INFINITY, "-inf"),
        (Dtype::F32, 2e12, "2"),
    ] {
        let mut samples = material(shape, 2, 0.1, 1);
        // View 2, light 1, green, x 3, y 2.
        samples[((2 * 2 + 1) * 3 + 1) * 20 + 2 * 5 + 3] = bad;
        let folder = tempfile::tempdir().unwrap();
        let btf = Btf::open(&write_btf(folder.path(), shape, dtype, &samples)).unwrap();
        let error = factorize(&btf, &settings(4), &|_| ()).unwrap_err();
        let Error::BadSample {
            view: 2,
            light: 1,
            channel: 'g',
            x: 3,
            y: 2,
            ..
        } = error
        else {
            panic!("wrong place: {error}");
        };
        assert!(error.to_string().contains(printed), "{error}");
        assert!(error.to_string().contains("material.npy"), "{error}");
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let shape = Shape {
        views: 1,
        lights: 1,
        width: 2,
        height: 2,
    };
    let folder = tempfile::tempdir().unwrap();
    let btf = Btf::open(&write_btf(folder.path(), shape, Dtype::F16, &[1.0; 12])).unwrap();
    for components in [0, 1025] {
        assert!(matches!(
            factorize(&btf, &settings(components), &|_| ()),
            Err(Error::Invalid { .. })
        ));
    }
}
