//! Single rules of residency, each in the smallest scene that shows it.

use engine::residency::{
    Item, LONGEST_BACK_OFF, Limits, MaterialId, MaterialInfo, PATIENCE, Placement, Plan, Residency,
    SLOTS_PER_PIN, Slot, Vote,
};
use tileset::{PageId, Pyramid};

/// 128×128 texels: root (tile 0), one page of 64×64 (tile 1), four pages of the finest mip (tiles 2 to 5).
fn pyramid() -> Pyramid {
    let pyramid = Pyramid::new(128, 128, true).unwrap();
    assert_eq!(pyramid.tile_count(), 6);
    pyramid
}

fn material(weights: &[[f32; 6]]) -> MaterialInfo {
    MaterialInfo {
        pyramid: pyramid(),
        groups: weights.len() as u16,
        weights: weights.concat(),
        visibility: Vec::new(),
        page_bytes: Vec::new(),
        column_bytes: Vec::new(),
    }
}

fn residency(page_slots: u32, column_slots: u32, materials: &[&[[f32; 6]]]) -> Residency {
    let mut residency = Residency::new(Limits {
        page_slots,
        column_slots,
        in_flight: 100,
        bytes_in_flight: u64::MAX,
    });
    for weights in materials {
        residency.add_material(material(weights));
    }
    residency
}

fn page(material: u16, group: u16, tile: u32) -> Item {
    Item::Page(
        MaterialId(material),
        PageId {
            group,
            tile: pyramid().tile_at(tile).unwrap(),
        },
    )
}

fn column(material: u16, group: u16) -> Item {
    Item::Column(MaterialId(material), group)
}

fn vote(material: u16, tile: u32, pixels: u32) -> Vote {
    Vote {
        material: MaterialId(material),
        tile,
        pixels,
    }
}

fn settle(residency: &mut Residency, votes: &[Vote]) {
    for _ in 0..100 {
        let plan = residency.update(votes, &[]);
        for item in &plan.request {
            residency.arrived(*item);
        }
        if plan == Plan::default() {
            return;
        }
    }
    panic!("does not settle");
}

fn is_resident(residency: &Residency, item: Item) -> bool {
    residency.slot(item).is_some()
}

#[test]
fn column_and_root_come_first_and_pages_under_them() {
    let mut residency = residency(10, 10, &[&[[8.0, 4.0, 2.0, 1.0, 0.0, 0.0]]]);
    let votes = [vote(0, 2, 10), vote(0, 3, 10)];
    let plan = residency.update(&votes, &[]);
    assert_eq!(plan.request, [column(0, 0), page(0, 0, 0)]);
    assert_eq!(residency.update(&votes, &[]), Plan::default(), "asked once");
    assert_eq!(
        residency.arrived(page(0, 0, 0)),
        Placement::Place {
            slot: Slot(0),
            evicted: None
        }
    );
    assert_eq!(
        residency.update(&votes, &[]).request,
        [],
        "the column is not there yet"
    );
    residency.arrived(column(0, 0));
    assert_eq!(residency.update(&votes, &[]).request, [page(0, 0, 1)]);
    residency.arrived(page(0, 0, 1));
    assert_eq!(
        residency.update(&votes, &[]).request,
        [page(0, 0, 2), page(0, 0, 3)]
    );
    assert!(
        (residency.summary().predicted_mse - 1.5).abs() < 1e-12,
        "half the pixels miss 2, half miss 1"
    );
    residency.arrived(page(0, 0, 2));
    assert!((residency.summary().predicted_mse - 0.5).abs() < 1e-12);
    assert!(!residency.summary().settled);
    residency.arrived(page(0, 0, 3));
    assert_eq!(residency.summary().predicted_mse, 0.0);
    assert_eq!(residency.update(&votes, &[]), Plan::default());
    assert!(residency.summary().settled);
}

#[test]
fn requests_follow_w_times_v() {
    let one = [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.0, 0.0, 0.0]];
    let mut residency = residency(32, 32, &[&one, &one]);
    let plan = residency.update(&[vote(0, 0, 1), vote(1, 0, 3)], &[]);
    // Pins first, then w·v: 15 of material 1, 5 of material 0; columns as their roots.
    let pinned = [column(1, 0), page(1, 0, 0), column(0, 0), page(0, 0, 0)];
    let others = [column(1, 1), page(1, 1, 0), column(0, 1), page(0, 1, 0)];
    assert_eq!(plan.request, [pinned, others].concat());
}

#[test]
fn pages_without_weight_are_asked_for_only_on_the_way_to_others() {
    let mut residency = residency(10, 10, &[&[[8.0, 0.0, 2.0, 0.0, 0.0, 0.0], [0.0; 6]]]);
    settle(&mut residency, &[vote(0, 2, 10), vote(0, 3, 10)]);
    let resident: Vec<Item> = residency.resident().into_iter().map(|(item, _)| item).collect();
    assert_eq!(
        resident,
        [page(0, 0, 0), page(0, 0, 1), page(0, 0, 2), column(0, 0)]
    );
    assert_eq!(residency.summary().predicted_mse, 0.0);
}

#[test]
fn structure_beneath_pages_of_little_weight_is_found() {
    // Group 1 has more in every page until the finest mip of group 0 shows.
    let weights = [[9.0, 0.01, 5.0, 5.0, 5.0, 5.0], [0.9, 0.9, 0.5, 0.5, 0.5, 0.5]];
    let mut residency = residency(6, 10, &[&weights]);
    settle(
        &mut residency,
        &[vote(0, 2, 10), vote(0, 3, 10), vote(0, 4, 10), vote(0, 5, 10)],
    );
    assert!((0..6).all(|tile| is_resident(&residency, page(0, 0, tile))));
}

#[test]
fn what_is_seen_no_more_stays_until_its_place_is_needed_oldest_first() {
    let one = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]];
    let mut residency = residency(4, 4, &[&one, &one, &one]);
    settle(&mut residency, &[vote(0, 1, 1)]);
    settle(&mut residency, &[vote(1, 1, 1)]);
    assert_eq!(residency.summary().pages_resident, 4);
    // Material 2 needs two places: those of material 0, the finer page first.
    let votes = [vote(2, 1, 1)];
    for item in residency.update(&votes, &[]).request {
        if item == page(2, 0, 0) {
            let evicted = Some(page(0, 0, 1));
            assert!(
                matches!(residency.arrived(item), Placement::Place { evicted: found, .. } if found == evicted)
            );
        } else {
            residency.arrived(item);
        }
    }
    settle(&mut residency, &votes);
    assert!(!is_resident(&residency, page(0, 0, 0)));
    assert!(is_resident(&residency, page(1, 0, 0)) && is_resident(&residency, page(1, 0, 1)));
    // And back: nothing has to be fetched.
    assert_eq!(residency.update(&[vote(1, 1, 1)], &[]), Plan::default());
}

#[test]
fn what_the_camera_has_left_behind_is_cancelled() {
    let one = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]];
    let mut residency = residency(10, 10, &[&one, &one]);
    let first = residency.update(&[vote(0, 1, 1)], &[]);
    let plan = residency.update(&[vote(1, 1, 1)], &[]);
    let mut cancelled = plan.cancel.clone();
    cancelled.sort();
    let mut expected = first.request.clone();
    expected.sort();
    assert_eq!(cancelled, expected);
    assert_eq!(
        residency.arrived(column(0, 0)),
        Placement::Drop,
        "its answer came all the same"
    );
    assert_eq!(residency.summary().in_flight as usize, plan.request.len());
}

#[test]
fn votes_that_waver_do_not_toggle_requests() {
    // One place, two pages worth nearly the same.
    let weights = [[9.0, 1.0, 1.0, 1.0, 0.0, 0.0]];
    let mut residency = residency(3, 10, &[&weights]);
    let votes = |a: u32, b: u32| [vote(0, 2, a), vote(0, 3, b)];
    settle(&mut residency, &votes(1000, 900));
    assert!(is_resident(&residency, page(0, 0, 2)));
    for _ in 0..10 {
        assert_eq!(
            residency.update(&votes(1000, 1010), &[]),
            Plan::default(),
            "within the margin"
        );
        assert_eq!(residency.update(&votes(1010, 1000), &[]), Plan::default());
    }
    assert_eq!(residency.update(&votes(1000, 1100), &[]).request, [page(0, 0, 3)]);
    for _ in 0..10 {
        assert_eq!(
            residency.update(&votes(1000, 1005), &[]),
            Plan::default(),
            "in flight and still worth more"
        );
        assert_eq!(residency.update(&votes(1000, 1020), &[]), Plan::default());
    }
    assert_eq!(residency.update(&votes(1000, 1000), &[]).cancel, [page(0, 0, 3)]);
    assert_eq!(
        residency.update(&votes(1000, 1005), &[]),
        Plan::default(),
        "cancelled, and within the margin again"
    );
}

#[test]
fn a_page_gives_way_to_one_that_is_worth_more_and_only_then() {
    let weights = [[9.0, 1.0, 1.0, 1.0, 0.0, 0.0]];
    let mut residency = residency(3, 10, &[&weights]);
    settle(&mut residency, &[vote(0, 2, 10), vote(0, 3, 5)]);
    assert!(is_resident(&residency, page(0, 0, 2)));
    let votes = [vote(0, 2, 10), vote(0, 3, 20)];
    assert_eq!(residency.update(&votes, &[]).request, [page(0, 0, 3)]);
    let evicted = Some(page(0, 0, 2));
    assert_eq!(
        residency.arrived(page(0, 0, 3)),
        Placement::Place {
            slot: Slot(2),
            evicted
        }
    );
    assert_eq!(residency.summary().swapped, 1);
    assert_eq!(residency.arrived(page(0, 0, 3)), Placement::Drop, "a second time");
}

#[test]
fn a_page_that_its_column_has_left_is_dropped() {
    let (weak, strong) = ([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]], [[9.0, 0.0, 0.0, 0.0, 0.0, 0.0]]);
    let mut residency = residency(10, 1, &[&weak, &strong]);
    settle(&mut residency, &[vote(0, 0, 1)]);
    let votes = [vote(0, 1, 1), vote(1, 0, 1)];
    let plan = residency.update(&votes, &[]);
    assert!(
        plan.request.contains(&page(0, 0, 1)) && plan.request.contains(&column(1, 0)),
        "{plan:?}"
    );
    let evicted = Some(column(0, 0));
    assert_eq!(
        residency.arrived(column(1, 0)),
        Placement::Place {
            slot: Slot(0),
            evicted
        }
    );
    assert_eq!(
        residency.arrived(page(0, 0, 1)),
        Placement::Drop,
        "there is room, but nothing to multiply it with"
    );
}

#[test]
fn roots_are_pinned_where_slots_are_many_and_like_all_others_where_they_are_few() {
    // The root that few see is worth less than any page beside it.
    let (weak, strong) = ([[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]; 1], [[9.0; 6]; 6]);
    let votes: Vec<Vote> = (2..6)
        .map(|tile| vote(1, tile, 9))
        .chain([vote(0, 0, 1)])
        .collect();
    for (slots, pinned) in [(2 * SLOTS_PER_PIN, true), (2 * SLOTS_PER_PIN - 1, false)] {
        let mut residency = residency(slots, slots, &[&weak, &strong]);
        settle(&mut residency, &votes);
        assert_eq!(residency.summary().pages_resident, slots);
        assert!(is_resident(&residency, page(1, 0, 0)));
        assert_eq!(is_resident(&residency, page(0, 0, 0)), pinned, "{slots} slots");
    }
}

#[test]
fn failures_are_tried_again_after_twice_as_long_each_time() {
    let mut residency = residency(10, 10, &[&[[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]]]);
    let votes = [vote(0, 0, 1)];
    residency.update(&votes, &[]);
    residency.arrived(column(0, 0));
    residency.failed(page(0, 0, 0));
    for attempt in 1..15 {
        let mut waited = 1;
        while residency.update(&votes, &[]).request.is_empty() {
            let settled = residency.summary().settled;
            assert_eq!(
                settled,
                attempt >= PATIENCE,
                "attempt {attempt}: no one waits for it forever"
            );
            waited += 1;
        }
        assert_eq!(waited, (1u64 << attempt).min(LONGEST_BACK_OFF));
        residency.failed(page(0, 0, 0));
        residency.failed(page(0, 0, 0));
    }
    let mut waited = 0;
    while residency.update(&votes, &[]).request.is_empty() {
        waited += 1;
        assert!(waited <= LONGEST_BACK_OFF);
    }
    assert!(matches!(
        residency.arrived(page(0, 0, 0)),
        Placement::Place { .. }
    ));
    residency.update(&votes, &[]);
    assert!(residency.summary().settled);
}

#[test]
fn weights_that_are_no_weights_count_as_zero() {
    let mut residency = Residency::new(Limits {
        page_slots: 10,
        column_slots: 10,
        in_flight: 10,
        bytes_in_flight: u64::MAX,
    });
    let weights = vec![1.0, f32::NAN, f32::INFINITY, -1.0];
    residency.add_material(MaterialInfo {
        pyramid: pyramid(),
        groups: 2,
        weights,
        visibility: Vec::new(),
        page_bytes: Vec::new(),
        column_bytes: Vec::new(),
    });
    settle(&mut residency, &[vote(0, 2, 1), vote(0, 3, 1)]);
    assert_eq!(residency.summary().pages_resident, 1);
    assert_eq!(residency.summary().predicted_mse, 0.0);
}

#[test]
fn what_lowers_the_error_most_per_byte_is_asked_for_first() {
    // Both roots are pinned; group 1 of material 0 is worth more than that of material 1, but takes many more bytes.
    let weights = [[1.0, 0.5, 0.0, 0.0, 0.0, 0.0], [6.0, 0.0, 0.0, 0.0, 0.0, 0.0]];
    let mut residency = residency(64, 64, &[]);
    for (page_bytes, column_bytes) in [(900, 100), (50, 50)] {
        residency.add_material(MaterialInfo {
            page_bytes: vec![page_bytes; 12],
            column_bytes: vec![column_bytes; 2],
            ..material(&weights)
        });
    }
    let plan = residency.update(&[vote(0, 1, 2), vote(1, 1, 1)], &[]);
    let pinned = [column(1, 0), page(1, 0, 0), column(0, 0), page(0, 0, 0)];
    let others = [column(1, 1), page(1, 1, 0), column(0, 1), page(0, 1, 0)];
    assert_eq!(plan.request, [pinned, others].concat());
    let upcoming = residency.upcoming(100);
    let at = |items: &[Item], item| items.iter().position(|other| *other == item).unwrap();
    assert!(at(&upcoming, page(1, 0, 1)) < at(&upcoming, page(0, 0, 1)));
    // Another view: now material 0 is worth its bytes.
    residency.update(&[vote(0, 1, 200), vote(1, 1, 1)], &[]);
    let upcoming = residency.upcoming(100);
    assert!(at(&upcoming, page(0, 0, 1)) < at(&upcoming, page(1, 0, 1)));
}

#[test]
fn a_chain_is_known_from_the_start_and_ends_where_something_fails() {
    let mut residency = residency(10, 10, &[&[[8.0, 4.0, 2.0, 1.0, 0.0, 0.0]]]);
    let votes = [vote(0, 2, 10), vote(0, 3, 10)];
    assert_eq!(
        residency.update(&votes, &[]).request,
        [column(0, 0), page(0, 0, 0)]
    );
    let chain = [page(0, 0, 1), page(0, 0, 2), page(0, 0, 3)];
    let all = [&[column(0, 0), page(0, 0, 0)], &chain[..]].concat();
    assert_eq!(residency.upcoming(100), all);
    assert_eq!(residency.upcoming(3), all[..4]);
    residency.arrived(column(0, 0));
    residency.failed(page(0, 0, 0));
    residency.update(&votes, &[]);
    assert_eq!(
        residency.upcoming(100),
        [],
        "nothing can be placed without the root"
    );
    while residency.update(&votes, &[]).request.is_empty() {}
    assert_eq!(residency.upcoming(100), all[1..]);
    // The camera has left.
    residency.update(&[], &[]);
    assert_eq!(residency.upcoming(100), []);
}

#[test]
fn no_more_is_upcoming_than_gets_a_slot() {
    let weights = [[8.0, 4.0, 2.0, 1.0, 0.0, 0.0]];
    let mut residency = residency(3, 10, &[&weights]);
    residency.update(&[vote(0, 2, 10), vote(0, 3, 10)], &[]);
    let expected = [column(0, 0), page(0, 0, 0), page(0, 0, 1), page(0, 0, 2)];
    assert_eq!(residency.upcoming(100), expected);
}

#[test]
fn a_retired_material_is_wanted_no_more_until_it_comes_back() {
    let one = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]];
    let mut residency = residency(10, 10, &[&one]);
    let votes = [vote(0, 1, 1)];
    settle(&mut residency, &[vote(0, 0, 1)]);
    assert_eq!(residency.update(&votes, &[]).request, [page(0, 0, 1)]);
    residency.set_retired(MaterialId(0), true);
    assert_eq!(residency.summary().in_flight, 0);
    assert_eq!(residency.update(&votes, &[]), Plan::default());
    assert_eq!(residency.arrived(page(0, 0, 1)), Placement::Drop);
    assert!(residency.summary().settled && is_resident(&residency, page(0, 0, 0)));
    residency.set_retired(MaterialId(0), false);
    assert_eq!(residency.update(&votes, &[]).request, [page(0, 0, 1)]);
}

#[test]
fn visibility_changes_the_order_and_not_what_is_predicted() {
    let weights: &[[f32; 6]] = &[[8.0, 4.0, 0.0, 0.0, 0.0, 0.0]];
    let votes = [vote(0, 1, 10), vote(1, 1, 10)];
    for (visibility, first) in [
        ([1.0, 1.0], 0),
        ([1.0, 4.0], 1),
        ([4.0, 1.0], 0),
        ([1.0, f32::NAN], 0),
        ([1.0, -4.0], 0),
    ] {
        // No first roots are pinned with so few slots.
        let mut residency = residency(3, 2, &[]);
        for visibility in visibility {
            // Errors count where votes fall, not where pages are missing.
            let visibility = vec![100.0, visibility];
            residency.add_material(MaterialInfo {
                visibility,
                ..material(weights)
            });
        }
        let plan = residency.update(&votes, &[]);
        assert_eq!(plan.request[0], column(first, 0), "{visibility:?}");
        assert!((residency.summary().predicted_mse - 12.0).abs() < 1e-9);
        for item in &plan.request {
            residency.arrived(*item);
        }
        settle(&mut residency, &votes);
        assert!(is_resident(&residency, page(first, 0, 1)), "{visibility:?}");
        // Of the other material, half the pixels, the finer page is missing.
        assert!((residency.summary().predicted_mse - 2.0).abs() < 1e-9);
    }
}
