//! Measuring frames, and recording votes, on a small scene: the figures are complete and agree with each other.

use benches::engine::{Plan, built_in, measure, table};
use benches::policy::{self, Trace, record};

#[test]
fn frames_are_measured_and_a_static_view_does_nothing() {
    let subject = built_in(2, 2, 3).unwrap();
    let plan = Plan {
        size: (64, 36),
        page_cache_bytes: 32 << 20,
        column_cache_bytes: 8 << 20,
        rounds: 1,
        static_frames: 5,
    };
    let case = measure(&subject, &plan, &|_| ()).unwrap();
    assert_eq!((case.materials, case.views), (2, 2));
    assert_eq!(case.resident_rms, 0.0, "everything fits");
    assert!(case.duel.ratio > 0.0 && case.duel.ratio.is_finite());
    assert!(case.duel.resident_ms.frame > 0.0 && case.duel.resident_ms.feedback == 0.0);
    let still = case.still;
    assert_eq!(
        (still.frames, still.drawn, still.asked, still.vote_bytes),
        (5, 0, 0, 0)
    );
    let skipped = case.skipped;
    assert!(
        0 < skipped.pages_wanted && skipped.pages_wanted < skipped.pages,
        "{skipped:?}"
    );
    assert!(skipped.pages_wanted_in_a_view <= skipped.pages_wanted as f64);
    assert!(
        0 < skipped.pixels_empty && skipped.pixels_empty < skipped.pixels,
        "{skipped:?}"
    );
    // Four groups for each covered pixel, all there.
    let covered = skipped.pixels - skipped.pixels_empty;
    assert_eq!(skipped.groups.iter().sum::<u64>(), 4 * covered, "{skipped:?}");
    assert_eq!(skipped.groups[2], 0);
    assert!(skipped.vote_bytes[0] > 0.0 && skipped.workgroups[0] < skipped.workgroups[1]);
    // Three frames are too few for pages to arrive for sure.
    assert!(case.motion.frames == 3 && case.motion.cpu_ms.all > 0.0 && case.motion.wall_ms.all > 0.0);
    assert!(case.motion.placed >= case.motion.swapped);
    let saved = case.saved;
    assert!(
        0 < saved.page_bytes[0] && saved.page_bytes[0] < saved.page_bytes[1],
        "{saved:?}"
    );
    assert!(saved.stored_pages[0] <= skipped.pages_wanted && saved.stored_pages[1] <= skipped.pages);
    assert!(
        0.0 < saved.load_ms[0] && saved.load_ms[0] < saved.load_ms[1],
        "{saved:?}"
    );
    assert!(
        0.0 < saved.upload_ms[0] && saved.upload_ms[0] < saved.upload_ms[1],
        "{saved:?}"
    );
    assert!(saved.pixels_ms[0] <= saved.pixels_ms[1], "{saved:?}");
    // A frame that is not drawn takes less than one that is, even here.
    assert!(
        0.0 < saved.still_ms[0] && saved.still_ms[0] < saved.still_ms[1],
        "{saved:?}"
    );
    assert!(saved.groups_ms.iter().all(|ms| *ms > 0.0), "{saved:?}");
    let lines = table(&[case]);
    assert_eq!(lines.matches("tori, 2 materials").count(), 6, "{lines}");
}

#[test]
fn a_scene_is_recorded_and_replayed() {
    let subject = built_in(2, 3, 0).unwrap();
    let source = subject.archives.source().unwrap();
    let size = (64, 36);
    let trace = record("tori", &subject.scene, source, size, &subject.cameras, &|_| ()).unwrap();
    assert_eq!((trace.materials.len(), trace.frames.len()), (2, 3));
    for votes in &trace.frames {
        let pixels: u32 = votes.iter().map(|vote| vote.pixels).sum();
        assert!(0 < pixels && pixels <= size.0 * size.1, "{pixels}");
    }
    let mut bytes = Vec::new();
    trace.write(&mut bytes).unwrap();
    assert_eq!(Trace::read(&bytes[..]).unwrap(), trace);
    let plan = policy::Plan {
        budgets: vec![4, 1000],
        stops: 1,
        loads_per_frame: 64,
    };
    let results = policy::run(&trace, &plan, &|_| ()).unwrap();
    for point in &results.points {
        assert!(point.settled_rms <= results.empty_rms, "{point:?}");
        assert!(point.pages == 4 || point.settled_rms < 1e-9, "{point:?}");
    }
}
