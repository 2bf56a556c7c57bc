use super::*;

/// 96×64 pixels of sRGB: waves; and the same with a rectangle tinted, a stripe and a ripple.
fn pictures() -> [Vec<[f64; 3]>; 2] {
    let (width, height) = (96, 64);
    let mut pictures = [Vec::new(), Vec::new()];
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (f64::from(x), f64::from(y));
            let reference = [
                0.5 + 0.4 * (u * 0.21).sin() * (v * 0.13).cos(),
                0.4 + 0.3 * (u * 0.11 + v * 0.07).cos(),
                0.3 + 0.25 * (v * 0.3).sin(),
            ];
            let inside = (16..32).contains(&y) && (24..48).contains(&x);
            let tint = if inside { [1.15, 1.0, 0.8] } else { [1.0; 3] };
            let test: [f64; 3] = std::array::from_fn(|channel| {
                let tinted = reference[channel] * tint[channel];
                let striped = if (46..48).contains(&y) { 0.9 } else { tinted };
                striped + 0.02 * (u * 1.7 + v * 2.3).sin()
            });
            for (picture, pixel) in pictures.iter_mut().zip([test, reference]) {
                picture.push(pixel.map(|channel| channel.clamp(0.0, 1.0)));
            }
        }
    }
    pictures
}

fn linear(picture: &[[f64; 3]]) -> Vec<[f64; 3]> {
    picture
        .iter()
        .map(|pixel| pixel.map(tone::linear_from_srgb))
        .collect()
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!(
        (found - expected).abs() <= tolerance,
        "{found} where {expected} was expected"
    );
}

/// Expected values: `flip_evaluator.evaluate(reference, test, "LDR", applyMagma=False)` of the authors' package flip-evaluator
/// 1.7 (f32) on the pictures above, and with the parameter ppd of 20.
#[test]
fn values_are_those_of_the_authors_program() {
    let [test, reference] = pictures().map(|picture| linear(&picture));
    let map = ldr_flip_map(&test, &reference, 96, PIXELS_PER_DEGREE);
    close(mean(map.clone(), None).unwrap(), 0.10373404622077942, 1e-5);
    for (x, y, expected) in [
        (0, 0, 0.03874359652400017),
        (30, 20, 0.29855823516845703),
        (50, 47, 0.976001501083374),
        (95, 63, 0.05653104931116104),
    ] {
        close(map[y * 96 + x], expected, 2e-5);
    }
    let nearer = ldr_flip_map(&test, &reference, 96, 20.0);
    close(mean(nearer, None).unwrap(), 0.1535007506608963, 1e-5);
}

fn picture(pixels: &[[f64; 3]]) -> Picture {
    Picture {
        width: 96,
        height: 64,
        pixels: pixels
            .iter()
            .map(|pixel| pixel.map(|channel| channel as f32 * 8.0))
            .collect(),
    }
}

/// The same with "HDR", of the pictures above as radiance, times 8.
#[test]
fn hdr_values_are_those_of_the_authors_program() {
    let [test, reference] = pictures().map(|pixels| picture(&pixels));
    let (start, stop) = exposures(&reference);
    close(start, -1.3421361446380615, 1e-5);
    close(stop, -0.7010343670845032, 1e-5);
    let map = hdr_flip_map(&test, &reference, PIXELS_PER_DEGREE).unwrap();
    close(map[20 * 96 + 30], 0.18869498372077942, 1e-4);
    close(
        mean_hdr_flip(&test, &reference, None).unwrap(),
        0.0586882047355175,
        2e-5,
    );
}

#[test]
fn equal_pictures_do_not_differ_and_broken_ones_are_told() {
    let [test, reference] = pictures().map(|pixels| picture(&pixels));
    for stops in [-2.0, 0.0] {
        assert_eq!(mean_flip(&reference, &reference, None, stops), Some(0.0));
        assert!(mean_flip(&test, &reference, None, stops).unwrap() > 0.01);
    }
    assert_eq!(mean_hdr_flip(&reference, &reference, None), Some(0.0));
    let mut broken = test.clone();
    broken.pixels[1234][1] = f32::NAN;
    assert!(mean_flip(&broken, &reference, None, 0.0).unwrap().is_nan());
    assert!(mean_hdr_flip(&broken, &reference, None).unwrap().is_nan());
    let black = Picture {
        pixels: vec![[0.0; 3]; 96 * 64],
        ..reference.clone()
    };
    assert!(mean_flip(&reference, &black, None, 0.0).unwrap() > 0.3);
    assert_eq!(mean_hdr_flip(&black, &black, None), Some(0.0));
    let huge = Picture {
        pixels: vec![[f32::MAX; 3]; 96 * 64],
        ..reference.clone()
    };
    assert!(mean_hdr_flip(&huge, &reference, None).unwrap() > 0.3);
    assert!(mean_hdr_flip(&reference, &huge, None).unwrap() > 0.3);
    // Only what is covered counts, and something must be.
    let covered: Vec<bool> = (0..96 * 64).map(|at| at / 96 == 47).collect();
    let stripe = mean_flip(&test, &reference, Some(&covered), 0.0).unwrap();
    assert!(stripe > 2.0 * mean_flip(&test, &reference, None, 0.0).unwrap());
    assert_eq!(
        mean_flip(&test, &reference, Some(&vec![false; 96 * 64]), 0.0),
        None
    );
    assert_eq!(mean_flip(&test, &reference, Some(&[true]), 0.0), None);
    let turned = Picture {
        width: 64,
        height: 96,
        ..test
    };
    assert_eq!(mean_flip(&turned, &reference, None, 0.0), None);
}

#[test]
fn small_pictures_have_a_difference_too() {
    let one = |value: f32| Picture {
        width: 1,
        height: 1,
        pixels: vec![[value; 3]],
    };
    assert!(mean_flip(&one(0.9), &one(0.1), None, 0.0).unwrap() > 0.3);
    let empty = Picture {
        width: 0,
        height: 0,
        pixels: Vec::new(),
    };
    assert_eq!(mean_flip(&empty, &empty, None, 0.0), None);
}
