//! What an archive says about itself: sizes, directions, scaling, codec, and the ledger of errors.

use serde::{Deserialize, Serialize};

use crate::{Error, GROUP_COMPONENTS, MAX_COMPONENTS, MAX_DIRECTIONS, Pyramid, Result, codec};

/// A direction in the tangent frame: polar and azimuth angle, in radians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Direction {
    /// Angle from the surface normal.
    pub theta: f64,
    /// Angle from the tangent, towards the bitangent.
    pub phi: f64,
}

impl Direction {
    /// The unit vector, pointing away from the surface.
    pub fn to_vector(self) -> [f64; 3] {
        let (sin_theta, cos_theta) = self.theta.sin_cos();
        let (sin_phi, cos_phi) = self.phi.sin_cos();
        [sin_theta * cos_phi, sin_theta * sin_phi, cos_theta]
    }
}

/// How the BTF was factorized.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Factorization {
    /// Full matrix factorization: one truncated SVD of the whole BTF.
    Fmf,
}

/// How pages become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "id", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Codec {
    /// 8×8 DCT of the difference to the up-sampled decoded parent, one quantizer step for all components,
    /// zstd for the symbols.
    DctDeltaZstd {
        /// Quantizer step of the orthonormal DCT, in units of the scaled eigen-textures.
        step: f64,
    },
    /// A critically sampled pyramid of 16×16 DCTs, one quantizer step for all components and mips, and columns in an
    /// angular basis with the step that costs as much; rANS for the symbols. See [`codec::pyramid_dct`] and
    /// [`codec::columns`].
    PyramidDct {
        /// Quantizer step of the orthonormal transform, in units of the scaled eigen-textures.
        step: f64,
    },
}

impl Codec {
    /// Quantizer step, in units of the scaled eigen-textures.
    pub fn step(self) -> f64 {
        match self {
            Codec::DctDeltaZstd { step } | Codec::PyramidDct { step } => step,
        }
    }
}

/// Root mean square errors of reflectance by stage, and the root mean square of the BTF to relate them to.
///
/// All are in the unit of the BTF's samples; the stages are uncorrelated, so their squares add up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// Root mean square of the BTF's samples.
    pub btf_rms: f64,
    /// What the truncated rank leaves out.
    pub rank_rms: f64,
    /// What half floats lose, in both factors.
    pub half_rms: f64,
    /// What the codec loses of both factors in half floats, in the finest mip.
    pub codec_rms: f64,
    /// The sum, measured on the decoded archive: what the truncated rank leaves out, and the difference of the decoded
    /// factors to the exact ones in one piece.
    pub measured_rms: f64,
}

impl Ledger {
    /// The predicted error of all stages together.
    pub fn total_rms(&self) -> f64 {
        (self.rank_rms.powi(2) + self.half_rms.powi(2) + self.codec_rms.powi(2)).sqrt()
    }

    /// The predicted error relative to the root mean square of the BTF; 0 for a BTF that is all zero.
    pub fn total_relative(&self) -> f64 {
        if self.btf_rms > 0.0 {
            self.total_rms() / self.btf_rms
        } else {
            0.0
        }
    }
}

/// What an archive says about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the material.
    pub name: String,
    /// Program and version that wrote the archive.
    pub generator: String,
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Whether the material repeats in both directions.
    pub wrap: bool,
    /// Whether the samples include the cosine of the light's polar angle.
    pub cosine: bool,
    /// View directions ωo, in the order of the columns' entries.
    pub views: Vec<Direction>,
    /// Light directions ωi.
    pub lights: Vec<Direction>,
    /// Rank of the factorization.
    pub components: u32,
    /// How the BTF was factorized.
    pub factorization: Factorization,
    /// How the pages are coded.
    pub codec: Codec,
    /// Power of two by which decoded eigen-textures are multiplied; not 1 only where half floats would
    /// overflow, or lose precision because all values are tiny.
    pub texture_scale: f64,
    /// Mean reflectance over all texels and directions, linear RGB: what a pixel shows before any page is
    /// there.
    pub mean_rgb: [f64; 3],
    /// Singular values of the BTF divided by √(m·n): root mean square contribution of each component.
    pub singular_values: Vec<f64>,
    /// Errors by stage.
    pub errors: Ledger,
}

impl Manifest {
    /// Geometry of the pages.
    ///
    /// # Errors
    /// As [`Pyramid::new`].
    pub fn pyramid(&self) -> Result<Pyramid> {
        Pyramid::new(self.width, self.height, self.wrap)
    }

    /// Number of component groups.
    pub fn groups(&self) -> u32 {
        self.components.div_ceil(GROUP_COMPONENTS as u32)
    }

    /// Number of texels of four components in a decoded column: views × lights × 3.
    pub fn column_texels(&self) -> usize {
        self.views.len() * self.lights.len() * 3
    }

    /// Number of pages in all groups, stored or not.
    ///
    /// # Errors
    /// As [`Pyramid::new`].
    pub fn page_count(&self) -> Result<u64> {
        Ok(u64::from(self.pyramid()?.tile_count()) * u64::from(self.groups()))
    }

    /// Checks every limit and that all numbers are finite, before anything is allocated from them.
    ///
    /// # Errors
    /// [`crate::Error::OverLimit`] or [`crate::Error::Invalid`], naming the member.
    pub fn validate(&self) -> Result<()> {
        within(
            "bytes in the manifest's name",
            self.name.len() as u64,
            0,
            MAX_TEXT_BYTES.into(),
        )?;
        within(
            "bytes in the manifest's generator",
            self.generator.len() as u64,
            0,
            MAX_TEXT_BYTES.into(),
        )?;
        within("components", self.components.into(), 1, MAX_COMPONENTS.into())?;
        within("pages", self.page_count()?, 1, MAX_PAGES.into())?;
        within(
            "view directions",
            self.views.len() as u64,
            1,
            MAX_DIRECTIONS.into(),
        )?;
        within(
            "light directions",
            self.lights.len() as u64,
            1,
            MAX_DIRECTIONS.into(),
        )?;
        within(
            "texels of a column",
            self.column_texels() as u64,
            1,
            MAX_COLUMN_TEXELS.into(),
        )?;
        check_directions("views", &self.views)?;
        check_directions("lights", &self.lights)?;
        codec::check(self.codec)?;

        let exponent_only = self.texture_scale.to_bits() << (64 - f64::MANTISSA_DIGITS + 1) == 0;
        if !exponent_only || !(MIN_SCALE..=1.0 / MIN_SCALE).contains(&self.texture_scale) {
            return Err(invalid(
                "texture_scale",
                format!("{} is no usable power of two", self.texture_scale),
            ));
        }
        if self.singular_values.len() as u64 != u64::from(self.components) {
            let detail = format!(
                "{} values for {} components",
                self.singular_values.len(),
                self.components
            );
            return Err(invalid("singular_values", detail));
        }
        let Ledger {
            btf_rms,
            rank_rms,
            half_rms,
            codec_rms,
            measured_rms,
        } = self.errors;
        for (member, values) in [
            ("singular_values", self.singular_values.as_slice()),
            ("errors", &[btf_rms, rank_rms, half_rms, codec_rms, measured_rms]),
        ] {
            if let Some(bad) = values.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
                return Err(invalid(member, format!("{bad} is negative or no number")));
            }
        }
        if let Some(bad) = self.mean_rgb.iter().find(|value| !value.is_finite()) {
            return Err(invalid("mean_rgb", format!("{bad} is no finite number")));
        }
        Ok(())
    }
}

fn invalid(member: &str, detail: String) -> Error {
    Error::Invalid {
        what: format!("member {member} of the manifest"),
        detail,
    }
}

fn within(what: &'static str, found: u64, least: u64, limit: u64) -> Result<()> {
    if found > limit {
        return Err(Error::OverLimit { what, found, limit });
    }
    if found < least {
        return Err(Error::Invalid {
            what: what.into(),
            detail: format!("{found}, at least {least} is needed"),
        });
    }
    Ok(())
}

/// Directions must be finite, in the upper hemisphere, and all different: interpolation triangulates them.
fn check_directions(member: &str, directions: &[Direction]) -> Result<()> {
    // A table in degrees or single precision may overshoot the right angle a little.
    const SLACK: f64 = 1e-4;
    let upper = 0.0..=std::f64::consts::FRAC_PI_2 + SLACK;
    let phi_range = -2.0 * std::f64::consts::TAU..=2.0 * std::f64::consts::TAU;
    for (i, direction) in directions.iter().enumerate() {
        if !upper.contains(&direction.theta) || !phi_range.contains(&direction.phi) {
            let detail = format!(
                "direction {i} is theta {}, phi {}; theta must be within 0 and π/2, phi within ±4π, in radians",
                direction.theta, direction.phi
            );
            return Err(invalid(member, detail));
        }
    }
    let mut sorted: Vec<(usize, [f64; 3])> = directions
        .iter()
        .map(|direction| direction.to_vector())
        .enumerate()
        .collect();
    sorted.sort_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]));
    for (rank, (i, a)) in sorted.iter().enumerate() {
        // Sorted by x, so whatever is close in space is close in the list.
        for (j, b) in sorted[rank + 1..]
            .iter()
            .take_while(|(_, b)| b[0] - a[0] <= SAME_DIRECTION)
        {
            if (a[1] - b[1]).abs() <= SAME_DIRECTION && (a[2] - b[2]).abs() <= SAME_DIRECTION {
                return Err(invalid(
                    member,
                    format!("directions {} and {} are the same", i.min(j), i.max(j)),
                ));
            }
        }
    }
    Ok(())
}

/// Longest accepted name of a material or generator, in bytes.
const MAX_TEXT_BYTES: u32 = 1024;
/// Smallest accepted scale; its inverse is the largest.
const MIN_SCALE: f64 = 1.0 / (1u64 << 32) as f64;
/// Unit vectors that differ by no more than this in each coordinate are taken for the same direction.
const SAME_DIRECTION: f64 = 1e-6;
/// Largest accepted number of pages in all groups, stored or not: bounds the directory.
pub const MAX_PAGES: u32 = 1 << 22;
/// Largest accepted number of texels in a column, views × lights × 3: bounds a decoded column to 32 MiB.
pub const MAX_COLUMN_TEXELS: u32 = 1 << 22;

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> Manifest {
        let directions = |count: u32| {
            (0..count)
                .map(|i| Direction {
                    theta: 0.01 * f64::from(i),
                    phi: 0.07 * f64::from(i),
                })
                .collect()
        };
        Manifest {
            name: "n".into(),
            generator: "g".into(),
            width: 100,
            height: 50,
            wrap: true,
            cosine: false,
            views: directions(81),
            lights: directions(151),
            components: 7,
            factorization: Factorization::Fmf,
            codec: Codec::DctDeltaZstd { step: 0.01 },
            texture_scale: 0.25,
            mean_rgb: [1.0, 0.0, -0.1],
            singular_values: vec![0.5; 7],
            errors: Ledger {
                btf_rms: 1.0,
                rank_rms: 0.3,
                half_rms: 0.0,
                codec_rms: 0.4,
                measured_rms: 0.5,
            },
        }
    }

    /// What `validate` says after a change.
    fn refusal(change: impl FnOnce(&mut Manifest)) -> String {
        let mut manifest = good();
        change(&mut manifest);
        manifest.validate().unwrap_err().to_string()
    }

    #[test]
    fn a_good_manifest_is_accepted() {
        good().validate().unwrap();
        assert_eq!(good().groups(), 2);
        assert_eq!(good().column_texels(), 81 * 151 * 3);
        assert_eq!(good().page_count().unwrap(), 2 * (1 + 1 + 2));
        assert!((good().errors.total_relative() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn each_bad_member_is_named() {
        let pole = Direction {
            theta: 1e-9,
            phi: 2.0,
        };
        let turned = |direction: Direction| Direction {
            phi: direction.phi + std::f64::consts::TAU,
            ..direction
        };
        let named = [
            ("name", refusal(|m| m.name = "x".repeat(1025))),
            ("generator", refusal(|m| m.generator = "x".repeat(1025))),
            ("at least one texel", refusal(|m| m.height = 0)),
            ("side of the material", refusal(|m| m.width = 65537)),
            ("components", refusal(|m| m.components = 0)),
            ("components", refusal(|m| m.components = 1025)),
            (
                "pages",
                refusal(|m| (m.width, m.height, m.components) = (65536, 65536, 1000)),
            ),
            ("view directions", refusal(|m| m.views.clear())),
            ("light directions", refusal(|m| m.lights = vec![pole; 4097])),
            (
                "texels of a column",
                refusal(|m| (m.views, m.lights) = (vec![pole; 4096], vec![pole; 4096])),
            ),
            ("views", refusal(|m| m.views[3].theta = -0.1)),
            ("views", refusal(|m| m.views[3].theta = 1.6)),
            ("lights", refusal(|m| m.lights[3].phi = f64::NAN)),
            ("lights", refusal(|m| m.lights[3].phi = 180.0)),
            ("directions 0 and 80", refusal(|m| m.views[80] = pole)),
            (
                "directions 2 and 5",
                refusal(|m| m.lights[5] = turned(m.lights[2])),
            ),
            (
                "quantizer step",
                refusal(|m| m.codec = Codec::DctDeltaZstd { step: f64::NAN }),
            ),
            ("texture_scale", refusal(|m| m.texture_scale = 0.3)),
            ("texture_scale", refusal(|m| m.texture_scale = 0.0)),
            ("texture_scale", refusal(|m| m.texture_scale = -1.0)),
            ("texture_scale", refusal(|m| m.texture_scale = f64::INFINITY)),
            ("texture_scale", refusal(|m| m.texture_scale = f64::NAN)),
            ("mean_rgb", refusal(|m| m.mean_rgb[1] = f64::NAN)),
            ("singular_values", refusal(|m| m.singular_values.truncate(6))),
            ("singular_values", refusal(|m| m.singular_values[6] = -1.0)),
            ("errors", refusal(|m| m.errors.half_rms = f64::INFINITY)),
        ];
        for (member, message) in named {
            assert!(message.contains(member), "{member}: {message}");
        }
    }

    #[test]
    fn measured_directions_are_accepted() {
        // The pole, and a ring of 24 at 75 degrees whose angles were given in single precision.
        let mut manifest = good();
        manifest.views = vec![Direction { theta: 0.0, phi: 3.0 }];
        manifest.views.extend((0..24).map(|i| Direction {
            theta: f64::from(75f32.to_radians()),
            phi: f64::from((15.0 * i as f32).to_radians()),
        }));
        manifest.lights = vec![Direction {
            theta: std::f64::consts::FRAC_PI_2,
            phi: 0.0,
        }];
        manifest.validate().unwrap();
    }
}
