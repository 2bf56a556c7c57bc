//! Pictures against the f64 reference, and against what can be worked out without it.

use glam::{DVec3, Vec3};
use scenes::{Camera, Instance, Light, Scene};

use super::*;
use crate::{
    material::{weave, white},
    scene::{btf, diffuse, sphere, square, still_life},
};

/// A square of side 2 at the origin under ambient light of radiance one.
pub(crate) fn ambient_square(repeats: f32) -> Scene {
    Scene {
        meshes: vec![square(0)],
        instances: vec![Instance {
            mesh: 0,
            world_from_mesh: Default::default(),
        }],
        materials: vec![btf("weave", repeats)],
        ambient: Vec3::ONE,
        ..Default::default()
    }
}

/// Looks down at the square, slantwise.
pub(crate) fn slanted(distance: f32) -> Camera {
    let eye = Vec3::new(0.15, 0.8, 0.6) * distance;
    Camera {
        eye,
        target: Vec3::new(0.05, 0.0, 0.1),
        up: Vec3::Y,
        fov_y: 0.7,
        near: 0.01,
    }
}

/// Where the ray through a pixel meets the plane y = 0, as texture coordinates of the square.
fn st(camera: &Camera, x: usize, y: usize, size: (u32, u32)) -> Option<(f64, f64)> {
    let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5, size).as_dvec3();
    let point = camera.eye.as_dvec3() - ray * (f64::from(camera.eye.y) / ray.y);
    let st = (point.x * 0.5 + 0.5, point.z * 0.5 + 0.5);
    let inside = |at: f64| (0.0..1.0).contains(&at);
    (inside(st.0) && inside(st.1)).then_some(st)
}

/// Asserts that a settled picture shows `expected` at the texture coordinates of each pixel of the square.
pub(crate) fn assert_shows(
    engine: &Engine,
    camera: &Camera,
    tolerance: f64,
    expected: impl Fn(f64, f64) -> f64,
) {
    let picture = engine.picture().unwrap();
    let mut seen = 0;
    for (at, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = (at % picture.width as usize, at / picture.width as usize);
        if let Some((s, t)) = st(camera, x, y, engine.size()) {
            let error = (f64::from(pixel[1]) - expected(s, t)).abs();
            assert!(
                error < tolerance,
                "pixel {x} {y} at {s} {t}: {pixel:?}, expected {}",
                expected(s, t)
            );
            seen += 1;
        }
    }
    assert!(
        seen > picture.pixels.len() / 8,
        "the square covers {seen} pixels only"
    );
}

#[test]
fn settled_picture_is_the_references() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = still_life();
    let mut engine = engine(&scene, archives, options((320, 180)));
    settle(&mut engine, &camera);
    save(&engine, "still_life.png");
    let error = relative_rmse(
        &engine.picture().unwrap(),
        &reference(&engine, &scene, &camera, archives),
    );
    println!("{}: relative RMSE {error:.2e}", engine.adapter());
    assert!(error < 1e-3, "{error}");
}

#[test]
fn materials_of_any_size_are_the_references() {
    let (scene, camera) = still_life();
    let any = Recipe {
        groups: 1,
        ..Default::default()
    };
    for (name, recipe) in [
        (
            "one texel",
            Recipe {
                width: 1,
                height: 1,
                ..any
            },
        ),
        (
            "a row",
            Recipe {
                width: 300,
                height: 3,
                ..any
            },
        ),
        (
            "odd, clamped",
            Recipe {
                width: 129,
                height: 67,
                wrap: false,
                ..any
            },
        ),
        (
            "odd, with cosine",
            Recipe {
                width: 193,
                height: 130,
                cosine: true,
                ..any
            },
        ),
    ] {
        let archive = recipe.build();
        let archives: &[(&str, &[u8])] = &[("weave", &archive)];
        let mut engine = engine(&scene, archives, options((96, 54)));
        settle(&mut engine, &camera);
        let error = relative_rmse(
            &engine.picture().unwrap(),
            &reference(&engine, &scene, &camera, archives),
        );
        println!("{name}: relative RMSE {error:.2e}");
        assert!(error < 1e-3, "{name}: {error}");
    }
}

#[test]
fn a_ball_is_lambertian() {
    let light = Vec3::new(0.6, 0.5, 0.4).normalize();
    let scene = Scene {
        meshes: vec![sphere(0, 256, 128)],
        instances: vec![Instance {
            mesh: 0,
            world_from_mesh: Default::default(),
        }],
        materials: vec![diffuse([0.5; 3])],
        lights: vec![Light::Directional {
            to_light: light,
            irradiance: Vec3::splat(2.0),
        }],
        ambient: Vec3::splat(0.1),
        background: Vec3::splat(0.3),
        cameras: Vec::new(),
    };
    let camera = Camera {
        eye: Vec3::new(1.0, 1.5, 3.0),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 0.7,
        near: 0.1,
    };
    let size = (96, 64);
    let mut engine = engine(&scene, &[], options(size));
    settle(&mut engine, &camera);
    let picture = engine.picture().unwrap();
    let mut covered = 0;
    for (at, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = ((at % 96) as f32 + 0.5, (at / 96) as f32 + 0.5);
        let (ray, eye): (DVec3, DVec3) = (camera.ray(x, y, size).as_dvec3(), camera.eye.as_dvec3());
        let (half, rest) = (eye.dot(ray), eye.length_squared() - 1.0);
        let root = half * half - rest;
        // The silhouette of the triangles is not exactly the ball's.
        if root.abs() < 0.05 {
            continue;
        }
        let expected = if root > 0.0 {
            covered += 1;
            let normal = eye + ray * (-half - root.sqrt());
            0.5 * (0.1 + 2.0 * normal.dot(light.as_dvec3()).max(0.0) / std::f64::consts::PI)
        } else {
            0.3
        };
        assert!(
            (f64::from(pixel[0]) - expected).abs() < 2e-3,
            "{x} {y}: {} {expected}",
            pixel[0]
        );
    }
    assert!(covered > 500);
}

#[test]
fn page_borders_do_not_show() {
    // Smooth enough that bilinear filtering and the codec leave less than the tolerance; repeated, seen from close by,
    // so that pixels fall between texels on both sides of many borders and of the seam at 1.
    fn smooth(component: u32, s: f64, t: f64) -> f64 {
        let turn = std::f64::consts::TAU;
        if component == 0 {
            1.0 + 0.5 * (turn * s).sin() + 0.4 * (turn * t).cos()
        } else {
            0.0
        }
    }
    let recipe = Recipe {
        width: 320,
        height: 256,
        groups: 1,
        texture: smooth,
        abrdf: white,
        ..Default::default()
    };
    let archive = recipe.build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    for (distance, repeats) in [(0.4, 1.5), (1.0, 1.5), (3.0, 1.5)] {
        let camera = slanted(distance);
        let mut engine = engine(&ambient_square(repeats), archives, options((200, 120)));
        settle(&mut engine, &camera);
        save(&engine, &format!("borders_{distance}.png"));
        let repeats = f64::from(repeats);
        assert_shows(&engine, &camera, 6e-3, |s, t| smooth(0, s * repeats, t * repeats));
    }
}

#[test]
fn a_clamped_gradient_ends_at_its_borders() {
    fn gradient(component: u32, s: f64, t: f64) -> f64 {
        if component == 0 {
            0.3 + 0.5 * s + 0.2 * t
        } else {
            0.0
        }
    }
    let recipe = Recipe {
        width: 200,
        height: 150,
        wrap: false,
        groups: 1,
        texture: gradient,
        abrdf: white,
        ..Default::default()
    };
    let archive = recipe.build();
    let camera = slanted(1.2);
    let mut engine = engine(&ambient_square(2.0), &[("weave", &archive)], options((200, 120)));
    settle(&mut engine, &camera);
    save(&engine, "clamped.png");
    // The last texel's centre is half a texel before the border: up to there the gradient goes on.
    let clamp = |at: f64, side: f64| (2.0 * at).clamp(0.5 / side, 1.0 - 0.5 / side);
    assert_shows(&engine, &camera, 6e-3, |s, t| {
        gradient(0, clamp(s, 200.0), clamp(t, 150.0))
    });
}

#[test]
fn far_away_a_material_is_its_mean() {
    let recipe = Recipe {
        groups: 1,
        texture: weave,
        abrdf: white,
        ..Default::default()
    };
    let archive = recipe.build();
    let mut scene = ambient_square(2000.0);
    scene.background = Vec3::ONE;
    let camera = slanted(2.0);
    let mut engine = engine(&scene, &[("weave", &archive)], options((64, 48)));
    settle(&mut engine, &camera);
    assert_shows(&engine, &camera, 5e-3, |_, _| 0.6);
}

#[test]
fn the_screen_is_the_picture_tone_mapped() {
    let (mut scene, camera) = still_life();
    scene.materials = vec![diffuse([0.8, 0.2, 0.1]); 3];
    let mut engine = engine(
        &scene,
        &[],
        Options {
            exposure_stops: 0.5,
            ..options((64, 36))
        },
    );
    settle(&mut engine, &camera);
    let screen = engine.tonemapped().unwrap();
    let picture = engine.picture().unwrap();
    for (pixel, expected) in screen.chunks_exact(4).zip(picture.to_srgb8(0.5)) {
        for channel in 0..3 {
            assert!(
                pixel[channel].abs_diff(expected[channel]) <= 1,
                "{pixel:?} {expected:?}"
            );
        }
        assert_eq!(pixel[3], 255);
    }
}
