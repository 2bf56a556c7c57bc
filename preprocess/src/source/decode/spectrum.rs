//! From samples of a spectrum to linear RGB with the primaries of sRGB.
//!
//! A spectrum is taken as reflectance under D65, so that one that is 1 everywhere is white, (1, 1, 1). Between its
//! wavelengths it is linear, beyond the first and the last constant.
//!
//! Source: CIE 015:2018, section 7.1, for the sums; the names of channels are those of Fichet, Pacanowski, Wilkie:
//! An OpenEXR Layout for Spectral Images, 2021, and any others that end in nanometres.

use super::color::RGB_FROM_XYZ;

/// Fewest channels that are taken as a spectrum.
const MIN_CHANNELS: usize = 3;
/// Wavelength of the first row of [`OBSERVER`], and its step, in nanometres.
const FIRST_NM: f64 = 380.0;
const STEP_NM: f64 = 5.0;

/// One channel of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::source) struct Sample {
    /// Among the channels of the image.
    pub(in crate::source) channel: usize,
    /// What a unit of it adds to red, green and blue.
    pub(in crate::source) rgb: [f32; 3],
}

/// The channels of an image that make a spectrum, none if there are fewer than three. Of several layers the one with
/// the most channels is taken, the first by name of equals: S0 and not the other Stokes parameters.
///
/// # Errors
/// If two channels have the same wavelength.
pub(in crate::source) fn samples(names: &[String]) -> Result<Vec<Sample>, String> {
    let mut found: Vec<(&str, f64, usize)> = names
        .iter()
        .enumerate()
        .filter_map(|(channel, name)| wavelength(name).map(|(layer, nm)| (layer, nm, channel)))
        .collect();
    found.sort_by(|a, b| a.0.cmp(b.0).then(a.1.total_cmp(&b.1)));
    let mut layers = found.chunk_by(|a, b| a.0 == b.0);
    let Some(first) = layers.next() else {
        return Ok(Vec::new());
    };
    let layer = layers.fold(
        first,
        |best, layer| if layer.len() > best.len() { layer } else { best },
    );
    if layer.len() < MIN_CHANNELS {
        return Ok(Vec::new());
    }
    if let Some(pair) = layer.windows(2).find(|pair| pair[0].1 == pair[1].1) {
        return Err(format!(
            "has two channels of {} nm, {} and {}",
            pair[0].1, names[pair[0].2], names[pair[1].2]
        ));
    }
    let wavelengths: Vec<f64> = layer.iter().map(|&(_, nm, _)| nm).collect();
    Ok(layer
        .iter()
        .zip(weights(&wavelengths))
        .map(|(&(.., channel), rgb)| Sample {
            channel,
            rgb: rgb.map(|weight| weight as f32),
        })
        .collect())
}

/// Layer and wavelength in nanometres of a channel: `S0.550,5nm`, `T.550nm`, `550.5nm`, `w550nm`.
fn wavelength(name: &str) -> Option<(&str, f64)> {
    let end = name.len().checked_sub(2)?;
    let (number, unit) = name.split_at_checked(end)?;
    if !unit.eq_ignore_ascii_case("nm") {
        return None;
    }
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    let start = if is_number(number) {
        0
    } else {
        number.rfind(|c: char| !c.is_ascii_digit() && c != ',')? + 1
    };
    let (layer, number) = number.split_at_checked(start)?;
    let nm: f64 = number.replace(',', ".").parse().ok()?;
    (nm.is_finite() && nm > 0.0).then_some((layer, nm))
}

/// What a unit of each sample adds to red, green and blue, for rising wavelengths: the sum over the table of the share
/// that the sample has in the spectrum there.
fn weights(wavelengths: &[f64]) -> Vec<[f64; 3]> {
    let mut xyz = vec![[0.0; 3]; wavelengths.len()];
    let last = wavelengths.len() - 1;
    for (row, &[x, y, z, light]) in OBSERVER.iter().enumerate() {
        let nm = FIRST_NM + STEP_NM * row as f64;
        let above = wavelengths.partition_point(|&wavelength| wavelength < nm);
        let (low, high) = (above.saturating_sub(1), above.min(last));
        let share = if low == high {
            0.0
        } else {
            (nm - wavelengths[low]) / (wavelengths[high] - wavelengths[low])
        };
        for (sample, share) in [(low, 1.0 - share.clamp(0.0, 1.0)), (high, share.clamp(0.0, 1.0))] {
            for (sum, value) in xyz[sample].iter_mut().zip([x, y, z]) {
                *sum += share * value * light;
            }
        }
    }
    let rgb: Vec<[f64; 3]> = xyz
        .into_iter()
        .map(|xyz| RGB_FROM_XYZ.map(|row| row.iter().zip(&xyz).map(|(a, b)| a * b).sum()))
        .collect();
    // White is (1, 1, 1) exactly: the sums of the table miss the chromaticity of D65 in the fourth digit.
    let white: [f64; 3] = std::array::from_fn(|channel| rgb.iter().map(|rgb| rgb[channel]).sum());
    rgb.into_iter()
        .map(|rgb| std::array::from_fn(|channel| rgb[channel] / white[channel]))
        .collect()
}

/// From 380 to 780 nm: x̄, ȳ, z̄ of the CIE 1931 standard observer, and D65. Source: CIE 018:2019; the digits
/// are those of colour-science 0.4.7.
#[rustfmt::skip]
const OBSERVER: [[f64; 4]; 81] = [
    [0.001368, 0.000039, 0.00645, 49.9755], [0.002236, 0.000064, 0.01055, 52.3118], [0.004243, 0.00012, 0.02005, 54.6482],
    [0.00765, 0.000217, 0.03621, 68.7015], [0.01431, 0.000396, 0.06785, 82.7549], [0.02319, 0.00064, 0.1102, 87.1204],
    [0.04351, 0.00121, 0.2074, 91.486], [0.07763, 0.00218, 0.3713, 92.4589], [0.13438, 0.004, 0.6456, 93.4318],
    [0.21477, 0.0073, 1.03905, 90.057], [0.2839, 0.0116, 1.3856, 86.6823], [0.3285, 0.01684, 1.62296, 95.7736],
    [0.34828, 0.023, 1.74706, 104.865], [0.34806, 0.0298, 1.7826, 110.936], [0.3362, 0.038, 1.77211, 117.008],
    [0.3187, 0.048, 1.7441, 117.41], [0.2908, 0.06, 1.6692, 117.812], [0.2511, 0.0739, 1.5281, 116.336],
    [0.19536, 0.09098, 1.28764, 114.861], [0.1421, 0.1126, 1.0419, 115.392], [0.09564, 0.13902, 0.81295, 115.923],
    [0.05795, 0.1693, 0.6162, 112.367], [0.03201, 0.20802, 0.46518, 108.811], [0.0147, 0.2586, 0.3533, 109.082],
    [0.0049, 0.323, 0.272, 109.354], [0.0024, 0.4073, 0.2123, 108.578], [0.0093, 0.503, 0.1582, 107.802],
    [0.0291, 0.6082, 0.1117, 106.296], [0.06327, 0.71, 0.07825, 104.79], [0.1096, 0.7932, 0.05725, 106.239],
    [0.1655, 0.862, 0.04216, 107.689], [0.22575, 0.91485, 0.02984, 106.047], [0.2904, 0.954, 0.0203, 104.405],
    [0.3597, 0.9803, 0.0134, 104.225], [0.43345, 0.99495, 0.00875, 104.046], [0.51205, 1.0, 0.00575, 102.023],
    [0.5945, 0.995, 0.0039, 100.0], [0.6784, 0.9786, 0.00275, 98.1671], [0.7621, 0.952, 0.0021, 96.3342],
    [0.8425, 0.9154, 0.0018, 96.0611], [0.9163, 0.87, 0.00165, 95.788], [0.9786, 0.8163, 0.0014, 92.2368],
    [1.0263, 0.757, 0.0011, 88.6856], [1.0567, 0.6949, 0.001, 89.3459], [1.0622, 0.631, 0.0008, 90.0062],
    [1.0456, 0.5668, 0.0006, 89.8026], [1.0026, 0.503, 0.00034, 89.5991], [0.9384, 0.4412, 0.00024, 88.6489],
    [0.85445, 0.381, 0.00019, 87.6987], [0.7514, 0.321, 0.0001, 85.4936], [0.6424, 0.265, 0.00005, 83.2886],
    [0.5419, 0.217, 0.00003, 83.4939], [0.4479, 0.175, 0.00002, 83.6992], [0.3608, 0.1382, 0.00001, 81.863],
    [0.2835, 0.107, 0.0, 80.0268], [0.2187, 0.0816, 0.0, 80.1207], [0.1649, 0.061, 0.0, 80.2146],
    [0.1212, 0.04458, 0.0, 81.2462], [0.0874, 0.032, 0.0, 82.2778], [0.0636, 0.0232, 0.0, 80.281],
    [0.04677, 0.017, 0.0, 78.2842], [0.0329, 0.01192, 0.0, 74.0027], [0.0227, 0.00821, 0.0, 69.7213],
    [0.01584, 0.005723, 0.0, 70.6652], [0.011359, 0.004102, 0.0, 71.6091], [0.008111, 0.002929, 0.0, 72.979],
    [0.00579, 0.002091, 0.0, 74.349], [0.004109, 0.001484, 0.0, 67.9765], [0.002899, 0.001047, 0.0, 61.604],
    [0.002049, 0.00074, 0.0, 65.7448], [0.00144, 0.00052, 0.0, 69.8856], [0.001, 0.000361, 0.0, 72.4863],
    [0.00069, 0.000249, 0.0, 75.087], [0.000476, 0.000172, 0.0, 69.3398], [0.000332, 0.00012, 0.0, 63.5927],
    [0.000235, 0.000085, 0.0, 55.0054], [0.000166, 0.00006, 0.0, 46.4182], [0.000117, 0.000042, 0.0, 56.6118],
    [0.000083, 0.00003, 0.0, 66.8054], [0.000059, 0.000021, 0.0, 65.0941], [0.000042, 0.000015, 0.0, 63.3828],
];

#[cfg(test)]
mod tests {
    use super::*;

    fn convert(wavelengths: &[f64], spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
        let weights = weights(wavelengths);
        std::array::from_fn(|rgb| {
            wavelengths
                .iter()
                .zip(&weights)
                .map(|(&nm, weights)| spectrum(nm) * weights[rgb])
                .sum()
        })
    }

    fn every(first: f64, step: f64, count: usize) -> Vec<f64> {
        (0..count).map(|i| first + step * i as f64).collect()
    }

    /// A step at 560 nm with a bump at 450 nm.
    fn orange(nm: f64) -> f64 {
        0.15 + 0.6 / (1.0 + (-(nm - 560.0) / 18.0).exp()) + 0.1 * (-((nm - 450.0) / 25.0).powi(2)).exp()
    }

    /// The values are those of colour-science 0.4.7, `sd_to_XYZ(…, method="Integration")` with D65 and steps of 5 nm,
    /// then `XYZ_to_sRGB(…, apply_cctf_encoding=False)`.
    #[test]
    fn spectra_become_the_colours_that_the_cie_says() {
        let expected = [0.87443, 0.32879, 0.18982];
        for (wavelengths, bound) in [
            (every(380.0, 5.0, 81), 4e-4),
            (every(400.0, 10.0, 31), 2e-3),
            (every(400.0, 20.0, 16), 1e-2),
        ] {
            let rgb = convert(&wavelengths, orange);
            for (rgb, expected) in rgb.into_iter().zip(expected) {
                assert!((rgb - expected).abs() < bound, "{rgb} {expected} {wavelengths:?}");
            }
        }
        for wavelengths in [
            every(450.0, 100.0, 3),
            every(380.0, 1.0, 401),
            every(1000.0, 1.0, 3),
        ] {
            let grey = convert(&wavelengths, |_| 0.25);
            assert!(grey.iter().all(|value| (value - 0.25).abs() < 1e-12), "{grey:?}");
        }
    }

    #[test]
    fn wavelengths_are_found_in_names() {
        assert_eq!(wavelength("S0.550,5nm"), Some(("S0.", 550.5)));
        assert_eq!(wavelength("T.400nm"), Some(("T.", 400.0)));
        assert_eq!(wavelength("400.25NM"), Some(("", 400.25)));
        assert_eq!(wavelength("w700nm"), Some(("w", 700.0)));
        for other in ["R", "nm", "T.nm", "0nm", "S0.1,2,3nm", "…nm", "é5n", "T.400Hz"] {
            assert_eq!(wavelength(other), None, "{other}");
        }
        let names = |names: &[&str]| samples(&names.iter().map(ToString::to_string).collect::<Vec<_>>());
        let channels = |found: Vec<Sample>| found.iter().map(|sample| sample.channel).collect::<Vec<_>>();
        let stokes = [
            "R", "S1.500nm", "S1.600nm", "S1.400nm", "S0.600nm", "S0.500nm", "S0.400nm",
        ];
        assert_eq!(channels(names(&stokes).unwrap()), [6, 5, 4]);
        assert_eq!(names(&["400nm", "500nm"]), Ok(Vec::new()));
        let twice = names(&["T.400nm", "T.500nm", "T.400,0nm"]).unwrap_err();
        assert!(twice.contains("400 nm") && twice.contains("T.400,0nm"), "{twice}");
    }
}
