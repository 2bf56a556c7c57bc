//! Meshes and lights that hold anything: the picture is finite, and what is defined is what is drawn.

use glam::{Vec2, Vec3, Vec4};
use scenes::{Instance, Light, Mesh};

use super::*;
use crate::scene::{btf, diffuse, sphere, square, still_life};

const ODD: [f32; 5] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e38, 1e-42];

/// `mesh` with `spoil` applied to every other vertex, with each odd value in turn.
fn spoiled(mesh: &Mesh, spoil: impl Fn(&mut Mesh, usize, f32)) -> Mesh {
    let mut mesh = mesh.clone();
    for vertex in (0..mesh.positions.len()).step_by(2) {
        spoil(&mut mesh, vertex, ODD[vertex / 2 % ODD.len()]);
    }
    mesh
}

fn scene_of(mesh: Mesh, material: usize) -> (Scene, Camera) {
    let (mut scene, camera) = still_life();
    scene.meshes = vec![Mesh { material, ..mesh }];
    scene.instances = vec![Instance {
        mesh: 0,
        world_from_mesh: Default::default(),
    }];
    scene.lights.extend([
        // Grazing, below, of no direction, in the surface, and of any brightness.
        Light::Directional {
            to_light: Vec3::new(1.0, 1e-7, 0.0),
            irradiance: Vec3::ONE,
        },
        Light::Directional {
            to_light: Vec3::NEG_Y,
            irradiance: Vec3::ONE,
        },
        Light::Directional {
            to_light: Vec3::ZERO,
            irradiance: Vec3::ONE,
        },
        Light::Point {
            position: Vec3::ZERO,
            intensity: Vec3::ONE,
        },
        Light::Point {
            position: Vec3::new(0.0, 1.0, 0.0),
            intensity: Vec3::splat(0.1),
        },
    ]);
    (scene, camera)
}

fn assert_finite(engine: &Engine, what: &str) {
    let picture = engine.picture().unwrap();
    let odd = picture
        .pixels
        .iter()
        .flatten()
        .position(|value| !value.is_finite());
    assert_eq!(odd, None, "{what}");
}

#[test]
fn pictures_are_finite_whatever_meshes_hold() {
    let archive = Recipe {
        width: 64,
        height: 64,
        groups: 1,
        ..Default::default()
    }
    .build();
    let ball = sphere(0, 24, 12);
    let flat = |mesh: &mut Mesh, vertex: usize| mesh.positions[vertex] = mesh.positions[0];
    let meshes: [(&str, Mesh); 8] = [
        (
            "positions",
            spoiled(&ball, |mesh, i, odd| mesh.positions[i].y = odd),
        ),
        ("normals", spoiled(&ball, |mesh, i, odd| mesh.normals[i].x = odd)),
        (
            "uvs",
            spoiled(&ball, |mesh, i, odd| mesh.uvs[i] = Vec2::new(odd, 0.5)),
        ),
        (
            "tangents",
            spoiled(&ball, |mesh, i, odd| mesh.tangents[i] = Vec4::splat(odd)),
        ),
        ("no area", spoiled(&ball, |mesh, i, _| flat(mesh, i))),
        (
            "one uv",
            spoiled(&ball, |mesh, i, _| mesh.uvs[i & !3] = Vec2::ZERO),
        ),
        (
            "nothing but positions",
            Mesh {
                normals: vec![Vec3::ZERO; ball.positions.len()],
                tangents: vec![Vec4::ZERO; ball.positions.len()],
                uvs: vec![Vec2::ZERO; ball.positions.len()],
                ..ball.clone()
            },
        ),
        (
            "inside out",
            Mesh {
                normals: ball.normals.iter().map(|normal| -*normal).collect(),
                tangents: ball.normals.iter().map(|normal| normal.extend(-1.0)).collect(),
                ..ball.clone()
            },
        ),
    ];
    let context = Context::headless().unwrap();
    for (what, mesh) in meshes {
        for (material, name) in [(0, "btf"), (1, "diffuse")] {
            let (mut scene, camera) = scene_of(mesh.clone(), material);
            scene.materials = vec![btf("weave", 2.0), diffuse([0.5; 3])];
            let mut engine = Engine::new(
                context.clone(),
                &scene,
                source(&[("weave", &archive)]),
                options((64, 36)),
            )
            .unwrap();
            engine.wait_for_materials(LIMIT).unwrap();
            engine.frame(&camera).unwrap();
            assert_finite(&engine, &format!("{what}, {name}, nothing resident"));
            settle(&mut engine, &camera);
            assert_finite(&engine, &format!("{what}, {name}"));
            save(&engine, &format!("odd {what} {name}.png"));
            if what == "positions" {
                let first = scene.meshes[0].indices.chunks(3);
                let drawn: Vec<_> = first
                    .map(|corners| corners.iter().all(|&i| mesh.positions[i as usize].is_finite()))
                    .collect();
                let seen = engine.visibility().unwrap();
                let mut seen = seen.iter().filter(|ids| ids[0] != 0).peekable();
                assert!(seen.peek().is_some() && seen.all(|ids| drawn[ids[1] as usize]));
            }
        }
    }
}

#[test]
fn without_normals_and_tangents_the_picture_is_the_references() {
    let archive = Recipe {
        width: 64,
        height: 64,
        groups: 1,
        ..Default::default()
    }
    .build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (mut scene, camera) = still_life();
    let ball = &mut scene.meshes[1];
    for vertex in 0..ball.positions.len() {
        match vertex % 3 {
            0 => ball.normals[vertex] = Vec3::splat(f32::NAN),
            1 => ball.tangents[vertex] = Vec4::splat(f32::INFINITY),
            _ => ball.uvs[vertex] = Vec2::NAN,
        }
    }
    // The ground has no frame at all.
    scene.meshes[0] = Mesh {
        normals: vec![Vec3::splat(f32::NAN); 4],
        tangents: vec![Vec4::ZERO; 4],
        ..square(0)
    };
    let mut engine = engine(&scene, archives, options((160, 90)));
    settle(&mut engine, &camera);
    save(&engine, "odd references.png");
    let error = relative_rmse(
        &engine.picture().unwrap(),
        &reference(&engine, &scene, &camera, archives),
    );
    assert!(error < 1e-3, "{error}");
}

#[test]
fn light_beyond_all_bounds_is_black_not_infinite() {
    let (mut scene, camera) = still_life();
    scene.materials = vec![diffuse([0.5; 3]); 3];
    scene.lights = vec![Light::Directional {
        to_light: Vec3::Y,
        irradiance: Vec3::splat(f32::INFINITY),
    }];
    let mut engine = engine(&scene, &[], options((32, 18)));
    settle(&mut engine, &camera);
    assert_finite(&engine, "infinite light");
    scene.ambient = Vec3::splat(f32::NAN);
    scene.background = Vec3::splat(f32::NAN);
    scene.lights[0] = Light::Point {
        position: Vec3::splat(f32::NAN),
        intensity: Vec3::splat(f32::NAN),
    };
    let mut other = super::engine(&scene, &[], options((32, 18)));
    settle(&mut other, &camera);
    assert_finite(&other, "a light that is no number");
}
