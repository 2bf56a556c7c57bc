//! Materials become known one by one, and programs are told.

use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicUsize, Ordering},
};

use engine::{
    frame::Event,
    stream::{Answer, MemorySource, Request, Ticket, TileSource},
};
use tileset::Direction;

use super::*;
use crate::{
    material::directions,
    scene::{btf, still_life},
};

/// Keeps the index of one archive back until it is let go, and counts records in flight.
struct Gate {
    line: MemorySource,
    archive: &'static str,
    open: Arc<AtomicBool>,
    kept: Vec<Answer>,
    most_in_flight: Arc<AtomicUsize>,
}

impl TileSource for Gate {
    fn capacity(&self) -> usize {
        self.line.capacity()
    }
    fn in_flight(&self) -> usize {
        self.line.in_flight() + self.kept.len()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        let ticket = self.line.submit(request);
        self.most_in_flight
            .fetch_max(self.line.in_flight(), Ordering::Relaxed);
        ticket
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.line.cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        if self.open.load(Ordering::Relaxed)
            && let Some(kept) = self.kept.pop()
        {
            return Some(kept);
        }
        loop {
            let answer = self.line.poll()?;
            let is_index =
                matches!(&answer.request, Request::Index { archive } if **archive == *self.archive);
            if !is_index || self.open.load(Ordering::Relaxed) {
                return Some(answer);
            }
            self.kept.push(answer);
        }
    }
    fn wait(&mut self, limit: Duration) {
        self.line.wait(limit);
    }
}

fn more_directions() -> Vec<Direction> {
    let mut more = directions();
    more.extend((0..20).map(|at| Direction {
        theta: 1.45,
        phi: f64::from(at) * 0.31,
    }));
    more
}

#[test]
fn a_late_material_appears_beside_what_is_resident() {
    let early = Recipe::default().build();
    // Larger columns: those that are resident move into larger slots.
    let late = Recipe {
        groups: 2,
        directions: more_directions,
        ..Default::default()
    }
    .build();
    let archives: &[(&str, &[u8])] = &[("early", &early), ("late", &late)];
    let (mut scene, camera) = still_life();
    scene.materials[0] = btf("late", 4.0);
    scene.materials[1] = btf("early", 2.0);
    let mut whole = engine(&scene, archives, options((160, 90)));
    let expected = *settle(&mut whole, &camera).last().unwrap();
    for wait in [true, false] {
        let open = Arc::new(AtomicBool::new(false));
        let gate = Gate {
            line: *source(archives),
            archive: "late",
            open: open.clone(),
            kept: Vec::new(),
            most_in_flight: Arc::default(),
        };
        let options = Options {
            wait,
            ..options((160, 90))
        };
        let mut engine = Engine::new(Context::headless().unwrap(), &scene, Box::new(gate), options).unwrap();
        let begin = std::time::Instant::now();
        let mut added = 0;
        // Until the other one is there with all that it wants.
        loop {
            let stats = engine.frame(&camera).unwrap();
            added += stats.added;
            assert!(!stats.settled && stats.archives == 2 && stats.archives_failed == 0);
            assert!(stats.archives_known <= 1 && begin.elapsed() < LIMIT);
            if stats.archives_known == 1 && stats.pages_resident > 1 && engine.summary().settled {
                break;
            }
        }
        let half = engine.picture().unwrap();
        assert!(relative_rmse(&half, &whole.picture().unwrap()) > 0.05);
        open.store(true, Ordering::Relaxed);
        let frames = settle(&mut engine, &camera);
        added += frames.iter().map(|stats| stats.added).sum::<u32>();
        let last = frames.last().unwrap();
        assert_eq!(
            (last.archives_known, last.pages_resident),
            (2, expected.pages_resident)
        );
        // What was resident stayed so.
        assert_eq!(added, expected.pages_resident + expected.columns_resident);
        let error = relative_rmse(&engine.picture().unwrap(), &whole.picture().unwrap());
        assert!(error < 1e-4, "{error}");
        let events: Vec<_> = engine.events().collect();
        let kinds: Vec<_> = events
            .iter()
            .map(|event| match event {
                Event::MaterialKnown { archive } => &**archive,
                Event::FirstPicture(_) => "first",
                Event::Settled(_) => "settled",
                _ => "other",
            })
            .collect();
        assert_eq!(kinds, ["early", "first", "late", "settled"]);
        assert_eq!(engine.events().count(), 0);
    }
}

#[test]
fn a_missing_archive_and_one_too_large_are_told_once_and_the_rest_settles() {
    let small = Recipe {
        groups: 1,
        ..Default::default()
    }
    .build();
    let large = Recipe {
        groups: 1,
        directions: more_directions,
        ..Default::default()
    }
    .build();
    let (mut scene, camera) = still_life();
    scene.materials[1] = btf("large", 1.0);
    scene.materials[2] = btf("lost", 1.0);
    let options = Options {
        budgets: Budgets {
            // Room for one column of `weave`.
            column_cache_bytes: 29 << 11,
            ..options((96, 54)).budgets
        },
        ..options((96, 54))
    };
    let source = source(&[("weave", &small), ("large", &large)]);
    let mut engine = Engine::new(Context::headless().unwrap(), &scene, source, options).unwrap();
    let last = *engine.settle(&camera, LIMIT).unwrap().last().unwrap();
    assert!(last.settled && last.pages_resident > 0 && last.columns_resident == 1);
    assert_eq!(
        (last.archives, last.archives_known, last.archives_failed),
        (3, 1, 2)
    );
    for _ in 0..5 {
        assert!(engine.frame(&camera).unwrap().settled);
    }
    let problems = |event| match event {
        Event::Problem(problem) => Some(problem),
        _ => None,
    };
    let problems: Vec<String> = engine.events().filter_map(problems).collect();
    assert_eq!(problems.len(), 2, "{problems:?}");
    for (name, why) in [("lost", "lost"), ("large", "no room for one column")] {
        assert!(
            problems
                .iter()
                .any(|problem| problem.contains(name) && problem.contains(why))
        );
    }
    assert!(matches!(
        engine.wait_for_materials(LIMIT),
        Err(engine::Error::Budget(_) | engine::Error::Source { .. })
    ));
}

#[test]
fn bytes_in_flight_and_decodes_in_a_frame_are_bounded() {
    let archive = Recipe::default().build();
    let (scene, camera) = still_life();
    for (wait, bytes_in_flight, most_in_flight) in [(true, 1, 1), (false, 1, 1), (true, 1 << 30, 64)] {
        let most = Arc::new(AtomicUsize::new(0));
        let gate = Gate {
            line: *source(&[("weave", &archive)]),
            archive: "none",
            open: Arc::default(),
            kept: Vec::new(),
            most_in_flight: most.clone(),
        };
        let options = Options {
            wait,
            budgets: Budgets {
                bytes_in_flight,
                decodes_per_frame: 2,
                ..options((96, 54)).budgets
            },
            ..options((96, 54))
        };
        let mut engine = Engine::new(Context::headless().unwrap(), &scene, Box::new(gate), options).unwrap();
        let frames = settle(&mut engine, &camera);
        if wait {
            assert!(frames.iter().all(|stats| stats.added + stats.swapped <= 2));
        }
        let most = most.load(Ordering::Relaxed);
        assert!(most > 0 && most <= most_in_flight, "{most}");
    }
}
