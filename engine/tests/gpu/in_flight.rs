//! What is on its way: within its budgets though chains are fetched together, and given up when the camera leaves.

use std::{
    cell::RefCell,
    collections::{HashMap, HashSet},
    rc::Rc,
};

use engine::stream::{
    Answer, MemorySource, Network, NetworkSource, NetworkStats, Request, Ticket, TileSource,
};
use tileset::{PageId, archive::Index};

use super::*;
use crate::scene::still_life;

/// A slow line, and what is on it.
struct Line {
    line: NetworkSource<MemorySource>,
    index: Index,
    open: HashMap<Ticket, Request>,
    came: HashSet<Request>,
    /// Most bytes of records in flight at a time, and the largest record.
    most_bytes: u64,
    largest: u64,
    /// Pages asked for before their parents had come, and how many of these were given up.
    early: HashSet<Ticket>,
    early_given_up: usize,
    /// Requests for what was in flight already, or had come.
    twice: usize,
}

impl Line {
    fn length(&self, request: &Request) -> u64 {
        let record = request.record(&self.index).unwrap();
        record.map_or(0, |record| record.length.into())
    }

    /// Whether a page is asked for before its parent has come.
    fn is_early(&self, request: &Request) -> bool {
        let Request::Page { archive, page } = request else {
            return false;
        };
        self.index.pyramid.parent(page.tile).is_some_and(|tile| {
            let parent = PageId { tile, ..*page };
            let archive = archive.clone();
            self.index.page(parent).unwrap().length > 0
                && !self.came.contains(&Request::Page {
                    archive,
                    page: parent,
                })
        })
    }
}

#[derive(Clone)]
struct Shared(Rc<RefCell<Line>>);

impl TileSource for Shared {
    fn capacity(&self) -> usize {
        self.0.borrow().line.capacity()
    }
    fn in_flight(&self) -> usize {
        self.0.borrow().line.in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        let mut line = self.0.borrow_mut();
        let twice = line.open.values().any(|open| *open == request) || line.came.contains(&request);
        line.twice += usize::from(twice);
        let ticket = line.line.submit(request.clone())?;
        if line.is_early(&request) {
            line.early.insert(ticket);
        }
        line.largest = line.largest.max(line.length(&request));
        line.open.insert(ticket, request);
        let bytes = line.open.values().map(|request| line.length(request)).sum();
        line.most_bytes = line.most_bytes.max(bytes);
        Some(ticket)
    }
    fn cancel(&mut self, ticket: Ticket) {
        let mut line = self.0.borrow_mut();
        line.open.remove(&ticket);
        line.early_given_up += usize::from(line.early.contains(&ticket));
        line.line.cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        let mut line = self.0.borrow_mut();
        let answer = line.line.poll()?;
        line.open.remove(&answer.ticket);
        line.came.insert(answer.request.clone());
        Some(answer)
    }
    fn wait(&mut self, limit: Duration) {
        self.0.borrow_mut().line.wait(limit);
    }
}

/// An engine at the end of a line, all of whose requests can be seen.
fn at_the_end(network: Network, budgets: Budgets) -> (Engine, Shared, Camera) {
    let archive = Recipe {
        groups: 6,
        ..Default::default()
    }
    .build();
    let index = Index::parse(&open(&archive).prefix().unwrap()).unwrap();
    let mut memory = MemorySource::with_capacity(1024);
    memory.insert("weave", archive).unwrap();
    let shared = Shared(Rc::new(RefCell::new(Line {
        line: NetworkSource::new(memory, network, 1),
        index,
        open: HashMap::new(),
        came: HashSet::new(),
        most_bytes: 0,
        largest: 0,
        early: HashSet::new(),
        early_given_up: 0,
        twice: 0,
    })));
    let (scene, camera) = still_life();
    let options = Options {
        budgets,
        feedback_stride: 1,
        // Only what is shown is asked for.
        prefetch_seconds: 0.0,
        ..options((240, 135))
    };
    let source = Box::new(shared.clone());
    let engine = Engine::new(Context::headless().unwrap(), &scene, source, options).unwrap();
    (engine, shared, camera)
}

/// A frame of a sixtieth of a second.
fn frame(engine: &mut Engine, line: &Shared, camera: &Camera) -> FrameStats {
    line.0.borrow_mut().line.advance(Duration::from_secs(1) / 60);
    engine.step(camera).unwrap()
}

fn stats(line: &Shared) -> NetworkStats {
    line.0.borrow().line.network_stats()
}

#[test]
fn bytes_in_flight_are_never_more_than_the_budget_with_chains_too() {
    let network = Network::line(4_000_000, Duration::from_millis(60), 0.0);
    for bytes_in_flight in [1, 4 << 10, 16 << 10] {
        let budgets = Budgets {
            bytes_in_flight,
            ..options((8, 8)).budgets
        };
        let (mut engine, line, camera) = at_the_end(network, budgets);
        let settled = (0..6000).any(|_| frame(&mut engine, &line, &camera).settled);
        assert!(settled, "{bytes_in_flight}");
        let line = line.0.borrow();
        // A single record may be larger.
        let bound = bytes_in_flight.max(line.largest);
        assert!(line.most_bytes <= bound, "{} of {bound}", line.most_bytes);
        assert_eq!(line.twice, 0, "nothing is asked for twice");
        if bytes_in_flight > line.largest {
            assert!(!line.early.is_empty(), "chains were fetched together");
        }
    }
}

#[test]
fn what_was_fetched_early_is_given_up_when_the_camera_leaves() {
    let network = Network::line(800_000, Duration::from_millis(100), 0.0);
    let (mut engine, line, camera) = at_the_end(network, options((8, 8)).budgets);
    // Until chains are on their way.
    let under_way = (0..600).any(|_| {
        frame(&mut engine, &line, &camera);
        let line = line.0.borrow();
        line.open.len() > 4 && line.early.iter().any(|ticket| line.open.contains_key(ticket))
    });
    assert!(under_way, "{} asked for early", line.0.borrow().early.len());
    let before = (stats(&line), engine.counters().requests_cancelled);
    assert_eq!(line.0.borrow().early_given_up, 0);
    let away = Camera {
        target: camera.eye + (camera.eye - camera.target),
        ..camera
    };
    for _ in 0..30 {
        frame(&mut engine, &line, &away);
    }
    assert!(
        line.0.borrow().open.is_empty(),
        "nothing is seen, nothing is wanted"
    );
    assert!(line.0.borrow().early_given_up > 0);
    assert!(engine.counters().requests_cancelled > before.1 + 4);
    let after = stats(&line);
    assert!(after.saved_bytes > before.0.saved_bytes, "{after:?}");
    // It comes when the camera does, and all ends as if it had never left.
    let settled = (0..6000).any(|_| frame(&mut engine, &line, &camera).settled);
    assert!(settled);
    let (mut whole, other, _) = at_the_end(Network::default(), options((8, 8)).budgets);
    assert!((0..6000).any(|_| frame(&mut whole, &other, &camera).settled));
    let error = relative_rmse(&engine.picture().unwrap(), &whole.picture().unwrap());
    assert!(error < 1e-4, "{error}");
}
