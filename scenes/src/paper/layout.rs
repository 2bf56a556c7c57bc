//! Where things stand, and the light on them.

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::objects::{self, Turned};
use super::{PATCHES, PaperScene, Recipe, figures};
use crate::builder::{Builder, at, direction};
use crate::{Light, Mesh, Scene};

/// The scene in `triangles` triangles, about.
pub(super) fn layout(scene: PaperScene, triangles: f32) -> Scene {
    let recipes = scene.recipes();
    let mut builder = Builder::default();
    let materials: Vec<usize> = recipes
        .iter()
        .map(|recipe| builder.material(&recipe.archive, 1.0))
        .collect();
    match scene {
        PaperScene::Tori => tori(&mut builder, &materials, triangles),
        PaperScene::Objects => table(&mut builder, &materials, &recipes, triangles),
        PaperScene::Large => large(&mut builder, &materials, &recipes, triangles),
        PaperScene::Cylinders => cylinders(&mut builder, &materials, triangles),
        PaperScene::Figure => {
            let repeats = patches(&recipes[0], [16.0, 8.0]);
            builder.place(
                figures::seated(triangles, repeats, 1.0),
                materials[0],
                at(Vec3::ZERO, 0.0),
            );
        }
        PaperScene::Dense => {
            let repeats = patches(&recipes[0], [8.0, 16.0]);
            builder.place(
                figures::soldier(triangles, repeats, 1.86),
                materials[0],
                at(Vec3::ZERO, 0.3),
            );
        }
    }
    let mut scene = builder.scene;
    // From the left, 40 degrees above the horizon, and a cool one from behind: relief shows on all sides.
    scene.lights = vec![
        Light::Directional {
            to_light: direction(40.0, 40.0),
            irradiance: Vec3::new(7.0, 6.4, 5.6),
        },
        Light::Point {
            position: Vec3::new(2.6, 2.4, -3.0),
            intensity: Vec3::new(14.0, 17.0, 21.0),
        },
    ];
    scene.ambient = Vec3::new(0.3, 0.33, 0.37);
    scene.background = Vec3::new(0.045, 0.05, 0.058);
    scene
}

/// How often a material fits, from how many patches there shall be.
fn patches(recipe: &Recipe, count: [f32; 2]) -> Vec2 {
    let inside = if recipe.worn.is_some() {
        PATCHES as f32
    } else {
        1.0
    };
    Vec2::from(count) / inside
}

/// Distance between the middles of two tori, metres.
const PITCH: f32 = 0.5;

fn tori(builder: &mut Builder, materials: &[usize], triangles: f32) {
    let mesh = objects::torus(
        triangles / materials.len() as f32,
        Vec2::new(6.0, 2.0),
        0.15,
        0.072,
    );
    for (number, material) in materials.iter().enumerate() {
        let place = Vec3::new((number % 10) as f32 - 4.5, 0.0, (number / 10) as f32 - 4.5) * PITCH;
        // Leaning towards the front, each a little differently.
        let lean = 0.5 + 0.25 * (number as f32 * 2.4).sin();
        let turn = Quat::from_rotation_y(0.35 * (number as f32 * 1.7).sin()) * Quat::from_rotation_x(lean);
        builder.place(
            mesh.clone(),
            *material,
            Affine3A::from_rotation_translation(turn, place),
        );
    }
}

fn cylinders(builder: &mut Builder, materials: &[usize], triangles: f32) {
    for (number, material) in materials.iter().enumerate() {
        let across = number as f32 - 2.0;
        let place = Vec3::new(0.46 * across, 0.0, -0.1 * across * across);
        for part in objects::cylinder(triangles / 5.0, 0.19, 0.62) {
            builder.place(part, *material, at(place, 0.3 * across));
        }
    }
}

fn large(builder: &mut Builder, materials: &[usize], recipes: &[Recipe], triangles: f32) {
    let each = triangles / 4.0;
    let repeats = |number: usize, count: [f32; 2]| patches(&recipes[number], count);
    let standing = Quat::from_rotation_x(-0.2);
    let parts: [(Mesh, Affine3A); 4] = [
        (
            figures::seated(each, repeats(0, [16.0, 8.0]), 0.9),
            at(Vec3::new(-1.05, 0.0, 0.1), 0.35),
        ),
        (
            figures::soldier(each, repeats(1, [8.0, 16.0]), 1.25),
            at(Vec3::new(-0.28, 0.0, -0.35), 0.1),
        ),
        (
            objects::shell(each, repeats(2, [24.0, 4.0]), 0.33),
            at(Vec3::new(0.45, 0.05, 0.15), 0.6),
        ),
        (
            objects::knot(each, repeats(3, [48.0, 4.0]), 0.45, 2.0, 3.0),
            Affine3A::from_rotation_translation(standing, Vec3::new(1.2, 0.5, -0.1)),
        ),
    ];
    for ((mesh, place), material) in parts.into_iter().zip(materials) {
        builder.place(mesh, *material, place);
    }
}

/// Fifteen objects in three rows, and the ground, which shows the last object's material.
fn table(builder: &mut Builder, materials: &[usize], recipes: &[Recipe], triangles: f32) {
    let each = triangles * 0.99 / 15.0;
    let fit = |number: usize, across: f32, up: f32| patches(&recipes[number], [across, up]);
    let lean = |x: f32, turn: f32, height: f32| {
        Affine3A::from_rotation_translation(
            Quat::from_rotation_y(turn) * Quat::from_rotation_x(x),
            Vec3::Y * height,
        )
    };
    let upright = || at(Vec3::ZERO, 0.2);
    let square = |size: f32| Vec3::splat(size);
    let things: [(Mesh, Affine3A); 15] = [
        (
            figures::seated(each, fit(0, 16.0, 8.0), 0.95),
            at(Vec3::ZERO, 0.15),
        ),
        (
            figures::soldier(each, fit(1, 8.0, 16.0), 1.1),
            at(Vec3::ZERO, 0.25),
        ),
        (
            objects::knot(each, fit(2, 48.0, 4.0), 0.34, 2.0, 3.0),
            lean(-0.5, 0.3, 0.36),
        ),
        (
            objects::shell(each, fit(3, 24.0, 4.0), 0.27),
            lean(0.0, 0.8, 0.02),
        ),
        (
            objects::turned(each, fit(4, 8.0, 8.0), 0.62, Turned::Pawn),
            upright(),
        ),
        (
            objects::turned(each, fit(5, 8.0, 8.0), 0.62, Turned::Vase),
            upright(),
        ),
        (
            objects::torus(each, fit(6, 8.0, 4.0), 0.2, 0.1),
            lean(0.35, 0.0, 0.17),
        ),
        (
            objects::superquadric(each, fit(7, 8.0, 4.0), Vec3::new(0.25, 0.13, 0.25), 4.0),
            lean(0.0, 0.5, 0.13),
        ),
        (
            objects::blob(each, fit(8, 6.0, 3.0), 0.22, 0.0),
            lean(0.0, 0.0, 0.22),
        ),
        (
            objects::superquadric(each, fit(9, 6.0, 3.0), square(0.36), 0.75),
            lean(0.62, 0.78, 0.24),
        ),
        (
            objects::turned(each, fit(10, 6.0, 5.0), 0.5, Turned::Bowl),
            upright(),
        ),
        (objects::fluted(each, fit(11, 6.0, 4.0), 0.55), upright()),
        (
            objects::superquadric(each, fit(12, 4.0, 2.0), square(0.2), 6.0),
            lean(0.0, 0.5, 0.2),
        ),
        (
            objects::twisted(each, fit(13, 6.0, 4.0), 0.27),
            lean(objects::HALF_TURN * 0.42, 0.4, 0.27),
        ),
        (
            objects::blob(each, fit(14, 2.0, 1.0), 0.23, 1.0),
            lean(0.0, 1.0, 0.16),
        ),
    ];
    // The tall ones stand behind.
    const PLACES: [usize; 15] = [1, 3, 4, 2, 6, 8, 10, 12, 13, 9, 5, 0, 11, 14, 7];
    for ((number, (mesh, turn)), place) in things.into_iter().enumerate().zip(PLACES) {
        let (column, row) = (place % 5, place / 5);
        let shift = 0.2 * (row % 2) as f32;
        let position = Vec3::new(
            0.72 * (column as f32 - 2.0) + shift,
            0.0,
            0.72 * (row as f32 - 1.0),
        );
        let placed = Affine3A::from_translation(position) * turn;
        builder.place(mesh, materials[number], placed);
    }
    let ground = objects::ground(triangles * 0.01, 9.0, 15.0);
    builder.place(ground, materials[14], at(Vec3::ZERO, 0.0));
}
