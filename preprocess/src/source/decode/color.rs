//! From the numbers of an image to linear RGB with the primaries of sRGB.
//!
//! Source: IEC 61966-2-1 for the transfer function; W3C: CSS Color Module Level 4, section 17, for the matrix.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

/// What the numbers of an image mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Color {
    /// sRGB with its transfer function: assumed of JPEG and PNG.
    Srgb,
    /// Linear RGB with the primaries of sRGB: assumed of OpenEXR and Radiance HDR.
    Linear,
    /// CIE XYZ, the white being D65 with Y = 1: assumed of OpenEXR images that say so and of those of UTIA.
    Xyz,
}

/// The inverse of the transfer function of sRGB, odd around zero.
pub(super) fn linear_from_srgb(value: f64) -> f64 {
    let size = value.abs();
    let linear = if size <= 0.04045 {
        size / 12.92
    } else {
        ((size + 0.055) / 1.055).powf(2.4)
    };
    linear.copysign(value)
}

/// Of all bytes.
pub(super) static LINEAR_FROM_SRGB8: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| linear_from_srgb(value as f64 / 255.0) as f32));

/// Of all 16-bit numbers.
pub(super) static LINEAR_FROM_SRGB16: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=u16::MAX)
        .map(|value| linear_from_srgb(f64::from(value) / 65535.0) as f32)
        .collect()
});

/// Rows: red, green, blue; columns: X, Y, Z.
pub(super) const RGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.2409699419045226, -1.537383177570094, -0.4986107602930034],
    [-0.9692436362808796, 1.8759675015077202, 0.04155505740717559],
    [0.05563007969699366, -0.20397695888897652, 1.0569715142428786],
];

/// Converts planes in place, `[rgb][y][x]`.
pub(super) fn rgb_from_xyz(planes: &mut [f32]) {
    let (first, rest) = planes.split_at_mut(planes.len() / 3);
    let (second, third) = rest.split_at_mut(first.len());
    for ((x, y), z) in first.iter_mut().zip(second).zip(third) {
        let xyz = [f64::from(*x), f64::from(*y), f64::from(*z)];
        let [red, green, blue] =
            RGB_FROM_XYZ.map(|row| row.iter().zip(&xyz).map(|(a, b)| a * b).sum::<f64>() as f32);
        (*x, *y, *z) = (red, green, blue);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_stays_white_and_the_ends_of_the_curve_meet() {
        // D65 from its chromaticity x = 0.3127, y = 0.3290.
        let mut planes = [0.3127 / 0.3290, 1.0, (1.0 - 0.3127 - 0.3290) / 0.3290];
        rgb_from_xyz(&mut planes);
        assert!(planes.iter().all(|v: &f32| (v - 1.0).abs() < 1e-5), "{planes:?}");

        assert_eq!((LINEAR_FROM_SRGB8[0], LINEAR_FROM_SRGB8[255]), (0.0, 1.0));
        assert!((LINEAR_FROM_SRGB8[188] - 0.502886).abs() < 1e-5);
        assert_eq!(LINEAR_FROM_SRGB16[257 * 100], LINEAR_FROM_SRGB8[100]);
        let jump = linear_from_srgb(0.04045 + 1e-9) - linear_from_srgb(0.04045);
        assert!((0.0..1e-7).contains(&jump), "{jump}");
        assert_eq!(linear_from_srgb(-0.5), -linear_from_srgb(0.5));
    }
}
