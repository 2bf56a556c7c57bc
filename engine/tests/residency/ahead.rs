//! Votes ahead, and budgets that change: rules in the smallest scenes that show them, and the one promise as a property.

use engine::residency::{
    Item, Limits, MaterialId, MaterialInfo, Move, Placement, Plan, Residency, Slot, Vote,
};
use proptest::prelude::*;
use tileset::{PageId, Pyramid};

use crate::scene::{scene, votes};

const LIMITS: Limits = Limits {
    page_slots: 10,
    column_slots: 10,
    in_flight: 100,
    bytes_in_flight: u64::MAX,
};

/// Materials of 64×64 texels: a root of 32×32 (tile 0), and one page (tile 1), of 100 bytes each; columns have 50.
fn residency(limits: Limits, weights: &[[f32; 2]]) -> Residency {
    let pyramid = Pyramid::new(64, 64, true).unwrap();
    assert_eq!(pyramid.tile_count(), 2);
    let mut residency = Residency::new(limits);
    for weights in weights {
        residency.add_material(MaterialInfo {
            pyramid,
            groups: 1,
            weights: weights.to_vec(),
            visibility: Vec::new(),
            page_bytes: vec![100; 2],
            column_bytes: vec![50],
        });
    }
    residency
}

fn page(material: u16, tile: u32) -> Item {
    let tile = Pyramid::new(64, 64, true).unwrap().tile_at(tile).unwrap();
    Item::Page(MaterialId(material), PageId { group: 0, tile })
}

fn column(material: u16) -> Item {
    Item::Column(MaterialId(material), 0)
}

fn vote(material: u16, pixels: u32) -> Vote {
    Vote {
        material: MaterialId(material),
        tile: 1,
        pixels,
    }
}

fn settle(residency: &mut Residency, votes: &[Vote], ahead: &[Vote]) {
    for _ in 0..100 {
        let plan = residency.update(votes, ahead);
        if plan == Plan::default() {
            return;
        }
        for item in plan.request {
            residency.arrived(item);
        }
    }
    panic!("does not settle");
}

fn items(residency: &Residency) -> Vec<Item> {
    residency.resident().into_iter().map(|(item, _)| item).collect()
}

#[test]
fn what_is_ahead_comes_after_the_present() {
    let mut residency = residency(LIMITS, &[[1.0, 1.0], [90.0, 90.0]]);
    let plan = residency.update(&[vote(0, 1)], &[vote(1, 100)]);
    assert_eq!(plan.request, [column(0), page(0, 0), column(1), page(1, 0)]);
    settle(&mut residency, &[vote(0, 1)], &[vote(1, 100)]);
    let mut one_at_a_time = self::residency(
        Limits {
            in_flight: 1,
            ..LIMITS
        },
        &[[1.0, 1.0], [90.0, 90.0]],
    );
    let mut order = Vec::new();
    for _ in 0..6 {
        let plan = one_at_a_time.update(&[vote(0, 1)], &[vote(1, 100)]);
        plan.request.iter().for_each(|item| {
            one_at_a_time.arrived(*item);
        });
        order.extend(plan.request);
    }
    let present = [column(0), page(0, 0), page(0, 1)];
    assert_eq!(order, [present, [column(1), page(1, 0), page(1, 1)]].concat());
}

#[test]
fn what_is_ahead_does_not_keep_the_present_from_settling() {
    let mut residency = residency(LIMITS, &[[1.0, 1.0], [1.0, 1.0]]);
    settle(&mut residency, &[vote(0, 1)], &[]);
    let plan = residency.update(&[vote(0, 1)], &[vote(1, 1)]);
    assert_eq!(plan.request, [column(1), page(1, 0)]);
    assert!(residency.summary().settled && residency.summary().prefetching);
    residency.arrived(column(1));
    residency.failed(page(1, 0));
    assert!(residency.summary().settled && residency.summary().prefetching);
    while residency.update(&[vote(0, 1)], &[vote(1, 1)]).request.is_empty() {
        assert!(residency.summary().settled);
    }
    residency.arrived(page(1, 0));
    settle(&mut residency, &[vote(0, 1)], &[vote(1, 1)]);
    assert!(residency.summary().settled && !residency.summary().prefetching);
    assert_eq!(residency.summary().predicted_mse, 0.0);
    // It was worth it: when the view is there, nothing has to come.
    assert_eq!(residency.update(&[vote(1, 1)], &[]), Plan::default());
    assert!(residency.summary().settled && residency.summary().predicted_mse == 0.0);
}

#[test]
fn what_is_ahead_takes_places_that_nobody_wants_and_gives_them_back() {
    let limits = Limits {
        page_slots: 4,
        ..LIMITS
    };
    let mut residency = residency(limits, &[[1.0, 1.0]; 4]);
    settle(&mut residency, &[vote(0, 1)], &[]);
    settle(&mut residency, &[vote(1, 1)], &[]);
    // Material 0 has been left behind and gives way, the present does not.
    settle(&mut residency, &[vote(1, 1)], &[vote(2, 1000)]);
    let pages = |residency: &Residency| -> Vec<Item> {
        let mut pages = items(residency);
        pages.retain(|item| matches!(item, Item::Page(..)));
        pages.sort();
        pages
    };
    assert_eq!(
        pages(&residency),
        [page(1, 1), page(1, 0), page(2, 1), page(2, 0)]
    );
    settle(&mut residency, &[vote(1, 1), vote(3, 1)], &[vote(2, 1000)]);
    assert_eq!(
        pages(&residency),
        [page(1, 1), page(1, 0), page(3, 1), page(3, 0)]
    );
    assert!(residency.summary().settled && !residency.summary().prefetching);
}

#[test]
fn what_is_in_flight_ahead_gives_way_to_requests_of_the_present() {
    for limits in [
        Limits {
            in_flight: 2,
            ..LIMITS
        },
        Limits {
            bytes_in_flight: 150,
            ..LIMITS
        },
    ] {
        let mut residency = residency(limits, &[[1.0, 1.0], [1.0, 1.0]]);
        assert_eq!(
            residency.update(&[], &[vote(1, 9)]).request,
            [column(1), page(1, 0)]
        );
        let plan = residency.update(&[vote(0, 1)], &[vote(1, 9)]);
        assert_eq!(plan.cancel, [page(1, 0), column(1)]);
        assert_eq!(plan.request, [column(0), page(0, 0)]);
        assert_eq!(residency.arrived(column(1)), Placement::Drop);
        assert!(matches!(residency.arrived(column(0)), Placement::Place { .. }));
        // Now there is room for one more item; by bytes for a column.
        assert_eq!(
            residency.update(&[vote(0, 1)], &[vote(1, 9)]).request,
            [column(1)]
        );
    }
}

#[test]
fn bytes_in_flight_are_bounded_and_a_large_record_travels_alone() {
    let limits = Limits {
        bytes_in_flight: 120,
        ..LIMITS
    };
    let mut small = residency(limits, &[[1.0, 1.0]]);
    assert_eq!(small.update(&[vote(0, 1)], &[]).request, [column(0)]);
    small.arrived(column(0));
    assert_eq!(small.update(&[vote(0, 1)], &[]).request, [page(0, 0)]);
    let mut none = residency(
        Limits {
            bytes_in_flight: 0,
            ..LIMITS
        },
        &[[1.0, 1.0]],
    );
    settle(&mut none, &[vote(0, 1)], &[]);
    assert_eq!(items(&none), [page(0, 0), page(0, 1), column(0)]);
}

#[test]
fn a_smaller_cache_keeps_what_is_worth_most_and_a_larger_one_is_filled() {
    let mut residency = residency(LIMITS, &[[1.0, 1.0], [3.0, 2.0], [5.0, 4.0]]);
    let votes = [vote(0, 1), vote(1, 1), vote(2, 1)];
    // In this order, so that the least lie in the first slots.
    for seen in 1..=3 {
        settle(&mut residency, &votes[..seen], &[]);
    }
    let resized = residency.set_limits(Limits {
        page_slots: 4,
        column_slots: 10,
        ..LIMITS
    });
    assert_eq!(resized.evicted, [(page(0, 0), Slot(0)), (page(0, 1), Slot(1))]);
    let moves = [(page(2, 0), 4, 0), (page(2, 1), 5, 1)];
    let moves = moves.map(|(item, from, to)| Move {
        item,
        from: Slot(from),
        to: Slot(to),
    });
    assert_eq!(resized.moved, moves);
    assert_eq!(residency.summary().predicted_mse, 2.0 / 3.0);
    settle(&mut residency, &votes, &[]);
    assert_eq!(
        residency.summary().predicted_mse,
        2.0 / 3.0,
        "nothing better can be had"
    );
    assert_eq!(residency.set_limits(LIMITS), Default::default());
    settle(&mut residency, &votes, &[]);
    assert_eq!(residency.summary().predicted_mse, 0.0);
}

#[test]
fn without_its_column_a_group_goes_first() {
    let mut residency = residency(LIMITS, &[[9.0, 9.0], [1.0, 1.0]]);
    let votes = [vote(0, 1), vote(1, 5)];
    settle(&mut residency, &votes, &[]);
    let resized = residency.set_limits(Limits {
        page_slots: 3,
        column_slots: 1,
        in_flight: 1,
        ..LIMITS
    });
    let evicted: Vec<Item> = resized.evicted.iter().map(|(item, _)| *item).collect();
    assert_eq!(evicted, [column(1), page(1, 1)]);
    assert!(residency.update(&votes, &[]).request.is_empty());
    assert!(residency.summary().settled);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// With votes ahead the present asks for the same, in the same order and in the same updates, as without; and what it
    /// has of its own is there at the same time.
    #[test]
    fn the_present_is_neither_displaced_nor_delayed(
        scene in scene(), present in votes(), ahead in prop::collection::vec(votes(), 1..5),
        page_slots in 0u32..40, column_slots in 0u32..10, in_flight in 1usize..9,
    ) {
        let limits = Limits { page_slots, column_slots, in_flight, bytes_in_flight: u64::MAX };
        let [mut without, mut with] = [(), ()].map(|()| Residency::new(limits));
        for info in &scene.materials {
            without.add_material(info.clone());
            with.add_material(info.clone());
        }
        let mut answers: Vec<Item> = Vec::new();
        for (n, ahead) in ahead.iter().cycle().take(60).enumerate() {
            let [plain, plan] = [without.update(&present, &[]), with.update(&present, ahead)];
            let (first, rest) = plan.request.split_at_checked(plain.request.len()).unwrap_or((&[], &[]));
            prop_assert_eq!(first, &plain.request, "update {}", n);
            prop_assert!(plan.cancel.iter().all(|item| plain.cancel.contains(item) || !answers.contains(item)));
            answers.retain(|item| !plain.cancel.contains(item));
            answers.extend(&plain.request);
            // Half of the answers to the present come at once; those ahead at once, before and after them.
            let (before, after) = rest.split_at(rest.len() / 2);
            before.iter().for_each(|item| { with.arrived(*item); });
            for item in answers.drain(..answers.len().div_ceil(2)) {
                let (plain, here) = (without.arrived(item), with.arrived(item));
                prop_assert_eq!(plain == Placement::Drop, here == Placement::Drop);
            }
            after.iter().for_each(|item| { with.arrived(*item); });
            let (plain, here) = (without.summary(), with.summary());
            prop_assert_eq!((plain.predicted_mse, plain.settled), (here.predicted_mse, here.settled));
        }
    }
}
