//! Who chooses the format of the page cache, and what is seen meanwhile.

use engine::{Error, frame::Decode, gpu::page_cache::SLOT_BYTES};

use super::*;
use crate::{
    page_formats::{rmse, with},
    pictures::{ambient_square, slanted},
    scene::still_life,
};

#[test]
fn the_ledger_chooses_the_format_of_the_smaller_error() {
    // Detail everywhere: with half the pages missing, twice as many slots are worth more than exact ones.
    let rich = Recipe::default().build();
    // All of its energy in one mean; what its finer pages add is less than bytes would round away.
    fn bright(component: u32, s: f64, t: f64) -> f64 {
        let turn = std::f64::consts::TAU;
        let detail = 0.01 * (turn * 60.0 * s).sin() * (turn * 50.0 * t).cos();
        if component == 0 { 20.0 + detail } else { detail }
    }
    let smooth = Recipe {
        texture: bright,
        ..Default::default()
    }
    .build();
    let (scene, camera) = (ambient_square(1.0), slanted(1.5));
    let few = Options {
        budgets: Budgets {
            page_cache_bytes: 12 * SLOT_BYTES,
            ..options((192, 128)).budgets
        },
        page_format: None,
        ..options((192, 128))
    };
    for (archive, format) in [(&rich, PageFormat::Byte), (&smooth, PageFormat::Half)] {
        let archives: &[(&str, &[u8])] = &[("weave", archive)];
        let mut chosen = engine(&scene, archives, few.clone());
        let last = *settle(&mut chosen, &camera).last().unwrap();
        assert_eq!(chosen.page_format(), format);
        // It was right.
        let other = match format {
            PageFormat::Half => PageFormat::Byte,
            PageFormat::Byte => PageFormat::Half,
        };
        let mut other = engine(
            &scene,
            archives,
            Options {
                page_format: Some(other),
                ..few.clone()
            },
        );
        let worse = *settle(&mut other, &camera).last().unwrap();
        assert!(last.predicted_rms < worse.predicted_rms, "{last:?} {worse:?}");
        let of = |engine: &Engine| {
            let exact = reference(engine, &scene, &camera, archives);
            rmse(engine, &engine.picture().unwrap(), &exact)
        };
        assert!(of(&chosen) < of(&other), "{} {}", of(&chosen), of(&other));
        // With room for all there is nothing to gain; and back.
        let budgets = chosen.budgets();
        let roomy = Budgets {
            page_cache_bytes: 32 << 20,
            ..budgets
        };
        chosen.set_budgets(roomy).unwrap();
        assert_eq!(settle(&mut chosen, &camera).last().unwrap().predicted_rms, 0.0);
        assert_eq!(chosen.page_format(), PageFormat::Half);
        chosen.set_budgets(budgets).unwrap();
        let again = *settle(&mut chosen, &camera).last().unwrap();
        assert_eq!(chosen.page_format(), format);
        assert!((again.predicted_rms / last.predicted_rms - 1.0).abs() < 0.05);
    }
}

/// An engine that chooses by itself, with room for so many pages of half floats.
fn choosing(scene: &Scene, archives: &[(&str, &[u8])], slots: u32) -> Engine {
    let options = Options {
        budgets: Budgets {
            page_cache_bytes: u64::from(slots) * SLOT_BYTES,
            ..options((160, 90)).budgets
        },
        page_format: None,
        ..options((160, 90))
    };
    engine(scene, archives, options)
}

/// Pages that views want.
fn wanted<const N: usize>(scene: &Scene, archives: &[(&str, &[u8])], cameras: [&Camera; N]) -> [u32; N] {
    let mut roomy = engine(scene, archives, with(PageFormat::Half, (160, 90)));
    cameras.map(|camera| settle(&mut roomy, camera).last().unwrap().pages_wanted)
}

#[test]
fn the_view_decides_which_format_fits_and_coming_back_settles_in_the_same() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let scene = ambient_square(1.0);
    let (near, far) = (slanted(1.5), slanted(8.0));
    let [most, least] = wanted(&scene, archives, [&near, &far]);
    let slots = most * 3 / 4;
    assert!(least * 8 < slots * 7, "{least} of {slots} {most}");
    let mut engine = choosing(&scene, archives, slots);
    let mut settled = Vec::new();
    for (camera, format) in [
        (&near, PageFormat::Byte),
        (&far, PageFormat::Half),
        (&near, PageFormat::Byte),
        (&far, PageFormat::Half),
    ] {
        let frames = settle(&mut engine, camera);
        assert_eq!(engine.page_format(), format);
        let last = *frames.last().unwrap();
        assert_eq!((last.format_rms == 0.0), format == PageFormat::Half);
        assert!(last.drawn);
        settled.push(last.predicted_rms);
    }
    // All that is wanted far away fits, and half floats are exact.
    assert_eq!((settled[1], settled[3]), (0.0, 0.0));
    assert!((settled[2] / settled[0] - 1.0).abs() < 0.05, "{settled:?}");
    // Now and then a glance across the limit changes nothing.
    for turn in 0..80 {
        let camera = if turn % 40 < 5 { &near } else { &far };
        engine.frame(camera).unwrap();
        assert_eq!(engine.page_format(), PageFormat::Half);
    }
}

#[test]
fn a_view_about_the_limit_does_not_change_back() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = (ambient_square(1.0), slanted(1.5));
    let [wanted] = wanted(&scene, archives, [&camera]);
    let mut engine = choosing(&scene, archives, wanted * 5 / 4);
    let mut with_share = |share: u32| {
        let budgets = Budgets {
            page_cache_bytes: u64::from(wanted * share / 16) * SLOT_BYTES,
            ..engine.budgets()
        };
        engine.set_budgets(budgets).unwrap();
        settle(&mut engine, &camera);
        engine.page_format()
    };
    // Some pages may be missing before it is worth while to round all.
    let mut shares = (8..=16).rev();
    let limit = shares.find(|&share| with_share(share) == PageFormat::Byte);
    let limit = limit.unwrap();
    assert!(limit < 16);
    for share in [limit + 1, limit, limit + 1, limit] {
        assert_eq!(with_share(share), PageFormat::Byte, "{share}/16");
    }
    assert_eq!(with_share(20), PageFormat::Half);
}

#[test]
fn pictures_stay_as_good_while_the_format_changes() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = (ambient_square(1.0), slanted(1.5));
    let [wanted] = wanted(&scene, archives, [&camera]);
    let slots = wanted * 3 / 4;
    let mut engine = choosing(&scene, archives, slots);
    let mut exact = self::engine(&scene, archives, with(PageFormat::Half, (160, 90)));
    settle(&mut exact, &camera);
    let exact = exact.picture().unwrap();
    // Bytes, where half floats lack a quarter; a slider up, with room for all; and down again.
    let slider = [
        (slots, PageFormat::Byte),
        (2 * wanted, PageFormat::Half),
        (slots, PageFormat::Byte),
    ];
    for (slots, format) in slider {
        let budgets = Budgets {
            page_cache_bytes: u64::from(slots) * SLOT_BYTES,
            // Slowly.
            uploads_per_frame: 3,
            ..engine.budgets()
        };
        let before = engine.page_format();
        engine.set_budgets(budgets).unwrap();
        let (mut held, mut refilled) = (f64::INFINITY, 0);
        for number in 0.. {
            let stats = engine.frame(&camera).unwrap();
            let error = rmse(&engine, &engine.picture().unwrap(), &exact);
            if engine.page_format() == before {
                held = error;
            } else {
                assert!(error <= held * 1.25, "{format:?} {number}: {error} {held}");
                refilled += stats.added;
            }
            assert!(number < 500, "never settles");
            assert!(stats.pages_resident <= engine.page_slots());
            if stats.settled {
                break;
            }
        }
        assert_eq!(engine.page_format(), format);
        assert!(refilled > 10, "{refilled}");
        assert_eq!(engine.problems().count(), 0);
    }
    // What came again came from the host.
    assert!(engine.counters().records_from_host > u64::from(wanted));
}

#[test]
fn bytes_and_decoding_on_the_gpu_exclude_each_other() {
    let (scene, _) = still_life();
    let both = Options {
        decode_on: Decode::Gpu,
        ..with(PageFormat::Byte, (32, 32))
    };
    let archive = Recipe::default().build();
    let source = || source(&[("weave", &archive)]);
    let start = |options| Engine::new(Context::headless().unwrap(), &scene, source(), options);
    assert!(matches!(start(both.clone()), Err(Error::Budget(_))));
    // Left to the ledgers, the wish to decode on the GPU counts.
    let left = Options {
        page_format: None,
        budgets: Budgets {
            page_cache_bytes: 12 * SLOT_BYTES,
            ..both.budgets
        },
        ..both
    };
    let mut engine = start(left).unwrap();
    engine.wait_for_materials(LIMIT).unwrap();
    assert_eq!(engine.page_format(), PageFormat::Half);
}
