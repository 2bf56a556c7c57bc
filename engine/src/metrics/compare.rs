//! All figures of two pictures.

use serde::{Deserialize, Deserializer, Serialize};

use super::{
    Picture,
    lab::{delta_e_76, delta_e_2000, lab_from_linear},
    ssim::mean_ssim,
    tone::{display_from_radiance, srgb_from_linear},
};

/// How far a picture is from its reference, over the covered pixels.
///
/// A value in a picture that is not a number makes figures not a number, which JSON shows as null.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Pixels that were compared.
    pub pixels: u64,
    /// Root mean square error of linear radiance, over pixels and channels.
    pub rmse: f64,
    /// Root mean square of the reference's radiance.
    pub reference_rms: f64,
    /// `rmse` / `reference_rms`; 0 if both are zero, infinite if only the reference is.
    pub relative_rmse: f64,
    /// Root mean square error of what the screen shows, sRGB-encoded, not rounded to bytes.
    pub shown_rmse: f64,
    /// Peak signal to noise ratio, decibels, with a peak of 1, of what the screen shows, sRGB-encoded, not
    /// rounded to bytes. Infinite for equal pictures.
    #[serde(deserialize_with = "infinite_if_null")]
    pub psnr_db: f64,
    /// Mean structural similarity of the luma 0.2126 R' + 0.7152 G' + 0.0722 B' of what the screen shows,
    /// sRGB-encoded; see [`mean_ssim`].
    pub ssim: f64,
    /// Mean ΔE of 1976 of what the screen shows, white D65.
    pub delta_e_76: f64,
    /// Mean ΔE of 2000 of what the screen shows, white D65.
    pub delta_e_2000: f64,
}

/// JSON has no infinity: what was one is null there.
fn infinite_if_null<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// Compares a picture with its reference, where `covered` says so (`[y][x]`; all pixels if it is `None`).
///
/// `None` if the pictures (or `covered`) differ in size, do not hold what their size says, or nothing is
/// covered.
pub fn compare(
    picture: &Picture,
    reference: &Picture,
    covered: Option<&[bool]>,
    exposure_stops: f32,
) -> Option<Comparison> {
    let size = |picture: &Picture| (picture.width, picture.height, picture.pixels.len());
    let count = picture.width as usize * picture.height as usize;
    let same = size(picture) == size(reference) && count == picture.pixels.len();
    if !same || covered.is_some_and(|covered| covered.len() != count) {
        return None;
    }
    let is_covered = |at: usize| covered.is_none_or(|covered| covered[at]);
    let indices: Vec<usize> = (0..count).filter(|&at| is_covered(at)).collect();
    if indices.is_empty() {
        return None;
    }
    let mean = |value: &dyn Fn(usize) -> f64| {
        indices.iter().map(|&at| value(at)).sum::<f64>() / indices.len() as f64
    };

    let rmse = mean(&|at| square_distance(wide(picture.pixels[at]), wide(reference.pixels[at]))).sqrt();
    let reference_rms = mean(&|at| square_distance(wide(reference.pixels[at]), [0.0; 3])).sqrt();

    let shown = |picture: &Picture| -> Vec<[f64; 3]> {
        picture
            .pixels
            .iter()
            .map(|&pixel| display_from_radiance(pixel, exposure_stops))
            .collect()
    };
    let (shown, shown_reference) = (shown(picture), shown(reference));
    let encode = |pixel: [f64; 3]| pixel.map(srgb_from_linear);
    let noise = mean(&|at| square_distance(encode(shown[at]), encode(shown_reference[at])));
    let luma = |shown: &[[f64; 3]]| -> Vec<f64> {
        let luma = |[r, g, b]: [f64; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        shown.iter().map(|&pixel| luma(encode(pixel))).collect()
    };
    let difference = |of: fn([f64; 3], [f64; 3]) -> f64| {
        mean(&|at| of(lab_from_linear(shown[at]), lab_from_linear(shown_reference[at])))
    };
    Some(Comparison {
        pixels: indices.len() as u64,
        rmse,
        reference_rms,
        relative_rmse: if rmse == 0.0 { 0.0 } else { rmse / reference_rms },
        shown_rmse: noise.sqrt(),
        psnr_db: -10.0 * noise.log10(),
        ssim: mean_ssim(
            &luma(&shown),
            &luma(&shown_reference),
            picture.width as usize,
            is_covered,
        )?,
        delta_e_76: difference(delta_e_76),
        delta_e_2000: difference(delta_e_2000),
    })
}

fn wide(pixel: [f32; 3]) -> [f64; 3] {
    pixel.map(f64::from)
}

/// Mean over the channels.
fn square_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 24×20 pixels of HDR noise, and the same with each value changed by up to a sixteenth.
    fn pictures() -> (Picture, Picture) {
        let (width, height) = (24, 20);
        let mut reference = Picture {
            width,
            height,
            pixels: Vec::new(),
        };
        let mut picture = reference.clone();
        for at in 0..width * height {
            let (x, y) = (at % width, at / width);
            let value = |c: u32| ((x * x * 3 + y * 7 + c * 11 + x * y * 5) % 64) as f32 / 32.0;
            let change = |c: u32| 1.0 + ((x * 13 + y * 5 + c * 3) as f32 % 9.0 - 4.0) / 64.0;
            reference.pixels.push([0, 1, 2].map(value));
            picture.pixels.push([0, 1, 2].map(|c| value(c) * change(c)));
        }
        (picture, reference)
    }

    fn close(found: f64, expected: f64, tolerance: f64) {
        assert!(
            (found - expected).abs() <= tolerance,
            "{found} where {expected} was expected"
        );
    }

    /// Expected values: the pictures above in numpy, tone mapped by the specification's formula, then
    /// `structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
    /// data_range=1)`, `peak_signal_noise_ratio`, `rgb2lab`, `deltaE_cie76` and `deltaE_ciede2000` of
    /// scikit-image 0.26.0; colour-science 0.4.7 gives the same ΔE to within 4e-4 (it rounds white and
    /// matrix differently).
    #[test]
    fn figures_are_those_of_scikit_image() {
        let (picture, reference) = pictures();
        for (stops, psnr, ssim, delta_76, delta_2000) in [
            (0.0, 37.0026650383, 0.994526200077, 3.34510400952, 2.289000076),
            (-1.0, 37.4234278057, 0.998647988628, 3.41509941748, 2.34119330332),
        ] {
            let found = compare(&picture, &reference, None, stops).unwrap();
            assert_eq!(found.pixels, 480);
            close(found.rmse, 0.0454978269756, 1e-9);
            close(found.reference_rms, 1.13896378268, 1e-8);
            close(found.relative_rmse, 0.0454978269756 / 1.13896378268, 1e-9);
            close(found.psnr_db, psnr, 1e-6);
            close(found.shown_rmse, 10f64.powf(-psnr / 20.0), 1e-9);
            close(found.ssim, ssim, 1e-9);
            close(found.delta_e_76, delta_76, 1e-3);
            close(found.delta_e_2000, delta_2000, 1e-3);
        }
    }

    #[test]
    fn only_covered_pixels_count() {
        let (mut picture, reference) = pictures();
        let covered: Vec<bool> = (0..480)
            .map(|at| (3..15).contains(&(at % 24)) && (4..18).contains(&(at / 24)))
            .collect();
        let found = compare(&picture, &reference, Some(&covered), 0.0).unwrap();
        assert_eq!(found.pixels, 168);
        close(found.rmse, 0.0441439008348, 1e-9);
        close(found.psnr_db, 37.2128637387, 1e-6);
        close(found.ssim, 0.994095369797, 1e-9);
        close(found.delta_e_2000, 2.19065068825, 1e-3);
        picture.pixels[0] = [100.0; 3];
        // Only the windows of SSIM reach beyond what is covered.
        let elsewhere = compare(&picture, &reference, Some(&covered), 0.0).unwrap();
        assert_eq!(
            Comparison {
                ssim: found.ssim,
                ..elsewhere
            },
            found
        );
        assert_ne!(compare(&picture, &reference, None, 0.0).unwrap().rmse, found.rmse);
    }

    #[test]
    fn equal_pictures_are_equal() {
        let (picture, _) = pictures();
        let found = compare(&picture, &picture, None, 0.0).unwrap();
        assert_eq!(
            (found.rmse, found.relative_rmse, found.delta_e_2000, found.psnr_db),
            (0.0, 0.0, 0.0, f64::INFINITY)
        );
        close(found.ssim, 1.0, 1e-12);
    }

    /// What a comparator must not let pass.
    #[test]
    fn differences_are_found() {
        let (_, reference) = pictures();
        let changed = |change: &dyn Fn(&mut Picture)| {
            let mut picture = reference.clone();
            change(&mut picture);
            compare(&picture, &reference, None, 0.0).unwrap()
        };
        let one = changed(&|picture| picture.pixels[250][1] += 0.5);
        assert!(one.rmse > 0.01 && one.ssim < 0.9999 && one.psnr_db < 60.0 && one.delta_e_2000 > 1e-3);
        let channels = changed(&|picture| picture.pixels.iter_mut().for_each(|pixel| pixel.reverse()));
        assert!(channels.rmse > 0.1 && channels.delta_e_76 > 5.0);
        let upside_down = changed(&|picture| picture.pixels.reverse());
        assert!(upside_down.ssim < 0.5 && upside_down.psnr_db < 20.0);
        let black = changed(&|picture| picture.pixels.fill([0.0; 3]));
        close(black.relative_rmse, 1.0, 1e-12);
        let broken = changed(&|picture| picture.pixels[250][1] = f32::NAN);
        assert!(
            broken.rmse.is_nan()
                && broken.psnr_db.is_nan()
                && broken.ssim.is_nan()
                && broken.delta_e_76.is_nan()
        );
        assert!(serde_json::to_string(&broken).unwrap().contains("\"rmse\":null"));
    }

    #[test]
    fn pictures_that_do_not_match_are_refused() {
        let (picture, reference) = pictures();
        let turned = Picture {
            width: 20,
            height: 24,
            ..picture.clone()
        };
        assert!(compare(&turned, &reference, None, 0.0).is_none());
        let cut = Picture {
            pixels: picture.pixels[1..].to_vec(),
            ..picture.clone()
        };
        assert!(compare(&cut, &cut, None, 0.0).is_none());
        assert!(compare(&picture, &reference, Some(&[true; 479]), 0.0).is_none());
        assert!(compare(&picture, &reference, Some(&[false; 480]), 0.0).is_none());
        let empty = Picture {
            width: 0,
            height: 0,
            pixels: Vec::new(),
        };
        assert!(compare(&empty, &empty, None, 0.0).is_none());
    }

    #[test]
    fn small_pictures_have_a_similarity_too() {
        let small = |value: f32| Picture {
            width: 3,
            height: 1,
            pixels: vec![[value; 3]; 3],
        };
        assert!(compare(&small(0.5), &small(0.5), None, 0.0).unwrap().ssim > 1.0 - 1e-12);
        assert!(compare(&small(0.5), &small(0.1), None, 0.0).unwrap().ssim < 0.9);
    }
}
