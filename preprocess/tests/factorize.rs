//! Factorization against naive f64 algebra.

mod common;

use common::{Shape, material, noise, product_error, singular_values, stored, write_btf};
use std::ops::Range;
use std::path::Path;

use preprocess::factorize::{Enough, factorize};
use preprocess::npy::{Dtype, Samples};
use preprocess::source::{Images, LowRank};
use preprocess::{Btf, Error, Factors, Settings, Weights};
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

/// 300 rows of 20,000 texels.
const WIDE: Shape = Shape {
    views: 10,
    lights: 10,
    width: 200,
    height: 100,
};

#[test]
fn equal_samples_do_not_add_up_their_rounding() {
    let mut random = noise(6);
    // Constant; nearly so; and half of the texels clipped beside others that are not.
    for noise_size in [0.0, 1e-6, 1e-3] {
        let samples: Vec<f32> = (0..WIDE.samples()).map(|_| 0.7 + noise_size * random()).collect();
        let factors = run(WIDE, Dtype::F32, &samples, settings(1));
        let exact = stored(&samples, Dtype::F32);
        let measured = product_error(&exact, WIDE.rows(), WIDE.columns(), &factors.u, &factors.v);
        // The noise is all that a rank-one product leaves out: uniform, of a third of its size squared.
        let best = f64::from(noise_size) / 3f64.sqrt() / 0.7;
        assert!(measured < 1.01 * best + 2e-7, "{measured} for {best}");
        let stated = factors.relative_error();
        assert!(
            (stated - measured).abs() < 0.01 * measured + 2e-7,
            "{stated} for {measured}"
        );
    }
    let clipped: Vec<f32> = (0..WIDE.samples())
        .map(|index| {
            if index % WIDE.columns() < 14_000 {
                1.0
            } else {
                0.5 + 0.03 * random()
            }
        })
        .collect();
    let factors = run(WIDE, Dtype::F16, &clipped, settings(2));
    let exact = stored(&clipped, Dtype::F16);
    let measured = product_error(&exact, WIDE.rows(), WIDE.columns(), &factors.u, &factors.v);
    assert!((factors.relative_error() / measured - 1.0).abs() < 0.01);
}

#[test]
fn samples_of_any_size_come_out_alike() {
    let shape = Shape {
        views: 4,
        lights: 3,
        width: 24,
        height: 20,
    };
    let samples = material(shape, 20, 0.02, 3);
    let usual = run(shape, Dtype::F32, &samples, settings(6));
    for (exponent, passes) in [
        (-128, None),
        (-60, None),
        (37, None),
        (-60, Some(1)),
        (37, Some(1)),
    ] {
        let scale = 2f64.powi(exponent);
        let scaled: Vec<f32> = samples.iter().map(|&x| (f64::from(x) * scale) as f32).collect();
        let with = Settings {
            passes,
            ..settings(6)
        };
        let usual = match passes {
            Some(_) => run(shape, Dtype::F32, &samples, with),
            None => usual.clone(),
        };
        let factors = run(shape, Dtype::F32, &scaled, with);
        assert_eq!(factors.components, usual.components);
        // Below 2⁻¹²⁶ samples and textures themselves have fewer bits.
        let tolerance = if exponent < -100 { 1e-3 } else { 1e-5 };
        assert!((factors.relative_error() / usual.relative_error() - 1.0).abs() < tolerance);
        for (a, b) in factors.singular_values.iter().zip(&usual.singular_values) {
            assert!(
                (a / scale / b - 1.0).abs() < tolerance,
                "{a} for {b} at 2^{exponent}"
            );
        }
        let exact = stored(&scaled, Dtype::F32);
        let measured = product_error(&exact, shape.rows(), shape.columns(), &factors.u, &factors.v);
        if passes.is_none() {
            assert!((factors.relative_error() / measured - 1.0).abs() < 0.01);
        }
    }
    // An error that is enough is one of the samples as they are.
    let scaled: Vec<f32> = samples.iter().map(|&x| x * 2f32.powi(-60)).collect();
    let enough = |rms| Settings {
        enough: Some(Enough::Rms(rms)),
        ..settings(30)
    };
    let wanted = usual.rank_rms();
    let (plain, scaled) = (
        run(shape, Dtype::F32, &samples, enough(wanted)),
        run(shape, Dtype::F32, &scaled, enough(wanted * 2f64.powi(-60))),
    );
    assert!(plain.rank_rms() <= wanted);
    assert_eq!(plain.components, scaled.components);
}

#[test]
fn passes_are_as_many_as_are_worth_it() {
    let passes = |samples: &[f32], settings: Settings| {
        let factors = run(WIDE, Dtype::F32, samples, settings);
        (factors.statistics.passes, factors)
    };
    // Five terms: after the sketch one pass finds them all, and one measures and refines.
    let mut random = noise(8);
    let u: Vec<[f32; 5]> = (0..WIDE.rows()).map(|_| [(); 5].map(|()| random())).collect();
    let v: Vec<[f32; 5]> = (0..WIDE.columns()).map(|_| [(); 5].map(|()| random())).collect();
    let product = |(u, v): (&[f32; 5], &[f32; 5])| u.iter().zip(v).map(|(u, v)| u * v).sum::<f32>();
    let five: Vec<f32> = u
        .iter()
        .flat_map(|u| v.iter().map(move |v| product((u, v))))
        .collect();
    let (count, factors) = passes(&five, settings(20));
    assert_eq!((count, factors.components), (3, 5));
    assert!(factors.relative_error() < 2e-7);
    // What is seldom asked for is given: a fixed number.
    let fixed = |passes| Settings {
        passes: Some(passes),
        ..settings(20)
    };
    assert_eq!(passes(&five, fixed(5)).0, 6);

    // Terms that fall slowly: 300 of them, like 1/√c, where each block adds much.
    let slow: Vec<f32> = {
        let amplitude = |row: usize| 1.0 / (1.0 + row as f32 / 40.0).sqrt();
        (0..WIDE.samples())
            .map(|index| amplitude(index / WIDE.columns()) * random())
            .collect()
    };
    let (count, factors) = passes(&slow, settings(20));
    let (usual, four) = passes(&slow, fixed(4));
    assert_eq!(usual, 4);
    assert!(count > 4, "{count} passes");
    assert!(factors.residual_energy < four.residual_energy);
}

#[test]
fn the_subspace_grows_until_the_error_is_met() {
    let shape = Shape {
        views: 12,
        lights: 10,
        width: 30,
        height: 20,
    };
    let samples = material(shape, 150, 0.01, 12);
    let mut components = Vec::new();
    for error in [0.2, 0.05, 0.02] {
        let grown = Settings {
            enough: Some(Enough::Relative(error)),
            ..settings(1024)
        };
        let factors = run(shape, Dtype::F16, &samples, grown);
        let found = factors.relative_error();
        assert!(found <= error, "{found} for {error}");
        // One term less would not do.
        assert!(factors.residual_energy_of(factors.components - 1) > error * error * factors.energy);
        components.push(factors.components);
    }
    assert!(components.is_sorted_by(|a, b| a < b), "{components:?}");
}

/// A BTF whose file holds factors.
#[derive(Debug)]
struct Product(LowRank);

impl Images for Product {
    fn format(&self) -> String {
        "factors".into()
    }

    fn stored_bytes(&self) -> u64 {
        0
    }

    fn samples<'a>(&'a self, _: Range<usize>, _: &'a mut Vec<f32>) -> preprocess::Result<Samples<'a>> {
        panic!("its samples need not be read")
    }

    fn place(&self, image: usize) -> String {
        image.to_string()
    }

    fn low_rank(&self) -> preprocess::Result<Option<LowRank>> {
        Ok(Some(self.0.clone()))
    }
}

#[test]
fn factors_in_a_file_are_not_factorized_again() {
    let (views, lights, width, height) = (5, 4, 13, 9);
    let (rows, columns) = (views * lights * 3, (width * height) as usize);
    let mut random = noise(4);
    for (terms, copies) in [(7, 1), (7, 2), (40, 1), (1, 1)] {
        // Terms that are neither orthogonal nor sorted, of very different sizes; some twice.
        let mut product = LowRank {
            terms: terms * copies,
            ..LowRank::default()
        };
        for term in 0..terms {
            let size = 10f32.powi(2 - (term as i32 * 5) % 7);
            let u: Vec<f32> = (0..rows).map(|_| 0.3 + random()).collect();
            let v: Vec<f32> = (0..columns).map(|_| size * (0.2 + random())).collect();
            for _ in 0..copies {
                product.u.extend(&u);
                product.v.extend(&v);
            }
        }
        let exact: Vec<f64> = (0..rows * columns)
            .map(|at| {
                let term = |t: usize| {
                    f64::from(product.u[t * rows + at / columns])
                        * f64::from(product.v[t * columns + at % columns])
                };
                (0..product.terms).map(term).sum()
            })
            .collect();
        let images = Box::new(Product(product));
        let sampling = common::sampling(views, lights);
        let btf = Btf::new(Path::new("product.btf"), sampling, (width, height), images).unwrap();
        let truth = singular_values(&exact, rows, columns);
        let norm = exact.iter().map(|x| x * x).sum::<f64>().sqrt();
        for components in [1, 3, 60] {
            let factors = factorize(&btf, &settings(components), &|_| ()).unwrap();
            assert_eq!(factors.statistics.passes, 0);
            assert!((factors.energy.sqrt() / norm - 1.0).abs() < 1e-6);
            let measured = product_error(&exact, rows, columns, &factors.u, &factors.v);
            let stated = factors.relative_error();
            assert!(
                (stated - measured).abs() < 0.01 * measured + 1e-6,
                "{stated}, {measured}"
            );
            for (value, truth) in factors.singular_values.iter().zip(&truth) {
                assert!((value - truth).abs() < 1e-6 * norm, "{value} for {truth}");
            }
            assert!(defect(&factors.u, rows, factors.components) < 1e-5);
            let mean: f64 = exact.iter().sum::<f64>() / exact.len() as f64;
            let stated = factors.mean_rgb.iter().sum::<f64>() / 3.0;
            assert!((mean - stated).abs() < 1e-6 * norm);
        }
    }
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
