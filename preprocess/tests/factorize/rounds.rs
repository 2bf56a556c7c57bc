//! Many texels: rounding, scale, passes, and subspaces that grow.

use preprocess::Settings;
use preprocess::factorize::Enough;
use preprocess::npy::Dtype;

use crate::common::{Shape, material, noise, product_error, stored};
use crate::support::{run, settings};

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
