//! Budgets: from one page up, never exceeded, and with room for all no loss.

use engine::{Error, frame::MIN_HOST_BYTES, gpu::page_cache::SLOT_BYTES};

use super::*;
use crate::scene::still_life;

#[test]
fn one_slot_draws_without_holes() {
    let archive = Recipe::default().build();
    let (scene, camera) = still_life();
    let one = Options {
        budgets: Budgets {
            page_cache_bytes: SLOT_BYTES,
            column_cache_bytes: 1 << 18,
            ..options((160, 90)).budgets
        },
        ..options((160, 90))
    };
    let mut engine = engine(&scene, &[("weave", &archive)], one);
    let frames = settle(&mut engine, &camera);
    save(&engine, "one_slot.png");
    assert_eq!(frames.last().unwrap().pages_resident, 1);
    let picture = engine.picture().unwrap();
    for (pixel, ids) in picture.pixels.iter().zip(engine.visibility().unwrap()) {
        assert!(pixel.iter().all(|value| value.is_finite()));
        assert_eq!(
            ids == [0, 0],
            *pixel == scene.background.to_array(),
            "{pixel:?} {ids:?}"
        );
    }
}

#[test]
fn a_small_cache_with_room_for_all_shows_what_a_large_one_does() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = still_life();
    let mut large = engine(&scene, archives, options((160, 90)));
    let wanted = settle(&mut large, &camera).last().unwrap().pages_wanted;
    let exact = Options {
        budgets: Budgets {
            page_cache_bytes: SLOT_BYTES * u64::from(wanted),
            ..options((160, 90)).budgets
        },
        ..options((160, 90))
    };
    let mut small = engine(&scene, archives, exact);
    let last = *settle(&mut small, &camera).last().unwrap();
    assert_eq!(last.pages_resident, wanted);
    assert_eq!(last.swapped, 0);
    // Texture coordinates are rounded in atlases of different sizes.
    let error = relative_rmse(&small.picture().unwrap(), &large.picture().unwrap());
    assert!(error < 1e-4, "{error}");
}

#[test]
fn errors_fall_and_slots_are_never_exceeded_as_the_cache_grows() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = still_life();
    let mut last_error = f64::INFINITY;
    for slots in [1, 3, 8, 24, 70] {
        let budget = Options {
            budgets: Budgets {
                page_cache_bytes: SLOT_BYTES * slots,
                ..options((320, 180)).budgets
            },
            ..options((320, 180))
        };
        let mut engine = engine(&scene, archives, budget);
        let frames = settle(&mut engine, &camera);
        assert!(
            frames
                .iter()
                .all(|frame| u64::from(frame.pages_resident) <= slots)
        );
        let error = relative_rmse(
            &engine.picture().unwrap(),
            &reference(&engine, &scene, &camera, archives),
        );
        println!(
            "{slots} slots: relative RMSE {error:.4}, predicted {:.4}",
            frames.last().unwrap().predicted_rms
        );
        assert!(
            error < last_error * 1.05,
            "{slots} slots: {error} after {last_error}"
        );
        last_error = error;
    }
    assert!(last_error < 1e-3);
}

#[test]
fn the_least_host_memory_is_enough_and_is_kept_to() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, mut camera) = still_life();
    let least = Options {
        budgets: Budgets {
            host_bytes: MIN_HOST_BYTES,
            ..options((160, 90)).budgets
        },
        ..options((160, 90))
    };
    let mut poor = engine(&scene, archives, least);
    let mut rich = engine(&scene, archives, options((160, 90)));
    for _ in 0..3 {
        camera.eye = camera.eye * 0.6 + camera.target * 0.4;
        let frames = settle(&mut poor, &camera);
        assert!(
            frames.iter().all(|frame| frame.host_bytes <= MIN_HOST_BYTES),
            "{frames:?}"
        );
        settle(&mut rich, &camera);
        // What comes in another order lies in other slots, where coordinates are rounded otherwise.
        let error = relative_rmse(&poor.picture().unwrap(), &rich.picture().unwrap());
        assert!(error < 1e-5, "{error}");
    }
}

#[test]
fn impossible_budgets_are_errors_that_name_them() {
    let archive = Recipe {
        width: 64,
        height: 64,
        groups: 1,
        ..Default::default()
    }
    .build();
    let (scene, camera) = still_life();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let context = Context::headless().unwrap();
    let start = |options| -> engine::Result<()> {
        let mut engine = Engine::new(context.clone(), &scene, source(archives), options)?;
        engine.wait_for_materials(LIMIT)?;
        engine.frame(&camera).map(|_| ())
    };
    let good = options((32, 32));
    start(good.clone()).unwrap();
    for bad in [
        Options {
            budgets: Budgets {
                page_cache_bytes: SLOT_BYTES - 1,
                ..good.budgets
            },
            ..good.clone()
        },
        Options {
            budgets: Budgets {
                column_cache_bytes: 1000,
                ..good.budgets
            },
            ..good.clone()
        },
        Options {
            budgets: Budgets {
                host_bytes: 1000,
                ..good.budgets
            },
            ..good.clone()
        },
        Options {
            size: (0, 32),
            ..good.clone()
        },
        Options {
            size: (1 << 20, 32),
            ..good.clone()
        },
        Options {
            budgets: Budgets {
                uploads_per_frame: 0,
                ..good.budgets
            },
            ..good.clone()
        },
        Options {
            feedback_stride: 0,
            ..good.clone()
        },
    ] {
        let error = start(bad.clone()).unwrap_err();
        assert!(matches!(error, Error::Budget(_)), "{bad:?}: {error}");
    }
}
