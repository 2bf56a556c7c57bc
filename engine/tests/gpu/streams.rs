//! The frame loop: what it does when nothing changes, and when the source misbehaves.

use engine::{
    Error,
    stream::{Answer, Faults, FaultySource, Request, Ticket, TileSource},
};
use scenes::Scene;

use super::*;
use crate::{
    material::weave,
    scene::{btf, still_life},
};

fn archive() -> Vec<u8> {
    Recipe {
        groups: 2,
        texture: weave,
        ..Default::default()
    }
    .build()
}

#[test]
fn a_settled_view_does_nothing() {
    let archive = archive();
    let (scene, mut camera) = still_life();
    let mut engine = engine(&scene, &[("weave", &archive)], options((96, 54)));
    settle(&mut engine, &camera);
    let (before, picture) = (engine.counters(), engine.picture().unwrap());
    for _ in 0..20 {
        let stats = engine.frame(&camera).unwrap();
        assert!(stats.settled && !stats.drawn);
        assert_eq!(
            (stats.added, stats.swapped, stats.wire_bytes, stats.in_flight),
            (0, 0, 0, 0)
        );
        assert_eq!(stats.texels_stitched, 0);
    }
    assert_eq!(engine.counters().draws_skipped, before.draws_skipped + 20);
    assert_eq!(engine.counters().feedback_skipped, before.feedback_skipped + 20);
    assert!(engine.picture().unwrap() == picture);
    // Exposure changes the screen, not the picture.
    let screen = engine.tonemapped().unwrap();
    engine.set_exposure_stops(1.0);
    assert!(engine.frame(&camera).unwrap().drawn);
    assert!(engine.picture().unwrap() == picture);
    assert_ne!(engine.tonemapped().unwrap(), screen);
    camera.eye.x += 0.1;
    assert!(engine.frame(&camera).unwrap().drawn);
    assert!(engine.picture().unwrap() != picture);
}

#[test]
fn the_same_path_gives_the_same_operations_and_pictures() {
    let archive = archive();
    let (scene, start) = still_life();
    let small = Options {
        budgets: Budgets {
            page_cache_bytes: 20 * 41472,
            uploads_per_frame: 5,
            ..options((96, 54)).budgets
        },
        ..options((96, 54))
    };
    let run = || {
        let mut engine = engine(&scene, &[("weave", &archive)], small.clone());
        let mut log = Vec::new();
        for step in 0..12 {
            let mut camera = start;
            camera.eye.x += 0.3 * step as f32;
            let stats = engine.frame(&camera).unwrap();
            log.push((stats.added, stats.swapped, stats.wire_bytes, stats.predicted_rms));
        }
        (log, engine.picture().unwrap())
    };
    let (first, second) = (run(), run());
    assert_eq!(first.0, second.0);
    assert!(first.1 == second.1);
}

#[test]
fn without_waiting_the_same_picture_comes_in_the_end() {
    let archive = archive();
    let (scene, camera) = still_life();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let mut waiting = engine(&scene, archives, options((96, 54)));
    settle(&mut waiting, &camera);
    // From the start: nothing waits for the indices either.
    let free = Options {
        wait: false,
        ..options((96, 54))
    };
    let mut engine = Engine::new(Context::headless().unwrap(), &scene, source(archives), free).unwrap();
    let first = engine.frame(&camera).unwrap();
    assert!(first.drawn && !first.settled);
    let begin = std::time::Instant::now();
    while !engine.frame(&camera).unwrap().settled {
        assert!(begin.elapsed() < LIMIT, "{:?}", engine.summary());
        std::thread::yield_now();
    }
    // What is decoded beside the frames is placed in the order in which it is done: in other slots, at which texture
    // coordinates are rounded otherwise.
    let error = relative_rmse(&engine.picture().unwrap(), &waiting.picture().unwrap());
    assert!(error < 1e-4, "{error}");
}

#[test]
fn faults_of_the_source_do_not_change_the_settled_picture() {
    let archive = archive();
    let (scene, camera) = still_life();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let mut good = engine(&scene, archives, options((240, 135)));
    settle(&mut good, &camera);
    let faults = Faults {
        fail: 0.15,
        repeat: 0.3,
        damage: 0.3,
        reorder: 0.5,
        delay_polls: 20,
        lose: 0.0,
    };
    for seed in [1, 2] {
        let line = Switch {
            line: FaultySource::new(source(archives), Faults::default(), seed),
            faults,
        };
        let mut engine = Engine::new(
            Context::headless().unwrap(),
            &scene,
            Box::new(line),
            options((240, 135)),
        )
        .unwrap();
        engine.wait_for_materials(LIMIT).unwrap();
        let frames = engine.settle(&camera, LIMIT).unwrap();
        let problems: Vec<_> = engine.problems().map(str::to_owned).collect();
        assert!(
            frames.last().unwrap().settled,
            "{:?} {problems:?}",
            engine.summary()
        );
        let counters = engine.counters();
        assert!(
            counters.requests_failed > 0 && counters.records_damaged > 0,
            "{counters:?}"
        );
        assert!(
            problems.iter().any(|problem| problem.contains("weave")),
            "{problems:?}"
        );
        // Pages may lie in other slots, at which texture coordinates are rounded otherwise.
        let error = relative_rmse(&engine.picture().unwrap(), &good.picture().unwrap());
        assert!(error < 1e-4, "seed {seed}: {error}");
    }
}

/// Turns faults on after the first answer: an index is asked for a few times only.
struct Switch<S> {
    line: FaultySource<S>,
    faults: Faults,
}

impl<S: TileSource> TileSource for Switch<S> {
    fn capacity(&self) -> usize {
        self.line.capacity()
    }
    fn in_flight(&self) -> usize {
        self.line.in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.line.submit(request)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.line.cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        let answer = self.line.poll()?;
        self.line.set_faults(self.faults);
        Some(answer)
    }
    fn wait(&mut self, limit: Duration) {
        self.line.wait(limit);
    }
}

#[test]
fn a_missing_archive_is_told_and_the_rest_is_drawn() {
    let archive = archive();
    let (mut scene, camera) = still_life();
    scene.materials[1] = btf("lost", 1.0);
    let mut engine = Engine::new(
        Context::headless().unwrap(),
        &scene,
        source(&[("weave", &archive)]),
        options((96, 54)),
    )
    .unwrap();
    let error = engine.wait_for_materials(LIMIT).unwrap_err();
    assert!(
        matches!(error, Error::Source { .. }) && error.to_string().contains("lost"),
        "{error}"
    );
    let frames = engine.settle(&camera, LIMIT).unwrap();
    assert!(frames.last().unwrap().settled && frames.last().unwrap().pages_resident > 1);
    assert!(engine.problems().any(|problem| problem.contains("lost")));
}

#[test]
fn sizes_change_between_frames() {
    let archive = archive();
    let (scene, camera) = still_life();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let mut resized = engine(&scene, archives, options((33, 77)));
    settle(&mut resized, &camera);
    resized.resize((96, 54)).unwrap();
    settle(&mut resized, &camera);
    let mut fresh = engine(&scene, archives, options((96, 54)));
    settle(&mut fresh, &camera);
    assert!(resized.picture().unwrap() == fresh.picture().unwrap());
    assert!(matches!(resized.resize((0, 5)), Err(Error::Budget(_))));
}

#[test]
fn scenes_that_do_not_hold_together_are_errors() {
    let (scene, camera) = still_life();
    let start = |scene: &Scene| {
        Engine::new(Context::headless().unwrap(), scene, source(&[]), options((8, 8)))
            .map(|_| ())
            .unwrap_err()
    };
    let spoil = |spoil: fn(&mut Scene)| {
        let mut scene = scene.clone();
        spoil(&mut scene);
        start(&scene)
    };
    for error in [
        spoil(|scene| scene.meshes[1].indices[3] = 1 << 20),
        spoil(|scene| scene.meshes[1].indices.truncate(5)),
        spoil(|scene| scene.meshes[2].normals.clear()),
        spoil(|scene| scene.meshes[0].material = 9),
        spoil(|scene| scene.instances[0].mesh = 9),
        spoil(|scene| scene.instances[0].world_from_mesh.translation.x = f32::NAN),
    ] {
        assert!(matches!(error, Error::Scene(_)), "{error}");
    }
    let empty = Scene::default();
    let mut engine = engine(&empty, &[], options((8, 8)));
    settle(&mut engine, &camera);
    assert!(
        engine
            .picture()
            .unwrap()
            .pixels
            .iter()
            .all(|pixel| *pixel == [0.0; 3])
    );
    let odd = Camera {
        up: camera.target - camera.eye,
        ..camera
    };
    assert!(matches!(engine.frame(&odd), Err(Error::Scene(_))));
}

#[test]
fn without_an_adapter_the_error_says_what_to_install() {
    let nothing = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let Err(error) = pollster::block_on(Context::new(&wgpu::Instance::new(nothing), None)) else {
        panic!("an instance without backends has an adapter")
    };
    assert!(
        matches!(error, Error::Adapter(_)) && error.to_string().contains("mesa-vulkan-drivers"),
        "{error}"
    );
}
