//! The materials of the scenes.

use super::PaperScene;
use crate::synth::{Style, materials};

/// Patches along each side of a material that is too large to be traced as one.
pub const PATCHES: u32 = 4;

/// How a material of a scene is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Name of the archive.
    pub archive: String,
    /// Name of the procedural material.
    pub material: &'static str,
    /// Which one of its kind.
    pub seed: u64,
    /// Its style.
    pub style: Style,
    /// Texels along each side at full size.
    pub size: u32,
    /// A large material is a patch, [`PATCHES`] times along each side, in two styles that are blended by
    /// [`wear`]: this is the second one, of the same pattern and relief.
    pub worn: Option<Style>,
}

pub(super) fn recipes(scene: PaperScene) -> Vec<Recipe> {
    match scene {
        PaperScene::Tori => (0..100).map(|number| variant(number, 512)).collect(),
        PaperScene::Objects => OBJECTS
            .iter()
            .map(|(number, size)| variant(*number, *size))
            .collect(),
        PaperScene::Large => LARGE.iter().map(|number| variant(*number, 2048)).collect(),
        PaperScene::Cylinders => CYLINDERS.iter().map(|number| variant(*number, 512)).collect(),
        PaperScene::Figure => vec![variant(FIGURE, 2048)],
        PaperScene::Dense => vec![variant(DENSE, 2048)],
    }
}

/// Variants and sizes of the objects' materials, in the order of the objects; the last is the ground's, too.
const OBJECTS: [(u32, u32); 15] = [
    (8, 2048),
    (53, 2048),
    (1, 2048),
    (50, 2048),
    (5, 1024),
    (62, 1024),
    (0, 1024),
    (80, 1024),
    (3, 512),
    (29, 512),
    (56, 512),
    (11, 512),
    (33, 512),
    (31, 512),
    (4, 512),
];
const LARGE: [u32; 4] = [8, 53, 50, 1];
const CYLINDERS: [u32; 5] = [0, 1, 2, 4, 5];
const FIGURE: u32 = 92;
const DENSE: u32 = 50;

/// A material by the number of its style; the kinds of material take turns.
fn variant(number: u32, size: u32) -> Recipe {
    let kinds = materials();
    let material = kinds[number as usize % kinds.len()].name;
    let style = Style::variant(number);
    // Faded, paler and duller where it is worn.
    let worn = Style {
        hue: style.hue + 0.04,
        saturation: 0.55 * style.saturation,
        brightness: (1.8 * style.brightness).min(4.0),
        roughness: (1.3 * style.roughness).min(4.0),
        ..style
    };
    Recipe {
        archive: format!(
            "{material}-{number:02}{}",
            match size {
                2048 => "-2k",
                1024 => "-1k",
                _ => "",
            }
        ),
        material,
        seed: u64::from(number) + 1,
        style,
        size,
        worn: (size > 512).then_some(worn),
    }
}

/// How worn a large material is at (s, t) in [0, 1)², 0 to 1: broad spots and streaks, which repeat with the material.
pub fn wear(s: f64, t: f64) -> f64 {
    use std::f64::consts::TAU;
    let wave = |across: f64, up: f64, phase: f64| (TAU * (across * s + up * t) + phase).sin();
    let bent = 0.6 * wave(1.0, 1.0, 0.4);
    let broad = wave(1.0, 0.0, bent) + wave(-1.0, 2.0, 1.7 + bent) + 0.8 * wave(2.0, 1.0, 4.1);
    let fine = 0.5 * wave(7.0, 3.0, 2.0 * bent) + 0.4 * wave(-4.0, 9.0, 0.9) + 0.3 * wave(13.0, -11.0, 2.2);
    let worn = (0.45 + 0.4 * broad + 0.35 * fine).clamp(0.0, 1.0);
    worn * worn * (3.0 - 2.0 * worn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_have_the_papers_numbers_of_materials() {
        let counts = PaperScene::ALL.map(|scene| scene.recipes().len());
        assert_eq!(counts, [100, 15, 4, 5, 1, 1]);
        for scene in PaperScene::ALL {
            let recipes = scene.recipes();
            for (n, recipe) in recipes.iter().enumerate() {
                assert!(
                    recipes[..n].iter().all(|other| other.archive != recipe.archive),
                    "{recipe:?}"
                );
                assert_eq!(recipe.worn.is_some(), recipe.size > 512);
                assert!(recipe.size.is_multiple_of(PATCHES));
            }
        }
    }

    #[test]
    fn wear_repeats_and_varies() {
        let values: Vec<f64> = (0..64 * 64)
            .map(|n| wear((n % 64) as f64 / 64.0, (n / 64) as f64 / 64.0))
            .collect();
        assert!(values.iter().all(|value| (0.0..=1.0).contains(value)));
        let share =
            |test: fn(&f64) -> bool| values.iter().filter(|v| test(v)).count() as f64 / values.len() as f64;
        assert!(
            share(|v| *v < 0.2) > 0.2 && share(|v| *v > 0.8) > 0.1,
            "both states are seen"
        );
        assert!(
            (wear(0.3, 0.0) - wear(0.3, 1.0)).abs() < 1e-9 && (wear(0.0, 0.7) - wear(1.0, 0.7)).abs() < 1e-9
        );
    }
}
