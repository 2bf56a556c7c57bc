//! Budgets and filters that change while pictures are drawn.

use engine::{
    Error,
    frame::{Budgets, Filter},
    gpu::page_cache::SLOT_BYTES,
};

use super::*;
use crate::scene::still_life;

fn archive() -> Vec<u8> {
    Recipe {
        groups: 2,
        ..Default::default()
    }
    .build()
}

#[test]
fn what_stays_is_copied_and_shows_the_same() {
    let archive = archive();
    let (scene, camera) = still_life();
    let mut engine = engine(&scene, &[("weave", &archive)], options((160, 90)));
    let wanted = settle(&mut engine, &camera).last().unwrap().pages_resident;
    let (picture, before) = (engine.picture().unwrap(), engine.budgets());
    let counters = engine.counters();
    // Larger, just large enough, and of an odd shape: nothing is asked for, nothing comes, the picture stays.
    for (slots, columns) in [
        (2000, 200),
        (u64::from(wanted), 40),
        (u64::from(wanted) + 7, 40),
        (97, 300),
    ] {
        let budgets = Budgets {
            page_cache_bytes: slots * SLOT_BYTES,
            column_cache_bytes: columns << 16,
            ..before
        };
        engine.set_budgets(budgets).unwrap();
        assert_eq!(engine.budgets(), budgets);
        let stats = engine.frame(&camera).unwrap();
        assert_eq!((stats.added, stats.swapped, stats.wire_bytes), (0, 0, 0));
        assert_eq!(stats.pages_resident, wanted);
        engine.set_exposure_stops(slots as f32 * 1e-6);
        assert!(engine.frame(&camera).unwrap().drawn);
        // Texture coordinates are rounded in atlases of different sizes.
        let error = relative_rmse(&engine.picture().unwrap(), &picture);
        assert!(error < 1e-4, "{slots} slots: {error}");
        settle(&mut engine, &camera);
    }
    assert_eq!(engine.counters().records_from_host, counters.records_from_host);
}

#[test]
fn down_to_one_page_and_up_again_without_holes() {
    let archive = archive();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = still_life();
    let budgets = |slots: u64| Budgets {
        page_cache_bytes: slots * SLOT_BYTES,
        uploads_per_frame: 5,
        ..options((96, 54)).budgets
    };
    let within = |slots| Options {
        budgets: budgets(slots),
        ..options((96, 54))
    };
    let mut changing = engine(&scene, archives, within(200));
    settle(&mut changing, &camera);
    for slots in [12, 1, 30, 200] {
        changing.set_budgets(budgets(slots)).unwrap();
        for _ in 0..200 {
            let stats = changing.frame(&camera).unwrap();
            assert!(u64::from(stats.pages_resident) <= slots, "{stats:?}");
            let picture = changing.picture().unwrap();
            for (pixel, ids) in picture.pixels.iter().zip(changing.visibility().unwrap()) {
                assert!(pixel.iter().all(|value| value.is_finite()));
                assert_eq!(ids == [0, 0], *pixel == scene.background.to_array());
            }
            if stats.settled {
                break;
            }
        }
        let settled = settle(&mut changing, &camera);
        let mut fresh = engine(&scene, archives, within(slots));
        let expected = settle(&mut fresh, &camera);
        let (settled, expected) = (settled.last().unwrap(), expected.last().unwrap());
        assert_eq!(settled.pages_resident, expected.pages_resident, "{slots} slots");
        assert_eq!(settled.columns_resident, expected.columns_resident);
        let error = relative_rmse(&changing.picture().unwrap(), &fresh.picture().unwrap());
        assert!(error < 1e-4, "{slots} slots: {error}");
    }
}

#[test]
fn columns_give_way_and_come_back() {
    let archive = archive();
    let (scene, camera) = still_life();
    let mut engine = engine(&scene, &[("weave", &archive)], options((96, 54)));
    settle(&mut engine, &camera);
    let (picture, before) = (engine.picture().unwrap(), engine.budgets());
    // A column has 49 · 50 · 3 quads: 29 rows of 2 KiB.
    let one = Budgets {
        column_cache_bytes: 29 << 11,
        ..before
    };
    engine.set_budgets(one).unwrap();
    assert_eq!(settle(&mut engine, &camera).last().unwrap().columns_resident, 1);
    assert!(relative_rmse(&engine.picture().unwrap(), &picture) > 1e-3);
    let none = Budgets {
        column_cache_bytes: (29 << 11) - 1,
        ..before
    };
    assert!(matches!(engine.set_budgets(none), Err(Error::Budget(_))));
    assert_eq!(engine.budgets(), one);
    engine.set_budgets(before).unwrap();
    assert_eq!(settle(&mut engine, &camera).last().unwrap().columns_resident, 2);
    let error = relative_rmse(&engine.picture().unwrap(), &picture);
    assert!(error < 1e-4, "{error}");
}

#[test]
fn budgets_that_cannot_work_change_nothing() {
    let archive = archive();
    let (scene, camera) = still_life();
    let mut engine = engine(&scene, &[("weave", &archive)], options((32, 18)));
    settle(&mut engine, &camera);
    let good = engine.budgets();
    for bad in [
        Budgets {
            page_cache_bytes: SLOT_BYTES - 1,
            ..good
        },
        Budgets {
            host_bytes: 1000,
            ..good
        },
        Budgets {
            uploads_per_frame: 0,
            ..good
        },
        Budgets {
            decodes_per_frame: 0,
            ..good
        },
        Budgets {
            requests_in_flight: 0,
            ..good
        },
        Budgets {
            bytes_in_flight: 0,
            ..good
        },
    ] {
        assert!(
            matches!(engine.set_budgets(bad), Err(Error::Budget(_))),
            "{bad:?}"
        );
        assert_eq!(engine.budgets(), good);
        assert!(engine.frame(&camera).unwrap().settled);
    }
}

#[test]
fn filters_change_as_if_they_had_been_chosen_before() {
    let archive = archive();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = still_life();
    let with = |filter| Options {
        filter,
        ..options((160, 90))
    };
    let mut changing = engine(&scene, archives, with(Filter::Trilinear));
    settle(&mut changing, &camera);
    let trilinear = changing.picture().unwrap();
    changing.set_filter(Filter::Bilinear).unwrap();
    assert!(settle(&mut changing, &camera).iter().any(|frame| frame.drawn));
    let bilinear = changing.picture().unwrap();
    let mut chosen = engine(&scene, archives, with(Filter::Bilinear));
    settle(&mut chosen, &camera);
    let error = relative_rmse(&bilinear, &chosen.picture().unwrap());
    assert!(error < 1e-4, "{error}");
    let difference = relative_rmse(&bilinear, &trilinear);
    assert!(difference > 1e-3, "another picture, but by {difference}");
    changing.set_filter(Filter::Trilinear).unwrap();
    settle(&mut changing, &camera);
    let error = relative_rmse(&changing.picture().unwrap(), &trilinear);
    assert!(error < 1e-4, "{error}");
}
