//! Round trips: what a first view takes, and in which order it is asked for.

use std::{
    collections::HashSet,
    sync::{Arc, Mutex},
};

use engine::stream::{Answer, MemorySource, Request, Ticket, TileSource};
use tileset::{PageId, archive::Index};

use super::*;
use crate::scene::still_life;

/// A line on which everything that is under way comes together, whenever somebody waits for it: a round trip each.
struct Line {
    line: MemorySource,
    /// Answers that have come.
    come: usize,
    /// What was asked for before each round trip.
    rounds: Arc<Mutex<Vec<Vec<Request>>>>,
}

impl TileSource for Line {
    fn capacity(&self) -> usize {
        self.line.capacity()
    }
    fn in_flight(&self) -> usize {
        self.line.in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.rounds
            .lock()
            .unwrap()
            .last_mut()
            .unwrap()
            .push(request.clone());
        self.line.submit(request)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.line.cancel(ticket);
        self.come = self.come.min(self.line.in_flight());
    }
    fn poll(&mut self) -> Option<Answer> {
        self.come = self.come.checked_sub(1)?;
        self.line.poll()
    }
    fn wait(&mut self, _limit: Duration) {
        self.come = self.line.in_flight();
        self.rounds.lock().unwrap().push(Vec::new());
    }
}

/// The requests of each round trip until a view has settled.
fn rounds(archive: &[u8], budgets: Budgets) -> (Vec<Vec<Request>>, FrameStats, Picture) {
    let (scene, camera) = still_life();
    let mut memory = MemorySource::with_capacity(1024);
    memory.insert("weave", archive.to_vec()).unwrap();
    let rounds = Arc::new(Mutex::new(vec![Vec::new()]));
    let line = Line {
        line: memory,
        come: 0,
        rounds: rounds.clone(),
    };
    let options = Options {
        budgets,
        // All pixels vote at once.
        feedback_stride: 1,
        ..options((240, 135))
    };
    let mut engine = Engine::new(Context::headless().unwrap(), &scene, Box::new(line), options).unwrap();
    engine.wait_for_materials(LIMIT).unwrap();
    let last = *settle(&mut engine, &camera).last().unwrap();
    let rounds = std::mem::take(&mut *rounds.lock().unwrap());
    let rounds = rounds.into_iter().filter(|round| !round.is_empty()).collect();
    (rounds, last, engine.picture().unwrap())
}

fn budgets(requests_in_flight: usize) -> Budgets {
    Budgets {
        requests_in_flight,
        ..options((8, 8)).budgets
    }
}

/// Parents are asked for before their pages.
fn assert_order(rounds: &[Vec<Request>], index: &Index) {
    let mut asked = HashSet::new();
    for request in rounds.iter().flatten() {
        asked.insert(request.clone());
        if let Request::Page { archive, page } = request
            && let Some(tile) = index.pyramid.parent(page.tile)
        {
            let parent = PageId { tile, ..*page };
            let archive = archive.clone();
            let stored = index.page(parent).unwrap().length > 0;
            assert!(
                !stored
                    || asked.contains(&Request::Page {
                        archive,
                        page: parent
                    }),
                "{request} before its parent"
            );
        }
    }
}

#[test]
fn a_first_view_takes_the_round_trips_that_its_budgets_make_it_take() {
    let archive = Recipe {
        groups: 6,
        ..Default::default()
    }
    .build();
    let index = Index::parse(&open(&archive).prefix().unwrap()).unwrap();
    let (ample, settled, picture) = rounds(&archive, budgets(1000));
    assert!(settled.pages_resident > 30, "{settled:?}");
    assert_eq!(ample.len(), 2, "the index, and all the rest");
    assert_order(&ample, &index);
    let wanted = ample[1].len();
    let distinct: HashSet<&Request> = ample[1].iter().collect();
    assert_eq!(distinct.len(), wanted, "nothing is asked for twice");
    // Never more at once than the budgets say, and two round trips more than that allows at most.
    let (few, _, same) = rounds(&archive, budgets(8));
    assert!(few.iter().all(|round| round.len() <= 8));
    assert!(
        few.len() <= 1 + wanted.div_ceil(8) + 2,
        "{} for {wanted}",
        few.len()
    );
    assert_order(&few, &index);
    assert_eq!(
        few[1..].concat(),
        ample[1..].concat(),
        "what waits is sent in the order of now"
    );
    assert!(relative_rmse(&same, &picture) < 1e-4);
}
