//! An hour at random over a line that fails; alone in its process, because its memory is looked at.

use benches::endurance::{Plan, Weather, endure, table};

/// What allocators and the driver may do in nine tenths of the time.
const MAX_GROWTH_BYTES: u64 = 8 << 20;

#[test]
fn memory_stays_budgets_hold_and_the_picture_is_right() {
    let plan = Plan {
        minutes: 60.0,
        materials: 12,
        size: (64, 36),
        seed: 20,
    };
    let endured = endure(&plan, &|_| ()).unwrap();
    let text = table(&endured);
    println!("{text}");
    assert!(endured.broken.is_empty(), "{:#?}\n{text}", endured.broken);
    assert!(endured.difference < 2e-3, "\n{text}");
    let [tenth, end] = endured.resident_bytes.expect("the system tells");
    assert!(end < tenth + MAX_GROWTH_BYTES, "\n{text}");
    // All of it has happened, often, and the budgets were used up.
    for (weather, seconds) in &endured.weather {
        assert!(
            *seconds > 10.0 || *weather == Weather::Restarted,
            "{weather:?}: {seconds} s"
        );
    }
    let counters = endured.counters;
    assert!(
        counters.requests_failed > 100 && counters.records_damaged > 100,
        "{counters:?}"
    );
    assert!(
        counters.requests_cancelled > 100 && endured.swapped > 1000,
        "\n{text}"
    );
    assert_eq!(endured.most[0].most, endured.most[0].budget, "\n{text}");
}
