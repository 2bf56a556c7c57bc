//! The renderer on a real adapter, hardware or software. A machine without one fails here.

mod angular;
mod arrivals;
mod baseline;
mod borders;
mod budgets;
mod byte_slots;
mod changes;
mod decode;
mod format_choice;
mod in_flight;
mod maps;
mod material;
mod odd;
mod overlays;
mod page_formats;
mod pictures;
mod prefetch;
mod rounds;
mod scene;
mod shading;
mod streams;
mod versions;
mod virtual_pictures;
mod votes;

use std::time::Duration;

use engine::{
    frame::{Budgets, Engine, FrameStats, Options},
    gpu::{Context, PageFormat},
    metrics::Picture,
    reference::{FactorReflectance, Reflectance, shade},
};
use material::{Recipe, open, source};
use scenes::{Camera, Scene, Surface};

const LIMIT: Duration = Duration::from_secs(60);

fn options(size: (u32, u32)) -> Options {
    Options {
        size,
        budgets: Budgets {
            page_cache_bytes: 32 << 20,
            column_cache_bytes: 64 << 20,
            ..Budgets::default()
        },
        // Budgets here are slots of half floats; `page_formats` has the others.
        page_format: Some(PageFormat::Half),
        ..Default::default()
    }
}

fn engine(scene: &Scene, archives: &[(&str, &[u8])], options: Options) -> Engine {
    let mut engine = Engine::new(Context::headless().unwrap(), scene, source(archives), options).unwrap();
    engine.wait_for_materials(LIMIT).unwrap();
    engine
}

fn settle(engine: &mut Engine, camera: &Camera) -> Vec<FrameStats> {
    let frames = engine.settle(camera, LIMIT).unwrap();
    let problems: Vec<_> = engine.problems().collect();
    assert!(frames.last().unwrap().settled, "{:?} {problems:?}", frames.last());
    assert!(problems.is_empty(), "{problems:?}");
    frames
}

/// The same pixels by the f64 reference, from the same archives.
fn reference(engine: &Engine, scene: &Scene, camera: &Camera, archives: &[(&str, &[u8])]) -> Picture {
    let factors: Vec<_> = archives
        .iter()
        .map(|(_, bytes)| FactorReflectance::new(&open(bytes)).unwrap())
        .collect();
    let of_material = |surface: &Surface| match surface {
        Surface::Btf { archive, .. } => {
            let at = archives.iter().position(|(name, _)| name == archive)?;
            Some(&factors[at] as &dyn Reflectance)
        }
        Surface::Diffuse { .. } => None,
    };
    let materials: Vec<_> = scene
        .materials
        .iter()
        .map(|material| of_material(&material.surface))
        .collect();
    shade(
        scene,
        camera,
        engine.size(),
        &engine.visibility().unwrap(),
        &materials,
    )
}

/// Root mean square difference relative to the root mean square of `b`.
fn relative_rmse(a: &Picture, b: &Picture) -> f64 {
    let square = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>();
    let (a, b) = (a.pixels.iter().flatten(), b.pixels.iter().flatten());
    let difference = square(&mut a.zip(b.clone()).map(|(a, b)| a - b));
    (difference / square(&mut b.copied())).sqrt()
}

/// Keeps a picture to look at, in the folder that the environment variable EIGENTILE_TEST_PICTURES names.
fn save(engine: &Engine, name: &str) {
    if let Some(folder) = std::env::var_os("EIGENTILE_TEST_PICTURES") {
        let (width, height) = engine.size();
        let path = std::path::Path::new(&folder).join(name);
        image::save_buffer(
            path,
            &engine.tonemapped().unwrap(),
            width,
            height,
            image::ColorType::Rgba8,
        )
        .unwrap();
    }
}
