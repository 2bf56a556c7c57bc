//! From linear radiance to what a screen shows. Twin of `tones.wgsl`.
//!
//! Source: Khronos PBR Neutral tone mapper, specification 2024 (KhronosGroup/ToneMapping, PBR_Neutral); IEC
//! 61966-2-1 (sRGB).

/// Where compression of highlights begins: 0.8 less the reflectance of a dielectric at normal incidence.
const START_COMPRESSION: f64 = 0.8 - 0.04;
const DESATURATION: f64 = 0.15;

/// Tone maps linear RGB to [0, 1]: colours up to 0.8 keep hue and saturation, highlights are compressed and
/// desaturated. Input below zero counts as zero.
pub fn pbr_neutral(linear: [f64; 3]) -> [f64; 3] {
    let linear = linear.map(not_negative);
    let least = linear[0].min(linear[1]).min(linear[2]);
    let offset = if least < 0.08 {
        least - 6.25 * least * least
    } else {
        0.04
    };
    let color = linear.map(|channel| channel - offset);
    let peak = color[0].max(color[1]).max(color[2]);
    if peak < START_COMPRESSION {
        return color;
    }
    let room = 1.0 - START_COMPRESSION;
    let compressed = 1.0 - room * room / (peak + room - START_COMPRESSION);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - compressed) + 1.0);
    color.map(|channel| channel * (compressed / peak) * (1.0 - white) + compressed * white)
}

/// sRGB's transfer function, for values in [0, 1].
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.0031308 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// The inverse of [`srgb_from_linear`].
pub fn linear_from_srgb(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// The light that a screen emits for a radiance, linear, in [0, 1]: exposed by 2^stops, tone mapped, clipped.
/// A value that is not a number stays one.
pub fn display_from_radiance(radiance: [f32; 3], exposure_stops: f32) -> [f64; 3] {
    let exposure = f64::from(exposure_stops).exp2();
    pbr_neutral(radiance.map(|channel| f64::from(channel) * exposure)).map(|channel| channel.clamp(0.0, 1.0))
}

/// The bytes of a picture file for a radiance: what the screen shows, sRGB, rounded. A value that is not a
/// number is black.
pub fn srgb8_from_radiance(radiance: [f32; 3], exposure_stops: f32) -> [u8; 3] {
    display_from_radiance(radiance, exposure_stops)
        .map(|channel| (srgb_from_linear(channel) * 255.0).round() as u8)
}

/// Not `f64::max`, which would turn a value that is not a number into black.
fn not_negative(value: f64) -> f64 {
    if value < 0.0 { 0.0 } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The specification's GLSL, by hand.
    #[test]
    fn neutral_is_that_of_the_specification() {
        let close = |found: [f64; 3], expected: [f64; 3]| {
            assert!(
                found
                    .iter()
                    .zip(expected)
                    .all(|(found, e)| (found - e).abs() < 1e-9),
                "{found:?} {expected:?}"
            );
        };
        close(pbr_neutral([0.5, 0.4, 0.3]), [0.46, 0.36, 0.26]);
        close(pbr_neutral([0.5, 0.4, 0.04]), [0.47, 0.37, 0.01]);
        // peak 1.96, d 0.24: compressed 1 − 0.0576 / 1.44 = 0.96; g = 1 − 1 / (0.15 · 1 + 1).
        let (compressed, g) = (0.96, 1.0 - 1.0 / 1.15);
        let channel = |value: f64| value * (compressed / 1.96) * (1.0 - g) + compressed * g;
        close(
            pbr_neutral([2.0, 1.0, 0.5]),
            [channel(1.96), channel(0.96), channel(0.46)],
        );
        close(pbr_neutral([-1.0, 0.0, 0.0]), [0.0; 3]);
    }

    #[test]
    fn srgb_there_and_back() {
        for i in 0..=1000 {
            let value = f64::from(i) / 1000.0;
            assert!((linear_from_srgb(srgb_from_linear(value)) - value).abs() < 1e-7);
        }
        assert!((srgb_from_linear(0.5) - 0.735356983052).abs() < 1e-9);
    }

    #[test]
    fn what_is_shown_rises_with_radiance_and_stays_in_range() {
        let mut before = -1.0;
        for i in 0..4000 {
            let value = 1.01f32.powi(i / 2 - 1000);
            let [r, g, b] = display_from_radiance([value, value, value], 0.0);
            assert!(r >= before && r <= 1.0 && r == g && g == b);
            before = r;
        }
        assert_eq!(srgb8_from_radiance([f32::INFINITY, 0.0, f32::NAN], 0.0).len(), 3);
        assert_eq!(
            srgb8_from_radiance([0.02, 0.02, 0.02], 1.0),
            srgb8_from_radiance([0.04, 0.04, 0.04], 0.0)
        );
    }
}
