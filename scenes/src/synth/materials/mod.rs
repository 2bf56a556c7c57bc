//! The procedural materials.

mod cloth;
mod gravel;
mod leather;
mod sponge;
mod studs;
mod wool;

use super::reflectance::Attributes;
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

/// Makes a material from a seed and the length of a voxel in patch widths, which the thinnest fibres heed.
pub(super) type Make = fn(u64, f32) -> Box<dyn Material>;

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
    |seed, voxel| Box::new(cloth::Cloth::new(seed, voxel)),
    |seed, voxel| Box::new(wool::Wool::new(seed, voxel)),
    |seed, _| Box::new(leather::Leather::new(seed)),
    |seed, _| Box::new(sponge::Sponge::new(seed)),
    |seed, _| Box::new(gravel::Gravel::new(seed)),
    |seed, _| Box::new(studs::Studs::new(seed)),
];

/// All materials that [`synthesize`](super::synthesize()) knows.
pub fn materials() -> &'static [MaterialDescription] {
    &NAMES
}

pub(super) fn find(name: &str) -> Result<Make> {
    let unknown = || Error::UnknownMaterial {
        name: name.into(),
        known: NAMES.map(|m| m.name).join(", "),
    };
    NAMES
        .iter()
        .position(|m| m.name == name)
        .map(|n| MAKE[n])
        .ok_or_else(unknown)
}

/// The normal tilted by a relief: `height` in patch widths over the surface, asked at points `step` apart.
pub(super) fn bump(p: Vec3, normal: Vec3, step: f32, height: impl Fn(Vec3) -> f32) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let here = height(p);
    let slope = |axis: Vec3| (height(p + step * axis) - here) / step;
    (normal - slope(x) * x - slope(y) * y).normalize()
}
