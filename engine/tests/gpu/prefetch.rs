//! Pages come before the camera does.

use engine::stream::{Faults, FaultySource};

use engine::Error;

use super::*;
use crate::{
    material::{glossy, weave},
    scene::still_life,
};

fn archive() -> Vec<u8> {
    Recipe {
        width: 512,
        height: 512,
        groups: 1,
        texture: weave,
        abrdf: glossy,
        ..Default::default()
    }
    .build()
}

#[test]
fn a_named_view_is_there_when_it_is_shown() {
    let archive = archive();
    let (scene, far) = still_life();
    let near = Camera {
        eye: far.eye * 0.5 + far.target * 0.5,
        ..far
    };
    let wire_bytes = |prefetch: bool| {
        let mut engine = engine(&scene, &[("weave", &archive)], options((160, 90)));
        if prefetch {
            engine.prefetch(&near).unwrap();
        }
        settle(&mut engine, &far);
        let picture = engine.picture().unwrap();
        let shown = settle(&mut engine, &near);
        (shown.iter().map(|stats| stats.wire_bytes).sum::<u64>(), picture)
    };
    let ((without, picture), (with, same)) = (wire_bytes(false), wire_bytes(true));
    assert!(without > 0 && with * 4 < without, "{with} of {without} bytes");
    // The view that is shown has lost nothing by it.
    assert!(relative_rmse(&same, &picture) < 1e-4);
}

#[test]
fn a_view_that_is_cancelled_is_fetched_no_more_and_odd_ones_are_errors() {
    let archive = archive();
    let (scene, far) = still_life();
    let near = Camera {
        eye: far.eye * 0.5 + far.target * 0.5,
        ..far
    };
    let mut with = engine(&scene, &[("weave", &archive)], options((96, 54)));
    with.prefetch(&near).unwrap();
    with.cancel_prefetch();
    let odd = Camera {
        target: far.eye,
        ..far
    };
    assert!(matches!(with.prefetch(&odd), Err(Error::Scene(_))));
    let mut without = engine(&scene, &[("weave", &archive)], options((96, 54)));
    let (with, without) = (settle(&mut with, &far), settle(&mut without, &far));
    assert_eq!(
        with.last().unwrap().wire_bytes_total,
        without.last().unwrap().wire_bytes_total
    );
}

#[test]
fn a_moving_camera_is_looked_ahead_of_while_records_take_time() {
    let archive = archive();
    let (scene, start) = still_life();
    let slow = Faults {
        delay_polls: 12,
        ..Faults::default()
    };
    let at = |step: u32| Camera {
        eye: start.eye + glam::Vec3::X * 0.01 * step as f32,
        ..start
    };
    let fly = |prefetch_seconds| {
        let line = FaultySource::new(source(&[("weave", &archive)]), slow, 1);
        let options = Options {
            prefetch_seconds,
            ..options((96, 54))
        };
        let mut engine = Engine::new(Context::headless().unwrap(), &scene, Box::new(line), options).unwrap();
        engine.wait_for_materials(LIMIT).unwrap();
        for step in 0..50 {
            engine.frame(&at(step)).unwrap();
        }
        settle(&mut engine, &at(50));
        let looks = engine.counters().looks_ahead;
        // Nothing is ahead of a camera that stands.
        for _ in 0..10 {
            assert!(engine.frame(&at(50)).unwrap().settled);
        }
        assert_eq!(engine.counters().looks_ahead, looks);
        (looks, engine.picture().unwrap())
    };
    let ((none, direct), (some, ahead)) = (fly(0.0), fly(0.3));
    assert!(none == 0 && some > 0, "{none} {some}");
    let error = relative_rmse(&ahead, &direct);
    assert!(error < 1e-4, "{error}");
}
