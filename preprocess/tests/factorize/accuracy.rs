//! Errors against exact factorizations: accuracy, degenerate and high dynamic range materials, memory, weights.

use preprocess::factorize::factorize;
use preprocess::npy::Dtype;
use preprocess::{Btf, Error, Factors, Settings, Weights};
use proptest::prelude::*;

use crate::common::{Shape, material, noise, product_error, stored, write_btf};
use crate::support::{check, run, settings};

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
fn weights_choose_other_textures_for_the_same_product() {
    let shape = Shape {
        views: 6,
        lights: 7,
        width: 20,
        height: 16,
    };
    // A few images far brighter than the others.
    let mut samples = material(shape, 30, 0.05, 8);
    let image = 3 * shape.columns();
    samples[5 * image..7 * image]
        .iter_mut()
        .for_each(|sample| *sample *= sample.abs() * 50.0);
    let exact = stored(&samples, Dtype::F32);
    let plain = run(shape, Dtype::F32, &samples, settings(6));
    for weights in [Weights::SolidAngle, Weights::Robust] {
        let with = Settings {
            weights,
            ..settings(6)
        };
        let factors = run(shape, Dtype::F32, &samples, with);
        let weighted = factors.weighted.clone().unwrap();
        let error_in = |factors: &Factors| {
            let (mut energy, mut all) = (0.0, 0.0);
            for (row, samples) in exact.chunks_exact(shape.columns()).enumerate() {
                for (column, sample) in samples.iter().enumerate() {
                    let term = |c: usize| {
                        let (u, v) = (
                            factors.u[c * shape.rows() + row],
                            factors.v[c * shape.columns() + column],
                        );
                        f64::from(u) * f64::from(v)
                    };
                    let product: f64 = (0..factors.components).map(term).sum();
                    energy += f64::from(weighted.weights[row]) * (sample - product).powi(2);
                    all += (sample - product).powi(2);
                }
            }
            (energy, all)
        };
        // Both errors are exact, also of fewer terms, and each is least where it was asked for.
        for factors in [&factors, &factors.truncated(3)] {
            let (energy, all) = error_in(factors);
            let stated = factors.weighted.as_ref().unwrap().residual_energy;
            assert!(
                (stated / energy - 1.0).abs() < 0.01,
                "{weights:?}: {stated}, {energy}"
            );
            assert!((factors.residual_energy / all - 1.0).abs() < 0.01, "{weights:?}");
        }
        assert!(error_in(&factors).0 < error_in(&plain).0, "{weights:?}");
        assert!(error_in(&factors).1 > error_in(&plain).1, "{weights:?}");
    }
}

#[test]
fn a_single_pass_estimates_its_error() {
    let shape = Shape {
        views: 20,
        lights: 18,
        width: 40,
        height: 30,
    };
    let samples = material(shape, 60, 0.02, 9);
    let once = run(
        shape,
        Dtype::F16,
        &samples,
        Settings {
            passes: Some(1),
            ..settings(20)
        },
    );
    assert_eq!((once.statistics.passes, once.estimated), (1, true));
    let exact = stored(&samples, Dtype::F16);
    let measured = product_error(&exact, shape.rows(), shape.columns(), &once.u, &once.v);
    let stated = once.relative_error();
    assert!(
        (stated / measured - 1.0).abs() < 0.15,
        "stated {stated}, measured {measured}"
    );
    let thorough = run(shape, Dtype::F16, &samples, settings(20)).relative_error();
    assert!(measured < 3.0 * thorough, "{measured} beside {thorough}");
}
