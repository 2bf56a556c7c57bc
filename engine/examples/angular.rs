//! Compares the ways of interpolating between directions: `cargo run -p engine --example angular`.
//!
//! The still life of the tests with an analytic material of 24 components, sampled for the 81 and the 151 directions of the
//! BTFs of Bonn: bytes of the column cache, fetches, time of the shading pass, and the error of the picture against the
//! f64 reference of the same factors. Times are medians, the ways in turn, in one process: judge by their ratio.

// The tests use more of these.
#[allow(dead_code)]
#[path = "../tests/gpu/material.rs"]
mod material;
#[allow(dead_code)]
#[path = "../tests/gpu/scene.rs"]
mod scene;

use std::time::Duration;

use engine::{
    angular::Angular,
    frame::{Engine, Options},
    gpu::Context,
    metrics::Picture,
    reference::{FactorReflectance, Reflectance, shade},
};
use material::{Recipe, open, source};
use scenes::{Camera, Scene, Surface};
use tileset::Direction;

type Failure = Box<dyn std::error::Error>;

const LIMIT: Duration = Duration::from_secs(120);
const SIZE: (u32, u32) = (480, 270);
/// Pictures that are timed of each way.
const PICTURES: usize = 9;

fn rings(thetas: &[f64], counts: &[u32]) -> Vec<Direction> {
    let ring = |(&theta, &count): (&f64, &u32)| {
        (0..count).map(move |i| Direction {
            theta: theta.to_radians(),
            phi: f64::from(i) * std::f64::consts::TAU / f64::from(count),
        })
    };
    thetas.iter().zip(counts).flat_map(ring).collect()
}

fn bonn81() -> Vec<Direction> {
    rings(&[0.0, 15.0, 30.0, 45.0, 60.0, 75.0], &[1, 6, 12, 18, 20, 24])
}

fn bonn151() -> Vec<Direction> {
    rings(
        &[0.0, 11.0, 23.5, 30.0, 37.5, 45.0, 52.5, 60.0, 67.5, 75.0],
        &[1, 6, 12, 12, 12, 18, 18, 24, 24, 24],
    )
}

/// A little light from each side, no highlight.
fn smooth(component: u32, view: [f64; 3], light: [f64; 3], rgb: usize) -> f64 {
    [0.8, 0.6, 0.4][rgb] * (1.0 + 0.3 * light[0]) + 0.2 * f64::from(component) * view[0] * light[1]
}

fn exact(engine: &Engine, scene: &Scene, camera: &Camera, archive: &[u8]) -> Result<Picture, Failure> {
    let factors = FactorReflectance::new(&open(archive))?;
    let of_material = |material: &scenes::Material| match material.surface {
        Surface::Btf { .. } => Some(&factors as &dyn Reflectance),
        Surface::Diffuse { .. } => None,
    };
    let materials: Vec<_> = scene.materials.iter().map(of_material).collect();
    Ok(shade(scene, camera, SIZE, &engine.visibility()?, &materials))
}

fn relative_rmse(ours: &Picture, exact: &Picture) -> f64 {
    let (mut difference, mut square) = (0.0, 0.0);
    for (ours, exact) in ours.pixels.iter().flatten().zip(exact.pixels.iter().flatten()) {
        difference += f64::from(ours - exact).powi(2);
        square += f64::from(*exact).powi(2);
    }
    (difference / square).sqrt()
}

fn main() -> Result<(), Failure> {
    let ways = [Angular::Delaunay, Angular::Hemisphere];
    let (scene, camera) = scene::still_life();
    println!("| directions | material | way | column, KiB | fetches | shading, ms | relative RMSE |");
    println!("|---|---|---|---:|---:|---:|---:|");
    for (directions, name) in [(bonn81 as fn() -> _, "81 × 81"), (bonn151, "151 × 151")] {
        for (abrdf, kind) in [
            (smooth as fn(_, _, _, _) -> _, "smooth"),
            (material::glossy, "glossy"),
        ] {
            let recipe = Recipe {
                width: 128,
                height: 128,
                groups: 6,
                directions,
                abrdf,
                ..Default::default()
            };
            let archive = recipe.build();
            let mut engines = Vec::new();
            for angular in ways {
                let options = Options {
                    size: SIZE,
                    angular,
                    ..Default::default()
                };
                let source = source(&[("weave", &archive)]);
                let mut engine = Engine::new(Context::headless()?, &scene, source, options)?;
                engine.wait_for_materials(LIMIT)?;
                engine.settle(&camera, LIMIT)?;
                engines.push((engine, Vec::new()));
            }
            for picture in 0..=PICTURES {
                for (engine, times) in &mut engines {
                    // Something has to change for a picture to be drawn; it comes with the next frame's times.
                    engine.set_exposure_stops(picture as f32 * 0.01);
                    engine.frame(&camera)?;
                    engine.set_exposure_stops(picture as f32 * 0.01 + 0.005);
                    let stats = engine.frame(&camera)?;
                    times.extend(stats.ms.gpu.map(|gpu| gpu.shade));
                }
            }
            for (engine, times) in &mut engines {
                times.sort_by(f64::total_cmp);
                let angular = engine.angular();
                let error = relative_rmse(&engine.picture()?, &exact(engine, &scene, &camera, &archive)?);
                println!(
                    "| {name} | {kind} | {angular:?} | {} | {} | {:.1} | {error:.1e} |",
                    engine.column_slots().1 / 1024,
                    angular.fetches(),
                    times.get(times.len() / 2).copied().unwrap_or(f64::NAN),
                );
            }
        }
    }
    Ok(())
}
