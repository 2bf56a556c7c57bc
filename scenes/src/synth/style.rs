//! Styles: one kind of material in many colours, patterns, reliefs and degrees of gloss.

use glam::{Mat3, Vec3};

/// Patterns of each material: weaves, sizes of cells and holes, mixtures of rocks.
pub const PATTERNS: u32 = 4;

/// How a material differs from the plain one of its kind. The default changes nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// Which of the [`PATTERNS`] of the material, from 0.
    pub pattern: u32,
    /// Turn of all hues, in whole circles: a third makes red green.
    pub hue: f32,
    /// Factor of the saturation, 0 to 2; 0 is grey.
    pub saturation: f32,
    /// Factor of the diffuse albedo, 0.1 to 4.
    pub brightness: f32,
    /// Factor of GGX's α, 0.25 to 4.
    pub roughness: f32,
    /// Factor of all heights, 0.25 to 2.
    pub relief: f32,
}

impl Default for Style {
    fn default() -> Style {
        Style {
            pattern: 0,
            hue: 0.0,
            saturation: 1.0,
            brightness: 1.0,
            roughness: 1.0,
            relief: 1.0,
        }
    }
}

impl Style {
    /// One of a sequence of styles that spread evenly; number 0 is the plain style of each pattern, and the
    /// pattern changes with every sixth, so that a round through six kinds of material has one pattern.
    pub fn variant(number: u32) -> Style {
        let pattern = number / 6 % PATTERNS;
        if number == 0 {
            return Style::default();
        }
        // Kronecker sequence of the generalized golden ratio in five dimensions (Roberts, The Unreasonable
        // Effectiveness of Quasirandom Sequences, 2018); the root of x⁶ = x + 1.
        const RATIO: f64 = 1.134_724_138_401_519_5;
        let along = |axis: i32| (f64::from(number) * RATIO.powi(-axis)).fract() as f32;
        let between = |axis: i32, low: f32, high: f32| low * (high / low).powf(along(axis));
        Style {
            pattern,
            hue: along(1),
            saturation: 0.25 + 0.8 * along(2),
            brightness: between(3, 0.7, 1.9),
            roughness: between(4, 0.6, 1.7),
            relief: between(5, 0.55, 1.35),
        }
    }

    /// What is out of range, if anything.
    pub(super) fn problem(&self) -> Option<String> {
        if self.pattern >= PATTERNS {
            return Some(format!("pattern {}; choose 0 to {}", self.pattern, PATTERNS - 1));
        }
        if !(-1e3..=1e3).contains(&self.hue) {
            return Some(format!("hue {}; choose 0 to 1", self.hue));
        }
        let factors = [
            ("saturation", self.saturation, 0.0, 2.0),
            ("brightness", self.brightness, 0.1, 4.0),
            ("roughness", self.roughness, 0.25, 4.0),
            ("relief", self.relief, 0.25, 2.0),
        ];
        let outside = factors
            .iter()
            .find(|(_, value, low, high)| !(low..=high).contains(&value));
        outside.map(|(name, value, low, high)| format!("{name} {value}; choose {low} to {high}"))
    }

    /// A colour with its hue turned and its saturation changed; colours that leave the gamut are cut.
    pub(super) fn recolour(&self) -> impl Fn(Vec3) -> Vec3 + Send + Sync + use<> {
        let turn = Mat3::from_axis_angle(Vec3::ONE.normalize(), self.hue * std::f32::consts::TAU);
        let saturation = self.saturation;
        move |colour| {
            // Luminance of linear sRGB (IEC 61966-2-1), kept through the turn.
            let luminance = |colour: Vec3| colour.dot(Vec3::new(0.2126, 0.7152, 0.0722));
            let turned = (turn * colour).max(Vec3::ZERO);
            let kept = luminance(colour) / luminance(turned).max(1e-6);
            let turned = turned * kept.clamp(0.5, 2.0);
            let grey = Vec3::splat(luminance(turned));
            (grey + (turned - grey) * saturation).max(Vec3::ZERO)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_are_in_range_and_the_first_is_plain() {
        assert_eq!(Style::variant(0), Style::default());
        for number in 0..500 {
            assert_eq!(Style::variant(number).problem(), None, "{number}");
        }
        let first: Vec<Style> = (0..100).map(Style::variant).collect();
        for (n, style) in first.iter().enumerate() {
            assert!(!first[..n].contains(style), "{n}");
        }
    }

    #[test]
    fn nonsense_is_named() {
        let plain = Style::default;
        for (style, name) in [
            (
                Style {
                    pattern: 4,
                    ..plain()
                },
                "pattern 4",
            ),
            (
                Style {
                    hue: f32::NAN,
                    ..plain()
                },
                "hue NaN",
            ),
            (
                Style {
                    saturation: -0.1,
                    ..plain()
                },
                "saturation",
            ),
            (
                Style {
                    brightness: f32::INFINITY,
                    ..plain()
                },
                "brightness",
            ),
            (
                Style {
                    roughness: 0.0,
                    ..plain()
                },
                "roughness",
            ),
            (
                Style {
                    relief: 3.0,
                    ..plain()
                },
                "relief 3",
            ),
        ] {
            assert!(style.problem().unwrap().contains(name), "{:?}", style.problem());
        }
    }

    #[test]
    fn hues_turn_and_greys_stay() {
        let style = Style {
            hue: 1.0 / 3.0,
            ..Style::default()
        };
        let recolour = style.recolour();
        let green = recolour(Vec3::new(0.5, 0.0, 0.0));
        assert!(green.y > 0.1 && green.x < 1e-6 && green.z < 1e-6, "{green}");
        assert!((recolour(Vec3::splat(0.3)) - 0.3).length() < 1e-6);
        let grey = Style {
            saturation: 0.0,
            ..style
        }
        .recolour()(Vec3::new(0.2, 0.4, 0.1));
        assert!((grey.x - grey.y).abs() < 1e-6 && (grey.y - grey.z).abs() < 1e-6);
    }
}
