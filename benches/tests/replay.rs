//! The same trace gives the same counts, and another one does not.

use benches::engine::built_in;
use benches::replay::{Footage, Trace, replay, table};
use benches::stream::close_up;
use engine::stream::Network;

fn trace(network: &str) -> Trace {
    let cameras = close_up(3, 20).unwrap().cameras;
    let network = Network::named(network).unwrap();
    Trace {
        // Less than the way wants, so that pages are swapped.
        page_cache_bytes: 1 << 20,
        column_cache_bytes: 4 << 20,
        ..Trace::new(
            "tori".into(),
            Footage::Made { materials: 3 },
            (128, 72),
            network,
            cameras,
        )
    }
}

#[test]
fn a_trace_is_replayed_exactly() {
    let mut trace = trace("4g");
    let first = replay(&trace, 2, &|_| ()).unwrap();
    assert_eq!(first.differences, None);
    let counts = &first.counts;
    assert!(
        counts.settled && counts.indices == 3 && counts.pages > 20 && counts.swapped > 0,
        "{counts:?}"
    );
    assert!(
        counts.line_bytes > 0 && counts.predicted_rms_mean > counts.predicted_rms_last,
        "{counts:?}"
    );
    assert_eq!(first.cpu_ms_rounds.len(), 2);

    // From disk, by another engine.
    trace.counts = Some(first.counts.clone());
    let mut bytes = Vec::new();
    trace.write(&mut bytes).unwrap();
    let again = replay(&Trace::read(&bytes[..]).unwrap(), 1, &|_| ()).unwrap();
    assert_eq!(again.differences.as_deref(), Some(&[][..]));
    assert_eq!(again.counts, first.counts);
    assert!(table(&again).contains("| as recorded | yes |"));

    // A camera that goes another way is another trace.
    trace.cameras = built_in(3, 20, 0).unwrap().cameras;
    let moved = replay(&trace, 1, &|_| ()).unwrap();
    let differences = moved.differences.as_ref().unwrap();
    assert!(
        differences.iter().any(|text| text.starts_with("order is")),
        "{differences:?}"
    );
    assert!(table(&moved).contains("| differs | order is"));
}
