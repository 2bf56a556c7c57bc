//! Eigen-ABRDFs with loss: errors within bounds, few bytes, and no panic on any bytes.

use half::f16;
use proptest::prelude::*;
use tileset::{
    Column, Direction, Error,
    codec::{
        columns::{ColumnTables, EncodedColumns, MAX_COLUMN_TABLE_BYTES, column_step, encode_columns},
        encode_column,
    },
};

/// Directions spread over the hemisphere down to 75 degrees, by the golden angle.
fn directions(count: usize) -> Vec<Direction> {
    (0..count)
        .map(|i| Direction {
            theta: 1.3 * (i as f64 / count as f64).sqrt(),
            phi: i as f64 * 2.399_963 % std::f64::consts::TAU,
        })
        .collect()
}

/// Highlights about mirror directions that differ by component, and noise; RMS of each component is 1.
fn highlights(views: &[Direction], lights: &[Direction], components: usize, noise: f64) -> Vec<f32> {
    let mut state = 1u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut all = Vec::new();
    for component in 0..components {
        let tilt = [0.3 * (component as f64).sin(), 0.3 * (component as f64).cos()];
        let mut samples = Vec::new();
        for o in views.iter().map(|view| view.to_vector()) {
            for i in lights.iter().map(|light| light.to_vector()) {
                let half: [f64; 3] = std::array::from_fn(|axis| o[axis] + i[axis]);
                let d = [half[0] / half[2] - tilt[0], half[1] / half[2] - tilt[1]];
                let lobe = (-3.0 * (d[0] * d[0] + d[1] * d[1])).exp();
                samples.extend([1.0, 0.8, 0.5].map(|colour| colour * lobe + noise * random()));
            }
        }
        let rms = (samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64).sqrt();
        all.extend(samples.iter().map(|x| (x / rms) as f32));
    }
    all
}

/// Root mean square error of each component, from the decoded records, with tables that went through bytes.
fn errors(
    encoded: &EncodedColumns,
    views: &[Direction],
    lights: &[Direction],
    samples: &[f32],
    steps: &[f64],
) -> Vec<f64> {
    let bytes = encoded.tables.to_bytes().unwrap();
    assert!(bytes.len() <= MAX_COLUMN_TABLE_BYTES as usize);
    let tables = ColumnTables::from_bytes(&bytes, views, lights).unwrap();
    let rows = views.len() * lights.len() * 3;
    assert_eq!(encoded.records.len(), steps.len().div_ceil(4));
    let mut errors = Vec::new();
    for (group, record) in encoded.records.iter().enumerate() {
        let column = tables.decode(group as u16, steps, record).unwrap();
        assert_eq!(
            column,
            encoded.tables.decode(group as u16, steps, record).unwrap()
        );
        assert_eq!(column.texels.len(), rows);
        for c in 0..4 {
            match samples.get((group * 4 + c) * rows..(group * 4 + c + 1) * rows) {
                Some(samples) => {
                    let squares =
                        column.texels.iter().zip(samples).map(|(texel, sample)| {
                            (f64::from(texel[c].to_f32()) - f64::from(*sample)).powi(2)
                        });
                    errors.push((squares.sum::<f64>() / rows as f64).sqrt());
                }
                None => assert!(column.texels.iter().all(|texel| texel[c] == f16::ZERO)),
            }
        }
    }
    errors
}

#[test]
fn errors_follow_the_steps_and_bytes_are_few() {
    let (views, lights) = (directions(21), directions(30));
    let samples = highlights(&views, &lights, 7, 0.02);
    let rows = 21 * 30 * 3;
    let mut last = usize::MAX;
    for step in [0.01, 0.1, 0.5] {
        let steps: Vec<f64> = (0..7).map(|c| step * (1.0 + f64::from(c))).collect();
        let encoded = encode_columns(&views, &lights, &samples, &steps).unwrap();
        for (error, step) in errors(&encoded, &views, &lights, &samples, &steps)
            .iter()
            .zip(&steps)
        {
            // Uniform noise within half a step, a little more for what is rounded to save bytes.
            assert!(*error < 0.45 * step + 1e-3, "{error} at step {step}");
        }
        let bytes: usize = encoded.records.iter().map(Vec::len).sum();
        assert!(bytes < last);
        last = bytes;
    }
    let column = Column {
        texels: (0..rows)
            .map(|i| std::array::from_fn(|c| f16::from_f32(samples[c * rows + i])))
            .collect(),
    };
    let lossless = encode_column(&column).unwrap().len();
    assert!(
        last * 20 < lossless * 2,
        "{last} bytes of two groups, {lossless} of one without loss"
    );
}

#[test]
fn the_step_of_equal_slopes_is_the_one_for_the_least_bytes() {
    // σ²·s²/12 against Δ²/12 with m and n samples: moving either step a little at equal total error must not
    // save bits, by the rate m·log2(1/s) + n·log2(1/Δ).
    let (sigma, page, rows, texels) = (0.3, 0.01, 19_683, 65_536u64);
    let step = column_step(page, sigma, rows, texels);
    let error = |page: f64, step: f64| page * page + sigma * sigma * step * step;
    let bits = |page: f64, step: f64| -(rows as f64 * step.log2() + texels as f64 * page.log2());
    let best = bits(page, step);
    for factor in [0.5, 0.9, 0.99, 1.01, 1.1] {
        let other = step * factor;
        let rest = error(page, step) - error(0.0, other);
        assert!(rest > 0.0 && bits(rest.sqrt(), other) > best, "{factor}");
    }
    assert_eq!(column_step(page, 0.0, rows, texels), f64::INFINITY);
}

#[test]
fn components_of_little_worth_take_nothing() {
    let (views, lights) = (directions(5), directions(6));
    let samples = highlights(&views, &lights, 5, 0.1);
    let steps = [0.1, f64::INFINITY, 1e4, f64::INFINITY, f64::INFINITY];
    let encoded = encode_columns(&views, &lights, &samples, &steps).unwrap();
    assert_eq!(encoded.records[1].len(), 4);
    let errors = errors(&encoded, &views, &lights, &samples, &steps);
    assert!(errors[0] < 0.05);
    assert!(
        errors[1..].iter().all(|error| (error - 1.0).abs() < 1e-5),
        "{errors:?}"
    );
}

#[test]
fn zeros_constants_and_extremes_round_trip() {
    for (views, lights) in [(1, 1), (1, 9), (9, 1), (2, 300)] {
        let (views, lights) = (directions(views), directions(lights));
        let rows = views.len() * lights.len() * 3;
        for (value, step) in [
            (0.0, 0.1),
            (1.0, 0.1),
            (-65504.0, 1.0),
            (6e-8, 1e-6),
            (3e-5, 1e-7),
            (1.0, 1e-5),
        ] {
            let samples: Vec<f32> = (0..rows)
                .map(|i| if i % 2 == 0 { value } else { -value / 3.0 })
                .collect();
            let encoded = encode_columns(&views, &lights, &samples, &[step]).unwrap();
            let errors = errors(&encoded, &views, &lights, &samples, &[step]);
            // Half floats have 11 bits, and steps of 6e-8 at least; f32 rounds in the transform.
            let bound = step + f64::from(value).abs() / 2048.0 + 6e-8;
            assert!(errors[0] <= bound, "{value} at step {step}: {}", errors[0]);
        }
    }
}

#[test]
fn what_cannot_be_coded_is_named() {
    let (views, lights) = (directions(2), directions(3));
    let good = vec![0.5f32; 18];
    let refusal = |samples: &[f32], steps: &[f64]| match encode_columns(&views, &lights, samples, steps) {
        Err(error @ Error::Invalid { .. }) => error.to_string(),
        other => panic!("{other:?}"),
    };
    for bad in [f32::NAN, f32::INFINITY, 7e4] {
        let mut samples = good.clone();
        samples[7] = bad;
        assert!(refusal(&samples, &[0.1]).contains("sample 7 of eigen-ABRDF 0"));
    }
    for step in [0.0, -1.0, f64::NAN, 1e-50] {
        assert!(refusal(&good, &[step]).contains("quantizer step"), "{step}");
    }
    assert!(refusal(&good, &[1e-9]).contains("too small"));
    assert!(refusal(&good, &[]).contains("18 samples"));
    assert!(refusal(&good, &[1.0, 1.0]).contains("18 samples"));
    assert!(matches!(
        encode_columns(&[], &lights, &[], &[1.0]),
        Err(Error::Invalid { .. })
    ));
    let many = directions(4096);
    assert!(matches!(
        encode_columns(&many, &many, &[], &[1.0]),
        Err(Error::OverLimit { .. })
    ));
}

/// A small archive's columns.
fn small() -> (Vec<Direction>, Vec<Direction>, EncodedColumns, [f64; 4]) {
    let (views, lights) = (directions(6), directions(7));
    let steps = [0.05, 0.1, 0.2, 0.4];
    let samples = highlights(&views, &lights, 4, 0.1);
    let encoded = encode_columns(&views, &lights, &samples, &steps).unwrap();
    (views, lights, encoded, steps)
}

#[test]
fn damaged_records_are_refused_or_harmless() {
    let (_, _, encoded, steps) = small();
    let record = &encoded.records[0];
    let refused = |bytes: &[u8]| {
        matches!(
            encoded.tables.decode(0, &steps, bytes),
            Err(Error::Corrupt { .. })
        )
    };
    for length in 0..8 {
        assert!(refused(&record[..length]), "{length} bytes");
    }
    assert!(refused(&[&record[..], &[0, 0]].concat()));
    assert!(refused(&[128, 128, 128, 128, 0]));
    // Others may be valid: checksums are the container's. What comes out of them is finite all the same.
    let cuts = (8..record.len()).map(|length| record[..length].to_vec());
    let flips = (32..record.len() * 8).map(|bit| {
        let mut bad = record.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        bad
    });
    for bad in cuts.chain(flips) {
        if let Ok(column) = encoded.tables.decode(0, &steps, &bad) {
            assert!(column.texels.iter().flatten().all(|value| value.is_finite()));
        }
    }
    // A group that there is not has no steps.
    assert!(matches!(
        encoded.tables.decode(1, &steps, record),
        Err(Error::Corrupt { .. })
    ));
}

#[test]
fn damaged_tables_are_refused_or_harmless() {
    let (views, lights, encoded, steps) = small();
    let bytes = encoded.tables.to_bytes().unwrap();
    let read = |bytes: &[u8]| ColumnTables::from_bytes(bytes, &views, &lights);
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length]).is_err(), "{length} bytes");
    }
    assert!(ColumnTables::from_bytes(&bytes, &views[1..], &lights).is_err());
    // Behind zstd: any byte of the content changed to any of some values.
    let raw = zstd::bulk::decompress(&bytes, 1 << 16).unwrap();
    for at in 0..raw.len() {
        for value in [0, 1, 127, 128, 255, raw[at].wrapping_add(1)] {
            let mut bad = raw.clone();
            bad[at] = value;
            if let Ok(tables) = read(&zstd::bulk::compress(&bad, 1).unwrap()) {
                let _ = tables.decode(0, &steps, &encoded.records[0]);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_samples_come_back_within_a_step(
        views in 1usize..6,
        lights in 1usize..6,
        seed in prop::collection::vec(-3.0f32..3.0, 1..50),
        exponents in prop::collection::vec(-8i32..3, 1..7),
    ) {
        let (views, lights) = (directions(views), directions(lights));
        let steps: Vec<f64> = exponents.iter().map(|&e| f64::from(e).exp2()).collect();
        let count = views.len() * lights.len() * 3 * steps.len();
        let samples: Vec<f32> = (0..count).map(|i| seed[i * i % seed.len()]).collect();
        let encoded = encode_columns(&views, &lights, &samples, &steps).unwrap();
        for (error, step) in errors(&encoded, &views, &lights, &samples, &steps).iter().zip(&steps) {
            prop_assert!(*error <= step + 2e-3, "{} at step {}", error, step);
        }
    }

    #[test]
    fn noise_is_no_panic(
        levels in prop::array::uniform4(any::<u8>()),
        noise in prop::collection::vec(any::<u8>(), 0..300),
        exponent in -30i32..30,
    ) {
        let (views, lights, encoded, _) = small();
        let steps = [10f64.powi(exponent); 4];
        let _ = encoded.tables.decode(0, &steps, &[&levels[..], &noise].concat());
        let _ = encoded.tables.decode(0, &steps, &noise);
        prop_assert!(ColumnTables::from_bytes(&noise, &views, &lights).is_err());
    }
}
