//! Both ways of interpolating between directions, against the f64 reference and against each other.

use engine::{
    angular::Angular,
    frame::{Arithmetic, HALF_ERROR},
};
use glam::Vec3;
use scenes::Light;
use tileset::Direction;

use super::*;
use crate::{
    material::glossy,
    pictures::{ambient_square, slanted},
    scene::still_life,
};

const WAYS: [Angular; 2] = [Angular::Delaunay, Angular::Hemisphere];

fn with(angular: Angular, size: (u32, u32)) -> Options {
    Options {
        angular,
        ..options(size)
    }
}

fn small(recipe: Recipe) -> Recipe {
    Recipe {
        width: 64,
        height: 64,
        groups: 1,
        ..recipe
    }
}

fn shot(scene: &Scene, camera: &Camera, archive: &[u8], options: Options) -> (Picture, Picture) {
    let archives: &[(&str, &[u8])] = &[("weave", archive)];
    let mut engine = engine(scene, archives, options);
    settle(&mut engine, camera);
    (
        engine.picture().unwrap(),
        reference(&engine, scene, camera, archives),
    )
}

/// A little light from each side, no highlight.
fn smooth(component: u32, view: [f64; 3], light: [f64; 3], rgb: usize) -> f64 {
    let lean = 0.2 * f64::from(component) * view[0] * light[1];
    [0.8, 0.6, 0.4][rgb] * (1.0 + 0.3 * light[0]) + lean
}

type Abrdf = fn(u32, [f64; 3], [f64; 3], usize) -> f64;

/// Nearly the largest half floats.
fn glaring(component: u32, view: [f64; 3], light: [f64; 3], rgb: usize) -> f64 {
    glossy(component, view, light, rgb).clamp(-1.0, 1.0) * 6.5e4
}

fn one(theta: f64) -> Vec<Direction> {
    vec![Direction { theta, phi: 0.4 }]
}

fn line() -> Vec<Direction> {
    let at = |i: i32| Direction {
        theta: f64::from(i.abs()) * 0.3,
        phi: if i < 0 { 0.3 + std::f64::consts::PI } else { 0.3 },
    };
    (-4..=4).map(at).collect()
}

/// To the horizon.
fn deep() -> Vec<Direction> {
    let rings = [(0.0, 1), (0.5, 6), (1.0, 10), (std::f64::consts::FRAC_PI_2, 14)];
    let ring = |(theta, count): (f64, u32)| {
        (0..count).map(move |i| Direction {
            theta,
            phi: f64::from(i) * std::f64::consts::TAU / f64::from(count),
        })
    };
    rings.into_iter().flat_map(ring).collect()
}

#[test]
fn errors_against_the_reference_are_those_stated() {
    let (scene, camera) = still_life();
    for (name, recipe, most) in [
        (
            "smooth",
            Recipe {
                abrdf: smooth,
                ..Default::default()
            },
            2e-3,
        ),
        ("glossy", Recipe::default(), 1e-2),
        (
            "glossy, with cosine",
            Recipe {
                cosine: true,
                ..Default::default()
            },
            1e-2,
        ),
    ] {
        let archive = small(recipe).build();
        let errors = WAYS.map(|angular| {
            let (picture, exact) = shot(&scene, &camera, &archive, with(angular, (160, 90)));
            relative_rmse(&picture, &exact)
        });
        println!("{name}: {:.2e} and {:.2e}", errors[0], errors[1]);
        // Resampling shows, so it is really another way.
        assert!(errors[0] < 1e-3 && errors[1] < most, "{name}: {errors:?}");
        assert!(errors[1] > errors[0], "{name}: {errors:?}");
    }
}

#[test]
fn sums_of_half_floats_stay_in_their_error() {
    let (scene, camera) = still_life();
    let has_half = Context::headless().unwrap().has_half_arithmetic();
    for (name, abrdf) in [
        ("glossy", glossy as Abrdf),
        ("as bright as half floats can be", glaring),
    ] {
        let archive = small(Recipe {
            abrdf,
            ..Default::default()
        })
        .build();
        let archives: &[(&str, &[u8])] = &[("weave", &archive)];
        let mut engine = engine(&scene, archives, options((160, 90)));
        settle(&mut engine, &camera);
        if !has_half {
            let refused = engine.set_arithmetic(Arithmetic::Half).unwrap_err().to_string();
            assert!(refused.contains("single precision"), "{refused}");
            continue;
        }
        let mut of = |arithmetic| {
            engine.set_arithmetic(arithmetic).unwrap();
            settle(&mut engine, &camera);
            engine.picture().unwrap()
        };
        let [single, half, again] = [Arithmetic::Single, Arithmetic::Half, Arithmetic::Single].map(&mut of);
        assert!(single == again, "{name}: it changes back");
        assert!(half.pixels.iter().flatten().all(|value| value.is_finite()));
        let exact = reference(&engine, &scene, &camera, archives);
        let (rounding, error) = (relative_rmse(&half, &single), relative_rmse(&half, &exact));
        println!("{name}: {rounding:.1e} by half floats, {error:.1e} in all");
        assert!(rounding > 0.0 && rounding < HALF_ERROR, "{name}: {rounding}");
        assert!(error < 1e-3, "{name}: {error}");
    }
}

#[test]
fn few_samples_and_samples_anywhere_are_defined() {
    let (scene, camera) = still_life();
    let horizon = || one(std::f64::consts::FRAC_PI_2);
    for (name, directions, cosine, most) in [
        ("one", (|| one(0.7)) as fn() -> Vec<Direction>, true, 1e-3),
        ("one at the normal", || one(0.0), false, 1e-3),
        ("one at the horizon", horizon, false, 1e-3),
        // It has a cosine of zero, and tells nothing of lights elsewhere.
        ("one at the horizon, with cosine", horizon, true, 1.0),
        ("a line", line, false, 4e-2),
        ("a line, with cosine", line, true, 4e-2),
        ("to the horizon", deep, false, 4e-2),
        ("to the horizon, with cosine", deep, true, 4e-2),
    ] {
        let recipe = Recipe {
            directions,
            cosine,
            ..Default::default()
        };
        let archive = small(recipe).build();
        for (angular, most) in WAYS.into_iter().zip([1e-3, most]) {
            let (picture, exact) = shot(&scene, &camera, &archive, with(angular, (80, 45)));
            assert!(picture.pixels.iter().flatten().all(|value| value.is_finite()));
            let error = relative_rmse(&picture, &exact);
            println!("{name}, {angular:?}: {error:.1e}");
            assert!(error < most, "{name} {angular:?}: {error}");
        }
    }
}

#[test]
fn lights_at_the_limits_are_defined() {
    let archives = [false, true].map(|cosine| {
        small(Recipe {
            cosine,
            ..Default::default()
        })
        .build()
    });
    let mut square = ambient_square(1.0);
    square.ambient = Vec3::ZERO;
    let down = Camera {
        eye: Vec3::new(0.0, 2.0, 0.0),
        up: Vec3::NEG_Z,
        target: Vec3::ZERO,
        ..slanted(1.0)
    };
    let grazing = Camera {
        eye: Vec3::new(0.1, 0.02, 0.95),
        target: Vec3::new(0.0, 0.02, -1.0),
        ..slanted(1.0)
    };
    // One after the other, but those without an effect together: at the horizon, below it, of no direction. The others:
    // straight above, to both sides of where angles wrap, beyond the sampled cone, and grazing.
    let dark = vec![Vec3::X, Vec3::new(0.0, -1e-7, 1.0), Vec3::NEG_Y, Vec3::ZERO];
    let lights = [
        vec![Vec3::Y],
        vec![Vec3::Y],
        vec![Vec3::new(1.0, 1.0, 1e-7)],
        vec![Vec3::new(1.0, 1.0, -1e-7)],
        vec![Vec3::new(-1.0, 0.2, 0.1)],
        vec![Vec3::new(0.3, 1e-3, 1.0)],
        vec![Vec3::new(0.3, 1e-7, 1.0)],
        dark.clone(),
        dark,
    ];
    let settings = archives.iter().zip([down, grazing]).cycle();
    for (lights, (archive, camera)) in lights.into_iter().zip(settings) {
        let light = |to_light: &Vec3| Light::Directional {
            to_light: to_light.normalize_or_zero(),
            irradiance: Vec3::ONE,
        };
        square.lights = lights.iter().map(light).collect();
        for (angular, most) in WAYS.into_iter().zip([1e-3, 5e-2]) {
            let what = format!("{lights:?} {angular:?}");
            let (picture, exact) = shot(&square, &camera, archive, with(angular, (32, 24)));
            let largest = picture.pixels.iter().flatten().fold(0f32, |a, b| a.max(b.abs()));
            assert!(picture.pixels.iter().flatten().all(|value| value.is_finite()));
            if lights.len() == 1 {
                let error = relative_rmse(&picture, &exact);
                assert!(largest > 0.0 && error < most, "{what}: {error}");
            } else {
                assert_eq!(largest, 0.0, "{what}");
            }
        }
    }
}

#[test]
fn the_way_changes_at_run_time_and_back() {
    let archive = Recipe {
        groups: 3,
        ..small(Recipe::default())
    }
    .build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = still_life();
    for wait in [true, false] {
        let options = |angular| Options {
            wait,
            ..with(angular, (64, 36))
        };
        let fresh = WAYS.map(|angular| {
            let mut engine = engine(&scene, archives, options(angular));
            settle(&mut engine, &camera);
            engine.picture().unwrap()
        });
        assert!(relative_rmse(&fresh[0], &fresh[1]) > 1e-4);
        let mut engine = engine(&scene, archives, options(WAYS[0]));
        // In the middle of things, and settled.
        engine.frame(&camera).unwrap();
        engine.frame(&camera).unwrap();
        for turn in [1, 0] {
            engine.set_angular(WAYS[turn]).unwrap();
            let stats = *settle(&mut engine, &camera).last().unwrap();
            assert_eq!(stats.columns_resident, 3);
            let error = relative_rmse(&engine.picture().unwrap(), &fresh[turn]);
            assert!(error < 1e-6, "{turn}: {error}");
        }
        // Settled, all records are on the host.
        let before = settle(&mut engine, &camera).last().unwrap().wire_bytes_total;
        engine.set_angular(WAYS[1]).unwrap();
        let after = settle(&mut engine, &camera).last().unwrap().wire_bytes_total;
        assert_eq!(after, before);
    }
}

#[test]
fn a_way_without_room_for_a_column_changes_nothing() {
    let archive = small(Recipe::default()).build();
    let (scene, camera) = still_life();
    // A column takes 58 KiB as it was sampled, 408 KiB as maps of 17² texels.
    let options = Options {
        budgets: Budgets {
            column_cache_bytes: 100 << 10,
            ..options((64, 36)).budgets
        },
        ..options((64, 36))
    };
    let mut engine = engine(&scene, &[("weave", &archive)], options);
    settle(&mut engine, &camera);
    let (picture, slots) = (engine.picture().unwrap(), engine.column_slots());
    assert_eq!(slots, (1, 29 << 11));
    let error = engine.set_angular(Angular::Hemisphere).unwrap_err();
    assert!(
        matches!(&error, engine::Error::Budget(text) if text.contains("column")),
        "{error}"
    );
    assert_eq!(engine.angular(), Angular::Delaunay);
    let budgets = Budgets {
        column_cache_bytes: 1 << 20,
        ..engine.budgets()
    };
    assert!(settle(&mut engine, &camera).last().unwrap().columns_resident == 1);
    assert!(engine.picture().unwrap() == picture);
    engine.set_budgets(budgets).unwrap();
    engine.set_angular(Angular::Hemisphere).unwrap();
    assert_eq!(engine.column_slots(), (2, 4 * 3 * 17 * 256 * 8));
    settle(&mut engine, &camera);
    // Slots move to a cache of another size.
    let picture = engine.picture().unwrap();
    let budgets = Budgets {
        column_cache_bytes: 3 << 20,
        ..budgets
    };
    engine.set_budgets(budgets).unwrap();
    let stats = *settle(&mut engine, &camera).last().unwrap();
    assert!(stats.columns_resident == 1 && stats.added == 0);
    assert!(engine.picture().unwrap() == picture);
}

#[test]
fn the_ambient_light_is_the_same_in_both() {
    let archive = small(Recipe {
        abrdf: glossy,
        ..Default::default()
    })
    .build();
    let pictures = WAYS.map(|angular| {
        let (picture, _) = shot(
            &ambient_square(1.0),
            &slanted(1.0),
            &archive,
            with(angular, (64, 48)),
        );
        picture
    });
    assert!(relative_rmse(&pictures[0], &pictures[1]) < 1e-6);
}
