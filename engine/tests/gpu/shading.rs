//! Shading: work by tiles and materials, groups left out, pages fading in.

use engine::{gpu::cutoff::groups_that_matter, metrics::Picture};
use glam::{Affine3A, Quat, Vec3};
use scenes::Instance;

use super::*;
use crate::{
    material::{weave, white},
    pictures::{ambient_square, slanted},
    scene::{btf, diffuse, square, still_life},
};

#[test]
fn tiles_of_many_materials_are_the_references() {
    // Squares of a few pixels, every other one of a BTF.
    let squares = 0..400;
    let (lights, camera) = still_life();
    let scene = Scene {
        meshes: squares.clone().map(square).collect(),
        instances: squares
            .clone()
            .map(|mesh| Instance {
                mesh,
                world_from_mesh: Affine3A::from_scale_rotation_translation(
                    Vec3::splat(0.2),
                    Quat::from_rotation_x(mesh as f32 * 0.02),
                    Vec3::new(
                        (mesh % 20) as f32 * 0.3 - 3.0,
                        0.3,
                        (mesh / 20) as f32 * 0.3 - 3.0,
                    ),
                ),
            })
            .collect(),
        materials: squares
            .map(|i| {
                if i % 2 == 0 {
                    btf("weave", 1.0)
                } else {
                    diffuse([0.4; 3])
                }
            })
            .collect(),
        ..lights
    };
    let recipe = Recipe {
        width: 64,
        height: 64,
        groups: 1,
        ..Default::default()
    };
    let archive = recipe.build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let mut engine = engine(&scene, archives, options((200, 112)));
    settle(&mut engine, &camera);
    save(&engine, "many_materials.png");
    let picture = engine.picture().unwrap();
    let error = relative_rmse(&picture, &reference(&engine, &scene, &camera, archives));
    assert!(error < 1e-3, "{error}");
    let work = engine.shading_work().unwrap();
    assert!(work.items.iter().all(|&items| items > 0), "{work:?}");
    assert!(engine.picture().unwrap() == picture);
}

/// Component 0 is white; component 4 is weak on the left and weaker on the right, and so fine that coarse mips do not
/// have it.
fn two_groups(component: u32, s: f64, t: f64) -> f64 {
    let wave = (std::f64::consts::TAU * 33.0 * s).sin() * (std::f64::consts::TAU * 29.0 * t).cos();
    match component {
        0 => 0.5,
        4 if s < 0.5 => 0.04 * wave,
        4 => 0.01 * wave,
        _ => 0.0,
    }
}

/// All components alike: what is left out is the eigen-texture itself.
fn alike(_: u32, _: [f64; 3], _: [f64; 3], _: usize) -> f64 {
    1.0
}

#[test]
fn what_is_left_out_stays_under_the_error_and_is_not_fetched() {
    let recipe = Recipe {
        groups: 2,
        texture: two_groups,
        abrdf: alike,
        ..Default::default()
    };
    let archive = recipe.build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = (ambient_square(1.0), slanted(1.3));
    let shot = |component_error: f64| {
        let options = Options {
            component_error,
            ..options((160, 120))
        };
        let mut engine = engine(&scene, archives, options);
        settle(&mut engine, &camera);
        (engine.picture().unwrap(), engine.shading_work().unwrap())
    };
    let (exact, all) = shot(0.0);
    let covered = all.groups_fetched / 2;
    assert!(all.groups_left_out == 0 && covered > 5000, "{all:?}");
    for (error, halves) in [(0.002, 0.0), (0.01, 0.5), (0.1, 1.0)] {
        let (picture, work) = shot(error);
        assert_eq!(
            work.groups_fetched + work.groups_left_out,
            2 * covered,
            "{work:?}"
        );
        // Of the second group nothing, the right, all.
        let part = f64::from(work.groups_left_out) / f64::from(covered);
        assert!(
            (part - halves).abs() < 0.3 && (part == halves || halves == 0.5),
            "{part}"
        );
        // Where nothing is left out nothing changes; elsewhere the root mean square stays under the error.
        let differences = picture.pixels.iter().zip(&exact.pixels);
        let squares: Vec<_> = differences
            .map(|(a, b)| f64::from(a[1] - b[1]).powi(2))
            .filter(|square| *square > 0.0)
            .collect();
        assert!(squares.len() as u32 <= work.groups_left_out);
        let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        println!("{error}: {work:?}, rms {rms}");
        assert!(rms <= error && (halves == 0.0 || rms > 1e-4), "{error}: {rms}");
    }
}

#[test]
fn the_groups_that_matter_keep_the_energy_of_the_material() {
    let recipe = Recipe::default();
    let index = open(&recipe.build()).index;
    let groups = u32::from(recipe.groups);
    for error in [0.0, 0.05, 0.1, 0.2, 0.4] {
        let matter = groups_that_matter(&index, error);
        assert_eq!(matter.len() as u32, index.pyramid.tile_count());
        let (mut left_out, mut tiles) = (0.0, 0);
        for (tile, &leading) in index.pyramid.tiles().zip(&matter) {
            assert!(leading >= 1 && u32::from(leading) <= groups);
            if tile.mip > 0 {
                continue;
            }
            tiles += 1;
            for texel in 0..64 * 64 {
                let at = |tile: u16, at: u32| (f64::from(tile) * 64.0 + f64::from(at) + 0.5) / 256.0;
                let (s, t) = (at(tile.x, texel % 64), at(tile.y, texel / 64));
                let square = |component| weave(component, s, t).powi(2) / 4096.0;
                left_out += (u32::from(leading) * 4..groups * 4).map(square).sum::<f64>();
            }
        }
        let rms = (left_out / f64::from(tiles)).sqrt();
        println!("{error}: rms {rms}");
        assert!(rms <= error * 1.01, "{error}: {rms}");
        assert_eq!(rms > 0.0, error >= 0.1);
    }
}

#[test]
fn pages_come_in_by_weight_and_settled_pictures_do_not_tell() {
    // One texel: only a root, which fades in from the material's mean.
    let one = Recipe {
        width: 1,
        height: 1,
        groups: 1,
        abrdf: white,
        ..Default::default()
    };
    let archive = one.build();
    let (scene, camera) = (ambient_square(1.0), slanted(1.0));
    let fade = |fade_frames| Options {
        fade_frames,
        ..options((64, 48))
    };
    let middle = |picture: &Picture| f64::from(picture.pixels[24 * 64 + 32][0]);
    let mut slow = engine(&scene, &[("weave", &archive)], fade(5));
    let mut values = Vec::new();
    let mut settled = 0;
    while settled < 3 {
        let stats = slow.frame(&camera).unwrap();
        assert!(settled == 0 || !stats.drawn, "{stats:?}");
        settled += u32::from(stats.settled);
        values.push(middle(&slow.picture().unwrap()));
        assert!(values.len() < 200);
    }
    let (mean, last) = (0.42, values[values.len() - 1]);
    let steps: Vec<_> = values
        .iter()
        .map(|value| (value - mean) / (last - mean) * 5.0)
        .collect();
    println!("{steps:?}");
    for pair in steps.windows(2) {
        let step = pair[1] - pair[0];
        assert!(step.abs() < 1e-4 || (step - 1.0).abs() < 1e-4, "{steps:?}");
    }
    assert!(steps[0].abs() < 1.0 + 1e-4);

    let archive = Recipe::default().build();
    let (scene, camera) = still_life();
    let picture = |fade_frames| {
        let mut engine = engine(&scene, &[("weave", &archive)], fade(fade_frames));
        settle(&mut engine, &camera);
        engine.picture().unwrap()
    };
    assert!(picture(0) == picture(7));
}

#[test]
fn a_new_page_is_mixed_with_its_parent() {
    let archive = Recipe {
        groups: 1,
        abrdf: white,
        ..Default::default()
    }
    .build();
    let (scene, camera) = (ambient_square(1.0), slanted(0.7));
    let shots = |fade_frames| {
        let options = Options {
            fade_frames,
            budgets: Budgets {
                uploads_per_frame: 1,
                ..options((64, 48)).budgets
            },
            ..options((64, 48))
        };
        let mut engine = engine(&scene, &[("weave", &archive)], options);
        let mut pictures = Vec::new();
        loop {
            let stats = engine.frame(&camera).unwrap();
            pictures.push(engine.picture().unwrap());
            if stats.settled {
                return pictures;
            }
            assert!(pictures.len() < 500);
        }
    };
    let largest = |pictures: &[Picture]| {
        let steps = pictures.windows(2).map(|pair| relative_rmse(&pair[1], &pair[0]));
        steps.fold(0.0, f64::max)
    };
    let (at_once, slow) = (shots(0), shots(8));
    assert!(at_once.last() == slow.last());
    println!("{} {}", largest(&at_once), largest(&slow));
    assert!(largest(&slow) < 0.5 * largest(&at_once));
}
