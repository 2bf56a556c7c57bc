//! What a texel of the page cache is: four half floats, or four signed bytes relative to the scale of its slot.
//!
//! Bytes are filtered by the same hardware and multiplied afterwards, which is the same. Each component of a slot has its own
//! scale, the largest magnitude that the slot has to hold, so that a strong component does not take the steps from a weak
//! one. A step is scale / 127; rounding to the nearest one makes an error of step² / 12 (uniform quantization at high
//! resolution), in the unit in which all errors of eigen-textures are: mean squared reflectance.

use half::{f16, slice::HalfFloatSliceExt};
use serde::{Deserialize, Serialize};
use tileset::{Page, SLOT_AREA};

/// Steps from zero to the scale of a slot.
pub const STEPS: f32 = 127.0;

/// What a texel of the page cache is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PageFormat {
    /// Four half floats: what the decoder makes.
    #[default]
    Half,
    /// Four signed bytes and a scale for each component of a slot: half the bytes. Pages are decoded on the workers, because
    /// children are coded against their exact parents, which such a cache does not hold.
    Byte,
}

impl PageFormat {
    /// Bytes of a slot: 72² texels. What is kept of each slot beside the page cache is not in it.
    pub const fn slot_bytes(self) -> u64 {
        SLOT_AREA as u64 * 4 * self.component_bytes()
    }

    const fn component_bytes(self) -> u64 {
        match self {
            PageFormat::Half => 2,
            PageFormat::Byte => 1,
        }
    }

    pub(super) fn texture(self) -> wgpu::TextureFormat {
        match self {
            PageFormat::Half => wgpu::TextureFormat::Rgba16Float,
            PageFormat::Byte => wgpu::TextureFormat::Rgba8Snorm,
        }
    }

    /// The file that stands for `slots` in shaders that write into the cache.
    pub(super) fn shader(self) -> &'static str {
        match self {
            PageFormat::Half => "half_slots",
            PageFormat::Byte => "byte_slots",
        }
    }
}

/// Mean squared error of a component that is rounded with this scale.
pub fn rounding_mse(scale: f32) -> f64 {
    (f64::from(scale) / f64::from(STEPS)).powi(2) / 12.0
}

/// A page's texels as floats, four a texel.
pub(super) fn floats(page: &Page) -> Vec<f32> {
    let mut floats = vec![0.0; page.texels.len() * 4];
    page.texels.as_flattened().convert_to_f32_slice(&mut floats);
    floats
}

/// Texels relative to a scale by component; what exceeds it is clamped, what is no number is zero.
pub(super) fn bytes(floats: &[f32], scale: [f32; 4]) -> Vec<i8> {
    let factors = scale.map(|scale| if scale > 0.0 { STEPS / scale } else { 0.0 });
    // In the sum with this number the last bit of the mantissa is worth one: the lowest byte is the nearest integer, in
    // instructions that every processor has for many numbers at once.
    const ROUND: f32 = 1.5 * (1 << 23) as f32;
    let mut bytes = vec![0; floats.len()];
    for (bytes, texel) in bytes.chunks_exact_mut(4).zip(floats.chunks_exact(4)) {
        for c in 0..4 {
            let steps = (texel[c] * factors[c]).clamp(-STEPS, STEPS);
            bytes[c] = (steps + ROUND).to_bits() as i8;
        }
    }
    bytes
}

/// The texels that such bytes stand for.
pub(super) fn halves(bytes: &[u8], scale: [f32; 4]) -> Vec<[f16; 4]> {
    let texel = |bytes: &[u8]| {
        std::array::from_fn(|c| f16::from_f32((f32::from(bytes[c] as i8) / STEPS).max(-1.0) * scale[c]))
    };
    bytes.chunks_exact(4).map(texel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(value: impl Fn(usize, usize) -> f32) -> Page {
        let texel = |at| std::array::from_fn(|c| f16::from_f32(value(at, c)));
        Page {
            texels: (0..SLOT_AREA).map(texel).collect(),
        }
    }

    fn largest(floats: &[f32], c: usize) -> f32 {
        floats
            .iter()
            .skip(c)
            .step_by(4)
            .fold(0.0, |most, v| v.abs().max(most))
    }

    #[test]
    fn a_slot_of_bytes_takes_half_the_bytes() {
        assert_eq!(PageFormat::Half.slot_bytes(), 72 * 72 * 8);
        assert_eq!(PageFormat::Byte.slot_bytes() * 2, PageFormat::Half.slot_bytes());
    }

    #[test]
    fn rounding_errs_by_at_most_half_a_step_of_each_component_and_as_much_as_predicted() {
        // From subnormal to the largest half float, side by side.
        let strengths = [6e-8, 1e-3, 1.0, 65504.0];
        let page = page(|at, c| (at as f32 * (0.37 + c as f32 * 0.11)).sin() * strengths[c]);
        let floats = floats(&page);
        let scale = std::array::from_fn(|c| largest(&floats, c));
        let bytes = bytes(&floats, scale);
        let back = halves(bytemuck::cast_slice(&bytes), scale);
        for c in 0..4 {
            let errors = page.texels.iter().zip(&back);
            let errors = errors.map(|(a, b)| (a[c].to_f64() - b[c].to_f64()).abs());
            let half_step = f64::from(scale[c] / STEPS) / 2.0;
            let (mut most, mut square) = (0.0f64, 0.0);
            for error in errors {
                most = most.max(error);
                square += error * error / SLOT_AREA as f64;
            }
            // The result is a half float again.
            assert!(
                most <= half_step + f64::from(scale[c]) / 2048.0 + 6e-8,
                "{c}: {most}"
            );
            // Subnormals have hardly any steps of their own.
            if c > 0 {
                let ratio = square / rounding_mse(scale[c]);
                assert!((0.9..1.1).contains(&ratio), "{c}: {ratio}");
            }
        }
    }

    #[test]
    fn nothing_is_zero_and_no_value_is_lost_to_arithmetic() {
        let odd = [f32::NAN, f32::INFINITY, -0.0, -f32::INFINITY];
        assert_eq!(bytes(&odd, [1.0; 4]), [0, 127, 0, -127]);
        assert_eq!(bytes(&odd, [0.0; 4])[2], 0);
        let back = halves(&[129, 128, 127, 0], [65504.0, 1.0, 6e-8, 0.0]);
        assert_eq!(back[0].map(f16::to_f32), [-65504.0, -1.0, 5.9604645e-8, 0.0]);
    }
}
