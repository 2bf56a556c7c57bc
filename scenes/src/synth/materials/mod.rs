//! The procedural materials.

mod cloth;
mod gravel;
mod leather;
mod sponge;
mod studs;
mod styled;
mod wool;

use super::reflectance::Attributes;
use super::style::Style;
use super::volume::Solid;
use crate::{Error, Result};
use glam::Vec3;

/// A material that can be synthesized.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaterialDescription {
    /// Name to ask for it.
    pub name: &'static str,
    /// What it is, in one line.
    pub description: &'static str,
}

/// A solid and what its surface is made of.
pub(super) trait Material: Solid + Send {
    /// The surface at `p` (x, y in [0, 1), in patch widths), whose normal is `normal`, on part `part`.
    fn attributes(&self, p: Vec3, normal: Vec3, part: u16) -> Attributes;
    /// The solid alone.
    fn as_solid(&self) -> &dyn Solid;
}

/// Makes a material from a seed, the length of a voxel in patch widths, which the thinnest fibres heed, and a
/// pattern, below [`PATTERNS`](super::PATTERNS).
type Make = fn(u64, f32, u32) -> Box<dyn Material>;

/// Names and makers, in the same order.
const NAMES: [MaterialDescription; 6] = [
    MaterialDescription {
        name: "cloth",
        description: "tartan in 2/2 twill, spun yarns with stray fibres",
    },
    MaterialDescription {
        name: "wool",
        description: "knitted loops of three-ply marled wool, fuzzy",
    },
    MaterialDescription {
        name: "leather",
        description: "creased full-grain leather with pores and a waxed gloss",
    },
    MaterialDescription {
        name: "sponge",
        description: "block with deep holes that open into each other",
    },
    MaterialDescription {
        name: "gravel",
        description: "stones of six rocks and many sizes on sand",
    },
    MaterialDescription {
        name: "studs",
        description: "overhanging brass studs and steel beads on felt; highlights far above 1",
    },
];
const MAKE: [Make; NAMES.len()] = [
    |seed, voxel, pattern| Box::new(cloth::Cloth::new(seed, voxel, pattern)),
    |seed, voxel, pattern| Box::new(wool::Wool::new(seed, voxel, pattern)),
    |seed, _, pattern| Box::new(leather::Leather::new(seed, pattern)),
    |seed, _, pattern| Box::new(sponge::Sponge::new(seed, pattern)),
    |seed, _, pattern| Box::new(gravel::Gravel::new(seed, pattern)),
    |seed, _, pattern| Box::new(studs::Studs::new(seed, pattern)),
];

/// All materials that [`synthesize`](super::synthesize()) knows.
pub fn materials() -> &'static [MaterialDescription] {
    &NAMES
}

/// One of [`materials`], to be made in any style.
#[derive(Clone, Copy)]
pub(super) struct Kind(Make);

impl Kind {
    /// `voxel` is the length of a voxel in patch widths.
    pub(super) fn make(self, seed: u64, voxel: f32, style: &Style) -> Box<dyn Material> {
        let plain = self.0(seed, voxel, style.pattern);
        if *style
            == (Style {
                pattern: style.pattern,
                ..Style::default()
            })
        {
            plain
        } else {
            Box::new(styled::Styled::new(plain, style))
        }
    }
}

pub(super) fn find(name: &str) -> Result<Kind> {
    let unknown = || Error::UnknownMaterial {
        name: name.into(),
        known: NAMES.map(|m| m.name).join(", "),
    };
    NAMES
        .iter()
        .position(|m| m.name == name)
        .map(|n| Kind(MAKE[n]))
        .ok_or_else(unknown)
}

/// The normal tilted by a relief: `height` in patch widths over the surface, asked at points `step` apart.
pub(super) fn bump(p: Vec3, normal: Vec3, step: f32, height: impl Fn(Vec3) -> f32) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let here = height(p);
    let slope = |axis: Vec3| (height(p + step * axis) - here) / step;
    (normal - slope(x) * x - slope(y) * y).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::volume::Volume;
    use glam::vec3;

    /// Share of the columns in which there is solid above air.
    fn overhanging(name: &str) -> f32 {
        let volume = Volume::build(
            find(name)
                .unwrap()
                .make(1, 1.0 / 128.0, &Style::default())
                .as_solid(),
            128,
        );
        let solid =
            |i: usize, k: usize| volume.nearest(vec3((i % 128) as f32, (i / 128) as f32, k as f32)) < 0.0;
        let overhangs = |i: &usize| (1..volume.depth).any(|k| solid(*i, k) && !solid(*i, k - 1));
        (0..128 * 128).filter(overhangs).count() as f32 / (128.0 * 128.0)
    }

    #[test]
    fn leather_is_a_height_field_and_the_others_overhang() {
        assert_eq!(overhanging("leather"), 0.0);
        for (name, least) in [
            ("studs", 0.15),
            ("sponge", 0.1),
            ("gravel", 0.1),
            ("wool", 0.2),
            ("cloth", 0.05),
        ] {
            assert!(overhanging(name) > least, "{name}: {}", overhanging(name));
        }
    }

    #[test]
    fn attributes_are_sane_everywhere() {
        for (number, material) in (0..24).map(|n| (n, &materials()[n as usize % 6])) {
            let made = find(material.name)
                .unwrap()
                .make(3, 1.0 / 128.0, &Style::variant(number));
            let volume = Volume::build(made.as_solid(), 128);
            for n in 0..2000 {
                let start = vec3((n * 37 % 128) as f32, (n * 53 % 1280) as f32 * 0.1, volume.top);
                let p = volume.march(start, Vec3::NEG_Z).unwrap();
                let normal = volume.normal(p);
                let found = made.attributes(volume.material_from_grid(p), normal, volume.part(p));
                let name = format!("{} in style {number}", material.name);
                assert!((found.normal.length() - 1.0).abs() < 1e-3, "{name}: {found:?}");
                assert!(
                    found.diffuse.min_element() >= 0.0 && found.diffuse.max_element() < 1.0,
                    "{name}: {found:?}"
                );
                assert!(
                    found.specular.min_element() >= 0.0 && found.specular.max_element() < 1.0,
                    "{name}: {found:?}"
                );
                assert!(
                    found.roughness.iter().all(|a| (0.02..=1.2).contains(a)),
                    "{name}: {found:?}"
                );
                assert!(found.tangent.is_finite(), "{name}: {found:?}");
            }
        }
    }
}
