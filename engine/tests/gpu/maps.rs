//! Snapshots of caches, page trees and materials.

use std::collections::HashSet;

use engine::frame::MaterialState;
use tileset::PageId;

use super::*;
use crate::scene::{btf, still_life};

#[test]
fn cache_map_and_page_tree_hold_what_is_resident() {
    let recipe = Recipe {
        width: 512,
        height: 256,
        ..Default::default()
    };
    let archive = recipe.build();
    let (scene, camera) = still_life();
    let mut engine = engine(&scene, &[("weave", &archive)], options((96, 64)));
    let frames = settle(&mut engine, &camera);
    let last = frames.last().unwrap();
    let map = engine.cache_map();
    assert_eq!(map.pages.len() as u32, engine.page_slots());
    assert_eq!(map.columns.len() as u32, engine.column_slots().0);
    let pages: Vec<_> = map.pages.iter().flatten().collect();
    let columns: Vec<_> = map.columns.iter().flatten().collect();
    assert_eq!(pages.len() as u32, last.pages_resident);
    assert_eq!(columns.len() as u32, last.columns_resident);
    let ids: HashSet<PageId> = pages.iter().map(|page| page.page).collect();
    assert_eq!(ids.len(), pages.len(), "a page is in one slot");
    // Pinned are root and column of the first group.
    let pinned: Vec<_> = pages
        .iter()
        .filter(|page| page.pinned)
        .map(|page| page.page)
        .collect();
    let root = open(&archive).index.pyramid.root();
    assert_eq!(pinned, [PageId { group: 0, tile: root }]);
    assert!(columns.iter().all(|column| column.pinned == (column.group == 0)));

    // Ages count frames.
    let oldest = pages.iter().map(|page| page.age).max().unwrap();
    assert!(oldest < frames.len() as u64 && pages.iter().any(|page| page.age < oldest));
    for _ in 0..3 {
        engine.frame(&camera).unwrap();
    }
    let later = engine.cache_map();
    let older = |(now, then): (&Option<_>, &Option<_>)| match (now, then) {
        (Some(now), Some(then)) => {
            let (now, then): (&engine::frame::CachedPage, &engine::frame::CachedPage) = (now, then);
            now.page == then.page && now.age == then.age + 3
        }
        (now, then) => now.is_none() && then.is_none(),
    };
    assert!(later.pages.iter().zip(&map.pages).all(older));

    let tree = engine.page_tree(0).unwrap();
    let pyramid = open(&archive).index.pyramid;
    assert_eq!(usize::from(tree.groups), tree.columns.len());
    assert_eq!(
        tree.columns.iter().filter(|column| **column).count(),
        columns.len()
    );
    assert_eq!(tree.mips.len(), usize::from(pyramid.tail_mip()) + 1);
    for tile in pyramid.tiles() {
        let mip = &tree.mips[usize::from(tile.mip)];
        assert_eq!((mip.columns, mip.rows), pyramid.grid(tile.mip));
        let resident = mip.resident[usize::from(tile.y) * mip.columns as usize + usize::from(tile.x)];
        let expected = (0..tree.groups)
            .filter(|&group| ids.contains(&PageId { group, tile }))
            .count();
        assert_eq!(usize::from(resident), expected, "{tile:?}");
    }
    assert!(engine.page_tree(1).is_none());

    // Fewer slots: what stays keeps its age.
    let slots = pages.len() as u64 / 2;
    let budgets = Budgets {
        page_cache_bytes: slots * PageFormat::Half.slot_bytes(),
        ..engine.budgets()
    };
    engine.set_budgets(budgets).unwrap();
    let smaller = engine.cache_map();
    assert!(smaller.pages.len() as u64 <= slots && !smaller.pages.is_empty());
    for page in smaller.pages.iter().flatten() {
        let before = later
            .pages
            .iter()
            .flatten()
            .find(|before| before.page == page.page);
        assert_eq!(before.map(|before| before.age), Some(page.age));
    }
}

#[test]
fn materials_tell_how_far_they_are() {
    let archive = Recipe::default().build();
    let (mut scene, camera) = still_life();
    scene.materials[1] = btf("nowhere", 1.0);
    let archives: &[(&str, &[u8])] = &[("weave", &archive)];
    let options = Options {
        budgets: Budgets {
            uploads_per_frame: 1,
            ..options((64, 48)).budgets
        },
        ..options((64, 48))
    };
    let context = Context::headless().unwrap();
    let mut engine = Engine::new(context, &scene, source(archives), options).unwrap();
    let states = |engine: &Engine| -> Vec<_> {
        let materials = engine.materials();
        assert_eq!(
            materials
                .iter()
                .map(|material| &*material.name)
                .collect::<Vec<_>>(),
            ["weave", "nowhere"]
        );
        materials.into_iter().map(|material| material.state).collect()
    };
    assert_eq!(states(&engine), [MaterialState::Unknown, MaterialState::Unknown]);
    assert_eq!(engine.page_tree(0), None);
    let (mut seen, mut progress) = (Vec::new(), 0.0);
    let mut stats = engine.frame(&camera).unwrap();
    for _ in 0..500 {
        let [weave, nowhere] = &engine.materials()[..] else {
            panic!()
        };
        if seen.last() != Some(&weave.state) {
            seen.push(weave.state.clone());
        }
        let now = weave.progress.unwrap_or(0.0);
        assert!(now >= progress - 1e-9, "{now} after {progress}");
        progress = now;
        assert_eq!(
            (weave.pages_resident, weave.columns_resident),
            (stats.pages_resident, stats.columns_resident)
        );
        assert_eq!(weave.wire_bytes + nowhere.wire_bytes, stats.wire_bytes_total);
        if stats.settled {
            break;
        }
        stats = engine.frame(&camera).unwrap();
    }
    assert!(stats.settled);
    // How early the index is known is chance.
    seen.retain(|state| *state != MaterialState::Unknown);
    assert_eq!(
        seen,
        [
            MaterialState::Loading,
            MaterialState::Shown,
            MaterialState::Settled
        ]
    );
    assert_eq!(progress, 1.0);
    let MaterialState::Failed(why) = &states(&engine)[1] else {
        panic!("{:?}", states(&engine))
    };
    assert!(why.contains("nowhere"), "{why}");
    assert_eq!(engine.page_tree(1), None);
}
