//! Streaming changes when a picture is sharp, never whether it is right.

use std::sync::LazyLock;
use std::time::Duration;

use engine::frame::{Budgets, Engine, FrameStats, Options};
use engine::gpu::Context;
use engine::metrics::Picture;
use engine::reference::{FactorReflectance, Reflectance, shade};
use engine::stream::{Faults, FaultySource, FolderSource, HttpOptions, HttpSource, MemorySource, TileSource};
use scenes::{Camera, Scene, Surface};
use tests::{Fixture, Server, scene};

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);
/// No adapter is a failure, not a reason to skip.
static CONTEXT: LazyLock<Context> = LazyLock::new(|| Context::headless().expect("a graphics adapter"));

const SIZE: (u32, u32) = (128, 96);
const LIMIT: Duration = Duration::from_secs(120);

fn engine(scene: &Scene, source: impl TileSource + 'static, options: Options) -> Engine {
    let options = Options {
        size: SIZE,
        ..options
    };
    let mut engine = Engine::new(CONTEXT.clone(), scene, Box::new(source), options).unwrap();
    engine.wait_for_materials(LIMIT).unwrap();
    engine
}

fn ample() -> Options {
    Options {
        budgets: Budgets {
            page_cache_bytes: 32 << 20,
            column_cache_bytes: 8 << 20,
            ..Budgets::default()
        },
        ..Options::default()
    }
}

fn settle(engine: &mut Engine, camera: &Camera) -> (FrameStats, Picture) {
    let frames = engine.settle(camera, LIMIT).unwrap();
    let last = *frames.last().unwrap();
    assert!(
        last.settled,
        "{last:?}, {:?}",
        engine.problems().collect::<Vec<_>>()
    );
    (last, engine.picture().unwrap())
}

fn folder() -> FolderSource {
    FolderSource::new(FIXTURE.tiles()).unwrap()
}

fn memory() -> MemorySource {
    let mut source = MemorySource::new();
    for name in ["leather", "studs"] {
        source
            .insert(name, std::fs::read(FIXTURE.archive(name)).unwrap())
            .unwrap();
    }
    source
}

/// Nowhere further apart than the rounding of a texture filter: records that arrive in another order lie in
/// other slots, and filters round their coordinates there.
fn assert_same(picture: &Picture, expected: &Picture, what: &str) {
    let pairs = picture
        .pixels
        .iter()
        .flatten()
        .zip(expected.pixels.iter().flatten());
    let (mut error, mut norm) = (0.0, 0.0);
    for (a, b) in pairs {
        assert!(
            (a - b).abs() < 0.02 * b.abs() + 2e-3,
            "{what}: {a} instead of {b}"
        );
        error += f64::from(a - b).powi(2);
        norm += f64::from(*b).powi(2);
    }
    assert!(
        (error / norm).sqrt() < 1e-3,
        "{what}: relative difference {}",
        (error / norm).sqrt()
    );
}

#[test]
fn the_same_answers_give_the_same_bits() {
    let scene = scene();
    let camera = scene.cameras[0];
    let [(_, first), (_, second)] = [0, 1].map(|_| settle(&mut engine(&scene, memory(), ample()), &camera));
    assert!(first == second);
}

#[test]
fn every_source_gives_the_same_picture() {
    let scene = scene();
    let camera = scene.cameras[0];
    let server = Server::start(&FIXTURE.tiles());
    let http = || HttpSource::new(&server.address, &HttpOptions::default()).unwrap();
    // Decodes beside the frames, and waits for nothing.
    let free = Options {
        wait: false,
        ..ample()
    };
    let faults = Faults {
        fail: 0.1,
        repeat: 0.1,
        damage: 0.1,
        reorder: 0.3,
        delay_polls: 3,
        ..Faults::default()
    };
    let (expected_stats, expected) = settle(&mut engine(&scene, memory(), ample()), &camera);
    assert!(expected_stats.pages_resident > 0 && expected_stats.columns_resident == 8);
    for (name, mut engine) in [
        ("folder", engine(&scene, folder(), ample())),
        ("http", engine(&scene, http(), ample())),
        ("http, free", engine(&scene, http(), free)),
        (
            "faulty",
            engine(&scene, FaultySource::new(memory(), faults, 7), ample()),
        ),
    ] {
        let (stats, picture) = settle(&mut engine, &camera);
        assert_eq!(
            (stats.pages_resident, stats.columns_resident),
            (expected_stats.pages_resident, 8),
            "{name}"
        );
        assert_same(&picture, &expected, name);
    }
}

#[test]
fn a_settled_view_stands_still() {
    let scene = scene();
    let camera = scene.cameras[0];
    let mut engine = engine(&scene, folder(), ample());
    let (settled, picture) = settle(&mut engine, &camera);
    for _ in 0..5 {
        let stats = engine.frame(&camera).unwrap();
        assert_eq!(
            (stats.added, stats.swapped, stats.wire_bytes, stats.in_flight),
            (0, 0, 0, 0)
        );
        assert!(stats.settled && !stats.drawn && stats.wire_bytes_total == settled.wire_bytes_total);
    }
    assert!(engine.picture().unwrap() == picture);
}

#[test]
fn the_way_to_a_view_leaves_no_trace() {
    let scene = scene();
    let camera = scene.cameras[0];
    let (_, direct) = settle(&mut engine(&scene, folder(), ample()), &camera);
    let mut engine = engine(&scene, folder(), ample());
    for step in 0..12 {
        let turned = glam::Quat::from_rotation_y(0.15 * step as f32);
        engine
            .frame(&Camera {
                eye: turned * camera.eye * (1.0 + 0.2 * step as f32),
                ..camera
            })
            .unwrap();
    }
    let (_, after_a_detour) = settle(&mut engine, &camera);
    // What else is resident may be filtered into nothing here: there is room for all.
    assert_same(&after_a_detour, &direct, "after a detour");
}

#[test]
fn small_caches_keep_their_budget_and_show_every_material() {
    let scene = scene();
    let camera = scene.cameras[0];
    let (_, best) = settle(&mut engine(&scene, folder(), ample()), &camera);
    let rmse = |picture: &Picture| {
        let pairs = picture.pixels.iter().flatten().zip(best.pixels.iter().flatten());
        (pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / best.pixels.len() as f64).sqrt()
    };
    let mut errors = Vec::new();
    // Caches for two pages and two columns, and then for ever more.
    for (pages, columns) in [(2, 2), (6, 4), (24, 8)] {
        let options = Options {
            budgets: Budgets {
                page_cache_bytes: pages * 72 * 72 * 8,
                column_cache_bytes: columns * (25 * 25 * 3 + 25 * 3) * 8 * 2,
                ..Budgets::default()
            },
            // That is what they are counted in.
            page_format: Some(engine::gpu::PageFormat::Half),
            ..Options::default()
        };
        let mut engine = engine(&scene, folder(), options);
        let (stats, picture) = settle(&mut engine, &camera);
        assert!(u64::from(stats.pages_resident) <= pages, "{stats:?}");
        assert!(stats.columns_resident >= 2, "both materials have a column");
        let visible = engine.visibility().unwrap();
        for (pixel, [instance, _]) in picture.pixels.iter().zip(visible) {
            assert!(pixel.iter().all(|channel| channel.is_finite()));
            assert!(
                instance == 0 || pixel.iter().any(|channel| *channel != 0.0),
                "a hole"
            );
        }
        errors.push(rmse(&picture));
    }
    assert!(errors[0] > errors[2], "more memory, less error: {errors:?}");
}

#[test]
fn the_picture_is_that_of_the_factors_shaded_in_f64() {
    let scene = scene();
    let camera = scene.cameras[0];
    let mut engine = engine(&scene, folder(), ample());
    let (_, picture) = settle(&mut engine, &camera);
    let visibility = engine.visibility().unwrap();
    let open = |surface: &Surface| match surface {
        Surface::Btf { archive, .. } => {
            let file = std::fs::File::open(FIXTURE.archive(archive)).unwrap();
            Some(FactorReflectance::new(&tileset::Archive::open(file).unwrap()).unwrap())
        }
        Surface::Diffuse { .. } => None,
    };
    let factors: Vec<_> = scene
        .materials
        .iter()
        .map(|material| open(&material.surface))
        .collect();
    let factors: Vec<_> = factors
        .iter()
        .map(|factors| factors.as_ref().map(|factors| factors as &dyn Reflectance))
        .collect();
    let twin = shade(&scene, &camera, SIZE, &visibility, &factors);
    let (mut error, mut norm) = (0.0, 0.0);
    for (a, b) in picture.pixels.iter().flatten().zip(twin.pixels.iter().flatten()) {
        error += f64::from(a - b).powi(2);
        norm += f64::from(*b).powi(2);
    }
    let relative = (error / norm).sqrt();
    // Half floats of the caches round each factor to 2^-11; highlights add their own rounding.
    assert!(relative < 5e-3, "relative difference {relative}");
}
