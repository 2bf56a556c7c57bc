//! An archive that is replaced while it is shown.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use engine::{
    Error,
    stream::{Answer, MemorySource, Request, Ticket, TileSource},
};

use super::*;
use crate::{material::weave, scene::still_life};

/// Has one version of an archive at a time, and refuses records of another than the one whose index it gave out last.
struct Host {
    versions: [MemorySource; 2],
    now: Arc<AtomicUsize>,
    given: usize,
    next: u64,
    ready: VecDeque<Answer>,
}

impl TileSource for Host {
    fn capacity(&self) -> usize {
        8
    }
    fn in_flight(&self) -> usize {
        self.ready.len()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.ready.len() >= self.capacity() {
            return None;
        }
        let now = self.now.load(Ordering::Relaxed);
        if let Request::Index { .. } = request {
            self.given = now;
        }
        self.next += 1;
        let ticket = Ticket(self.next);
        let refused = Answer {
            ticket,
            bytes: Err(Error::Changed {
                what: request.to_string(),
                detail: "the archive changed".into(),
            }),
            request: request.clone(),
            checked: false,
            wire_bytes: 0,
        };
        let answer = if self.given == now {
            self.versions[now].submit(request)?;
            Answer {
                ticket,
                ..self.versions[now].poll()?
            }
        } else {
            refused
        };
        self.ready.push_back(answer);
        Some(ticket)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.ready.retain(|answer| answer.ticket != ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        self.ready.pop_front()
    }
    fn wait(&mut self, _limit: Duration) {}
}

#[test]
fn a_new_version_is_shown_without_a_restart() {
    let [old, new] = [1, 2].map(|groups| {
        Recipe {
            groups,
            texture: weave,
            ..Default::default()
        }
        .build()
    });
    let (scene, far) = still_life();
    let near = Camera {
        eye: far.eye * 0.4 + far.target * 0.6,
        ..far
    };
    let mut whole = engine(&scene, &[("weave", &new)], options((160, 90)));
    settle(&mut whole, &near);
    for wait in [true, false] {
        let now = Arc::new(AtomicUsize::new(0));
        let host = Host {
            versions: [&old, &new].map(|archive| *source(&[("weave", archive)])),
            now: now.clone(),
            given: 0,
            next: 0,
            ready: VecDeque::new(),
        };
        let options = Options {
            wait,
            ..options((160, 90))
        };
        let mut engine = Engine::new(Context::headless().unwrap(), &scene, Box::new(host), options).unwrap();
        settle(&mut engine, &far);
        now.store(1, Ordering::Relaxed);
        let frames = engine.settle(&near, LIMIT).unwrap();
        let last = frames.last().unwrap();
        assert!(last.settled, "{last:?}");
        assert_eq!(
            (last.archives, last.archives_known, last.archives_failed),
            (1, 1, 0)
        );
        assert!(engine.problems().any(|problem| problem.contains("changed")));
        let error = relative_rmse(&engine.picture().unwrap(), &whole.picture().unwrap());
        assert!(error < 1e-4, "{error}");
        // And then it stands still.
        for _ in 0..5 {
            assert!(engine.frame(&near).unwrap().settled);
        }
    }
}
