//! Properties of residency over random traces: scenes, votes of the present and ahead, limits that change, and answers
//! that come late, twice, never, or that nobody asked for. Everything runs beside a plain model that works out all anew.

use engine::residency::{Item, Limits, MaterialId, Plan};
use proptest::prelude::*;
use tileset::{PageId, Tile};

use crate::{
    driver::{Driver, Step, item_material},
    scene::{scene, scene_seen, votes},
};

fn stray() -> impl Strategy<Value = Item> {
    (0u16..4, 0u16..5, 0u8..6, 0u16..9, 0u16..9, any::<bool>()).prop_map(
        |(material, group, mip, x, y, page)| {
            let page_id = PageId {
                group,
                tile: Tile { mip, x, y },
            };
            if page {
                Item::Page(MaterialId(material), page_id)
            } else {
                Item::Column(MaterialId(material), group)
            }
        },
    )
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        2 => votes().prop_map(Step::Votes),
        1 => votes().prop_map(Step::Ahead),
        1 => limits().prop_map(Step::Limits),
        6 => any::<usize>().prop_map(Step::Arrive),
        1 => any::<usize>().prop_map(Step::Fail),
        1 => stray().prop_map(Step::Stray),
        1 => stray().prop_map(Step::StrayFailure),
    ]
}

fn limits() -> impl Strategy<Value = Limits> {
    let bytes = prop_oneof![Just(u64::MAX), 0u64..600];
    (0u32..40, 0u32..10, 0usize..9, bytes).prop_map(
        |(page_slots, column_slots, in_flight, bytes_in_flight)| Limits {
            page_slots,
            column_slots,
            in_flight,
            bytes_in_flight,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// Budgets, closure, and the predicted error against a naive model hold after every step; the checks
    /// are in the driver.
    #[test]
    fn invariants_hold_on_any_trace(
        scene in scene_seen(), limits in limits(), steps in prop::collection::vec(step(), 1..60),
    ) {
        let mut driver = Driver::new(&scene, limits);
        steps.iter().for_each(|step| driver.run(step));
    }

    #[test]
    fn the_same_trace_gives_the_same_operations(
        scene in scene_seen(), limits in limits(), steps in prop::collection::vec(step(), 1..60),
    ) {
        let [first, second] = [(), ()].map(|()| {
            let mut driver = Driver::new(&scene, limits);
            steps.iter().for_each(|step| driver.run(step));
            driver.log
        });
        prop_assert_eq!(first, second);
    }

    /// Whatever happened before, static votes settle; then nothing moves, and visible materials have their
    /// roots.
    #[test]
    fn static_votes_settle(
        scene in scene_seen(), mut limits in limits(), steps in prop::collection::vec(step(), 0..40),
        last in votes(), turn: usize,
    ) {
        limits.in_flight = limits.in_flight.max(1);
        let mut driver = Driver::new(&scene, limits);
        steps.iter().for_each(|step| driver.run(step));
        driver.set_limits(limits);
        driver.update(&last);
        // Attempts at what failed come to an end too: back-offs are shorter than this.
        driver.settle(turn);
        for _ in 0..70 {
            driver.update(&last);
            driver.settle(turn);
        }
        let before = driver.residency.summary();
        let resident = driver.residency.resident();
        prop_assert!(before.settled);
        for _ in 0..3 {
            prop_assert_eq!(driver.update(&last), Plan::default());
        }
        prop_assert_eq!(driver.residency.summary(), before);
        prop_assert_eq!(driver.residency.resident(), resident);
        for root in driver.scene.roots_to_expect(limits.page_slots) {
            prop_assert!(driver.residency.slot(root).is_some(), "{root:?} is missing");
        }
        if driver.scene.fits(limits) {
            prop_assert_eq!(before.predicted_mse, 0.0);
        }
    }

    /// Under static votes a page's swap never raises the predicted error, where w·v falls from mip to mip.
    #[test]
    fn swaps_lower_the_error(
        scene in scene(), limits in limits(), first in votes(), second in votes(), turn: usize,
    ) {
        let scene = scene.falling();
        // Room for all columns: a swap of columns is an investment.
        let limits = Limits { in_flight: limits.in_flight.max(1), column_slots: 100, ..limits };
        let mut driver = Driver::new(&scene, limits);
        for votes in [first, second] {
            driver.update(&votes);
            let mut turn = turn;
            for _ in 0..200 {
                while !driver.in_flight.is_empty() {
                    let before = driver.mse();
                    turn = turn.wrapping_mul(25_214_903_917).wrapping_add(11);
                    let item = driver.in_flight[(turn >> 16) % driver.in_flight.len()];
                    let placement = driver.arrive(item);
                    let pinned = matches!(item, Item::Page(_, page) if page.group == 0
                        && page.tile == driver.scene.materials[item_material(item)].pyramid.root());
                    if !pinned && driver.residency_has_column(item) {
                        prop_assert!(driver.mse() <= before * (1.0 + 1e-12), "{item:?} {placement:?}");
                    }
                }
                driver.update(&votes);
            }
        }
    }

    /// Settled, the predicted error is that of the best closed set of as many pages, up to the margin, and
    /// up to the one set of pages of equal value that the budget may cut.
    #[test]
    fn settled_is_nearly_optimal(scene in scene(), slots in 1u32..30, turn: usize, votes in votes()) {
        for (scene, whole_blocks) in [(scene.clone(), false), (scene.falling(), true)] {
            let limits = Limits { page_slots: slots, column_slots: 100, in_flight: 4, bytes_in_flight: u64::MAX };
            let mut driver = Driver::new(&scene, limits);
            driver.update(&votes);
            driver.settle(turn);
            let best = driver.scene.best_mse(slots as usize);
            let (margin, block) = driver.scene.slack(best);
            let most = best + margin + if whole_blocks { 0.0 } else { block };
            prop_assert!(driver.mse() <= most * (1.0 + 1e-9) + 1e-9, "{} where {best} is possible", driver.mse());
        }
    }
}
