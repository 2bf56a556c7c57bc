//! A material in another style: the same solid, stretched in height, and what it is made of, recoloured.

use super::Material;
use crate::synth::reflectance::Attributes;
use crate::synth::style::Style;
use crate::synth::volume::{Row, Solid};
use glam::Vec3;
use std::ops::Range;

/// Largest albedo: a little is always absorbed.
const LARGEST_ALBEDO: f32 = 0.95;

/// A material in a style.
pub(super) struct Styled {
    plain: Box<dyn Material>,
    style: Style,
    recolour: Box<dyn Fn(Vec3) -> Vec3 + Send + Sync>,
}

impl Styled {
    pub(super) fn new(plain: Box<dyn Material>, style: &Style) -> Styled {
        Styled {
            plain,
            style: *style,
            recolour: Box::new(style.recolour()),
        }
    }
}

impl Solid for Styled {
    fn extent(&self) -> Range<f32> {
        let extent = self.plain.extent();
        extent.start * self.style.relief..extent.end * self.style.relief
    }

    fn fill(&self, row: &mut Row<'_>) {
        row.relief = self.style.relief;
        self.plain.fill(row);
    }
}

impl Material for Styled {
    fn attributes(&self, p: Vec3, normal: Vec3, part: u16) -> Attributes {
        let p = Vec3::new(p.x, p.y, p.z / self.style.relief);
        let found = self.plain.attributes(p, normal, part);
        let limit = Vec3::splat(LARGEST_ALBEDO);
        Attributes {
            diffuse: ((self.recolour)(found.diffuse) * self.style.brightness).min(limit),
            specular: (self.recolour)(found.specular).min(limit),
            roughness: found
                .roughness
                .map(|alpha| (alpha * self.style.roughness).clamp(0.03, 1.0)),
            ..found
        }
    }

    fn as_solid(&self) -> &dyn Solid {
        self
    }
}
