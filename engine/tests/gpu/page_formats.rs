//! The page cache in bytes: what rounding costs against what is predicted, borders, odd values, and who chooses.

use super::*;
use crate::{
    material::white,
    pictures::{ambient_square, slanted},
};

pub(crate) fn with(format: PageFormat, size: (u32, u32)) -> Options {
    Options {
        page_format: Some(format),
        ..options(size)
    }
}

/// Root mean square difference over the pixels that show something.
pub(crate) fn rmse(engine: &Engine, a: &Picture, b: &Picture) -> f64 {
    let seen = engine.visibility().unwrap();
    let pairs = a.pixels.iter().zip(&b.pixels).zip(&seen);
    let squares: Vec<f64> = pairs
        .filter(|(_, ids)| ids[0] != 0)
        .flat_map(|((a, b), _)| (0..3).map(move |c| f64::from(a[c] - b[c]).powi(2)))
        .collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn bytes_err_as_much_as_is_predicted_and_take_half_the_memory() {
    // Only the first component shines, with reflectance 1 in all directions: the picture shows the error itself.
    let recipe = Recipe {
        groups: 1,
        abrdf: white,
        ..Default::default()
    };
    let archive = recipe.build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let scene = ambient_square(1.0);
    // Magnified: two mips blended would have less error.
    let camera = slanted(0.5);
    let draw = |format| {
        let mut engine = engine(&scene, archives, with(format, (192, 128)));
        let last = *settle(&mut engine, &camera).last().unwrap();
        (engine.picture().unwrap(), last, engine)
    };
    let (half, half_stats, half_engine) = draw(PageFormat::Half);
    let (byte, stats, engine) = draw(PageFormat::Byte);
    assert_eq!((half_stats.format_rms, half_stats.predicted_rms), (0.0, 0.0));
    assert_eq!(stats.predicted_rms, stats.format_rms);
    assert_eq!(stats.pages_resident, half_stats.pages_resident);
    // There is a slot for each page in both, and one of bytes takes half the memory, but for the scales.
    let slots = [&half_engine, &engine].map(|engine| engine.page_slots());
    assert_eq!(slots[0], slots[1]);
    let saved = half_stats.gpu_bytes - stats.gpu_bytes;
    let half_of_it = u64::from(slots[0]) * engine::gpu::page_cache::SLOT_BYTES / 2;
    assert!(
        saved <= half_of_it && saved + (1 << 16) > half_of_it,
        "{saved} of {half_of_it}"
    );
    // The other components are predicted, too: take their part away. Of what is left filtering takes some.
    let exact = reference(&engine, &scene, &camera, archives);
    let measured = rmse(&engine, &byte, &half);
    let against_reference = rmse(&engine, &byte, &exact);
    println!(
        "format error {measured:.2e}, against the reference {against_reference:.2e}, predicted {:.2e}",
        stats.format_rms
    );
    assert!(
        measured > 0.0 && measured < stats.format_rms,
        "{measured} {stats:?}"
    );
    assert!(measured * 2.0 > stats.format_rms, "{measured} {stats:?}");
    assert!(against_reference < measured * 1.5);
}

#[test]
fn a_virtual_picture_in_bytes_is_the_one_with_all_resident() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = (ambient_square(1.0), slanted(1.5));
    let mut large = engine(&scene, archives, with(PageFormat::Byte, (160, 90)));
    let wanted = settle(&mut large, &camera).last().unwrap().pages_wanted;
    // In another order, and in as little room as it takes.
    let exact = Options {
        budgets: Budgets {
            page_cache_bytes: PageFormat::Byte.slot_bytes() * u64::from(wanted),
            uploads_per_frame: 5,
            ..options((160, 90)).budgets
        },
        ..with(PageFormat::Byte, (160, 90))
    };
    let mut small = engine(&scene, archives, exact);
    let last = *settle(&mut small, &camera).last().unwrap();
    assert_eq!((last.pages_resident, last.swapped), (wanted, 0));
    let pictures = [&small, &large].map(|engine| engine.picture().unwrap());
    // Scales depend on who came first; where they were raised later texels were rounded twice.
    let error = relative_rmse(&pictures[0], &pictures[1]);
    println!("{error:.1e} of the picture's own root mean square");
    assert!(error < 1e-3, "{error}");
    // Flying around and coming back changes as little.
    for turn in [0.3, -0.4, 0.0] {
        let mut moved = camera;
        moved.eye.x += turn;
        settle(&mut small, &moved);
    }
    let error = relative_rmse(&small.picture().unwrap(), &pictures[1]);
    assert!(error < 1e-3, "{error}");
}

#[test]
fn a_material_of_odd_values_is_drawn_in_bytes() {
    // A ridge of 10^4 beside almost nothing, down to the mip of one texel.
    fn ridge(component: u32, s: f64, t: f64) -> f64 {
        let far = (s - 0.5).abs() + (t - 0.5).abs() + f64::from(component);
        if far < 0.01 { 1e4 } else { 1e-6 }
    }
    let archive = Recipe {
        groups: 1,
        texture: ridge,
        ..Default::default()
    }
    .build();
    for (repeats, distance) in [(1.0, 1.0), (3000.0, 2.0)] {
        let scene = ambient_square(repeats);
        let mut engine = engine(&scene, &[("weave", &archive)], with(PageFormat::Byte, (96, 64)));
        settle(&mut engine, &slanted(distance));
        let picture = engine.picture().unwrap();
        assert!(picture.pixels.iter().flatten().all(|value| value.is_finite()));
        let most = picture.pixels.iter().flatten().copied().fold(0.0, f32::max);
        // Against the ridge the mean of all is less than half a step, and lost in the page of the coarsest mips.
        assert_eq!(most > 100.0, repeats == 1.0, "{most}");
    }
}

#[test]
fn budgets_change_while_the_cache_holds_bytes() {
    let archive = Recipe::default().build();
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let (scene, camera) = (ambient_square(1.0), slanted(1.5));
    let mut engine = engine(&scene, archives, with(PageFormat::Byte, (160, 90)));
    settle(&mut engine, &camera);
    let whole = engine.picture().unwrap();
    let with_slots = |engine: &Engine, slots: u64| Budgets {
        page_cache_bytes: slots * PageFormat::Byte.slot_bytes(),
        ..engine.budgets()
    };
    for slots in [1, 12, 37, 400] {
        engine.set_budgets(with_slots(&engine, slots)).unwrap();
        let frames = settle(&mut engine, &camera);
        assert!(
            frames
                .iter()
                .all(|frame| u64::from(frame.pages_resident) <= slots)
        );
        assert_eq!(engine.page_format(), PageFormat::Byte);
        // What stays is moved with its scales: nothing is asked for twice in a view that stands still.
        assert_eq!(engine.problems().count(), 0);
    }
    let error = relative_rmse(&engine.picture().unwrap(), &whole);
    assert!(error < 1e-3, "{error}");
}
