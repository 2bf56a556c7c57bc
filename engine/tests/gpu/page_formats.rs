//! The page cache in bytes: what rounding costs against what is predicted, borders, odd values, and who chooses.

use engine::{
    Error,
    frame::{Budgets, Decode},
    gpu::{Caches, Renderer, materials::Btf, page_cache::SLOT_BYTES, page_format::rounding_mse},
    residency::Slot,
};
use half::f16;
use tileset::{ArchiveWriter, Page, PageId, SLOT_AREA, Tile};

use super::*;
use crate::{
    material::white,
    pictures::{ambient_square, slanted},
    scene::still_life,
};

fn with(format: PageFormat, size: (u32, u32)) -> Options {
    Options {
        page_format: Some(format),
        ..options(size)
    }
}

/// Root mean square difference over the pixels that show something.
fn rmse(engine: &Engine, a: &Picture, b: &Picture) -> f64 {
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
    // Slots of a layout are whole layers: within one per cent.
    let slots = [&half_engine, &engine].map(|engine| f64::from(engine.page_slots()));
    assert!((slots[1] / slots[0] / 2.0 - 1.0).abs() < 0.01, "{slots:?}");
    assert!(stats.gpu_bytes < half_stats.gpu_bytes * 101 / 100 + (1 << 16));
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

/// A renderer for a BTF of this size, whose pages the test makes.
fn bench(width: u32, height: u32, format: PageFormat) -> (Renderer, Btf) {
    let recipe = Recipe {
        width,
        height,
        groups: 1,
        ..Default::default()
    };
    let mut writer = ArchiveWriter::new(recipe.manifest()).unwrap();
    writer.add_column(0, vec![0; 4], 1.0).unwrap();
    for tile in recipe.manifest().pyramid().unwrap().tiles() {
        writer
            .add_page(PageId { group: 0, tile }, Vec::new(), 0.0)
            .unwrap();
    }
    let mut bytes = Vec::new();
    writer.write(&mut bytes).unwrap();
    let btf = Btf::new("bytes".into(), open(&bytes).index);
    let mut renderer = Renderer::new(Context::headless().unwrap(), &Scene::default(), (8, 8)).unwrap();
    renderer.add_btf(&btf).unwrap();
    let caches = Caches {
        page_format: format,
        page_bytes: 40 * format.slot_bytes(),
        column_bytes: 1 << 20,
        angular: Default::default(),
    };
    let layout = renderer.layout(caches, btf.column_quads()).unwrap();
    renderer.resize_caches(layout, &[], &[]).unwrap();
    renderer.show_btfs(&[]).unwrap();
    (renderer, btf)
}

fn page(mip: u8, x: u16, y: u16) -> PageId {
    PageId {
        group: 0,
        tile: Tile { mip, x, y },
    }
}

/// A slot by a formula of column and row.
fn texels(value: impl Fn(u32, u32) -> [f32; 4]) -> Page {
    let texel = |at| value(at % 72, at / 72).map(f16::from_f32);
    Page {
        texels: (0..SLOT_AREA as u32).map(texel).collect(),
    }
}

#[test]
fn borders_hold_what_neighbours_bring_however_much_stronger_they_are() {
    for (width, height) in [(192, 128), (346, 335), (66, 200)] {
        let (mut renderer, btf) = bench(width, height, PageFormat::Byte);
        let pyramid = *btf.pyramid();
        // Each tile has its own strength, from weak to strong and back; the third component is nothing anywhere.
        let strength = |tile: Tile| 10f32.powi(i32::from(tile.x * 5 + tile.y * 3) % 7 - 3);
        let tiles: Vec<Tile> = pyramid.tiles().filter(|tile| tile.mip == 0).collect();
        let value = |tile: Tile, x: u32, y: u32| {
            let wave = ((x * 7 + y * 13 + u32::from(tile.x)) as f32).sin();
            [strength(tile) * wave, -wave, 0.0, strength(tile)]
        };
        for (slot, &tile) in (0..).zip(&tiles) {
            let id = PageId { group: 0, tile };
            renderer.place_page(0, id, Slot(slot), &texels(|x, y| value(tile, x, y)));
            // A few in a frame: some scales are raised later.
            if slot % 3 == 0 {
                let strips = renderer.flush();
                renderer.stitch(&strips);
            }
        }
        let strips = renderer.flush();
        renderer.stitch(&strips);
        let found = |tile| {
            renderer
                .page(0, PageId { group: 0, tile })
                .unwrap()
                .unwrap()
                .texels
        };
        let pages: Vec<_> = tiles.iter().map(|&tile| found(tile)).collect();
        let mut checked = 0;
        for (&tile, texels) in tiles.iter().zip(&pages) {
            let largest = |c: usize| {
                let values = texels.iter().map(|texel| texel[c].to_f32().abs());
                values.fold(0.0, f32::max)
            };
            let scale: [f32; 4] = std::array::from_fn(largest);
            assert_eq!(scale[2], 0.0);
            for strip in engine::gpu::borders::into(&pyramid, tile) {
                for at in 0..strip.size.0 * strip.size.1 {
                    let (x, y) = (at % strip.size.0, at / strip.size.0);
                    let (from_x, from_y) = (strip.from.0 + x * strip.step.0, strip.from.1 + y * strip.step.1);
                    let wanted = value(strip.source, from_x, from_y);
                    let found = texels[((strip.to.1 + y) * 72 + strip.to.0 + x) as usize];
                    for c in 0..4 {
                        // Rounded in both slots, each up to twice; 1 / 1024 for half floats.
                        let step = (scale[c].max(strength(strip.source)) + 1.0) / 127.0;
                        let error = (found[c].to_f32() - wanted[c]).abs();
                        let limit = step * 1.5 + wanted[c].abs() / 1024.0;
                        assert!(
                            error <= limit,
                            "{tile:?} {strip:?} {c}: {found:?}, not {wanted:?}"
                        );
                        checked += 1;
                    }
                }
            }
        }
        assert!(checked > 4000);
    }
}

#[test]
fn odd_pages_come_back_within_half_a_step() {
    let (mut renderer, btf) = bench(256, 256, PageFormat::Byte);
    let one = |x: u32, y: u32, value: f32| if (x, y) == (30, 40) { value } else { 0.0 };
    let odd = [
        texels(|_, _| [0.0; 4]),
        texels(|x, y| [one(x, y, 65504.0), one(x, y, -65504.0), one(x, y, 6e-8), 1.0]),
        texels(|x, y| [6e-8, -6e-8, (x % 2) as f32 * 6e-8, y as f32 * 6e-8]),
        texels(|x, _| [65504.0, -65504.0, x as f32 * 900.0, 6e-5]),
    ];
    for (slot, page_texels) in (0..).zip(&odd) {
        // Far from each other.
        let id = page(0, 2 * (slot % 2), 2 * (slot / 2));
        renderer.place_page(0, id, Slot(u32::from(slot)), page_texels);
    }
    let strips = renderer.flush();
    assert_eq!(strips.len(), 0);
    renderer.stitch(&strips);
    for (slot, wanted) in (0..).zip(&odd) {
        let found = renderer
            .page(0, page(0, 2 * (slot % 2), 2 * (slot / 2)))
            .unwrap()
            .unwrap();
        for c in 0..4 {
            let values = wanted.texels.iter().map(|texel| texel[c].to_f32().abs());
            let scale = values.fold(0.0, f32::max);
            for (found, wanted) in found.texels.iter().zip(&wanted.texels) {
                let (found, wanted) = (found[c].to_f32(), wanted[c].to_f32());
                let error = (found - wanted).abs();
                assert!(found.is_finite() && error <= scale / 254.0 + wanted.abs() / 2048.0 + 6e-8);
            }
        }
    }
    // The error that is counted: nothing for nothing, and the sum over components else; the column must be there.
    let pyramid = *btf.pyramid();
    let index = |id: PageId| pyramid.tile_index(id.tile).unwrap();
    assert_eq!(renderer.rounding_mse(0, index(page(0, 2, 0))), 0.0);
    renderer.place_column(0, 0, Slot(0), Vec::new());
    assert_eq!(renderer.rounding_mse(0, index(page(0, 0, 0))), 0.0);
    let expected =
        2.0 * rounding_mse(65504.0) + rounding_mse(f16::from_f32(6e-8).to_f32()) + rounding_mse(1.0);
    let found = renderer.rounding_mse(0, index(page(0, 2, 0)));
    assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
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
