//! The source of the engine: a network before a source that fails, and a count of what is in flight.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;
use std::time::Duration;

use engine::stream::{Answer, Faults, FaultySource, MemorySource, Network, Request, Ticket, TileSource};
use tileset::Archive;
use tileset::archive::Index;

use crate::stream::Line;
use crate::{Error, Result};

#[derive(Default)]
struct Flying {
    open: HashMap<Ticket, u64>,
    most_bytes: u64,
    most_requests: usize,
    largest: u64,
}

/// One for the engine, one for who looks at it.
#[derive(Clone)]
pub(super) struct Watched {
    line: Line,
    /// Its faults change while the network has it.
    faulty: Rc<RefCell<FaultySource<MemorySource>>>,
    indices: Rc<HashMap<String, Index>>,
    flying: Rc<RefCell<Flying>>,
}

/// What was in flight at most.
pub(super) struct MostInFlight {
    pub(super) bytes: u64,
    pub(super) requests: usize,
    /// The largest single record.
    pub(super) largest: u64,
}

impl Watched {
    pub(super) fn new(archives: &[(String, Vec<u8>)], network: Network, seed: u64) -> Result<Self> {
        let mut memory = MemorySource::new();
        let mut indices = HashMap::new();
        for (name, bytes) in archives {
            memory.insert(name, bytes.clone())?;
            let opened = Archive::open(bytes.clone()).map_err(Error::archive(name.as_ref()))?;
            indices.insert(name.clone(), opened.index);
        }
        let faulty = FaultySource::new(memory, Faults::default(), seed);
        let faulty = Rc::new(RefCell::new(faulty));
        Ok(Self {
            line: Line::new(Box::new(faulty.clone()), network),
            faulty,
            indices: Rc::new(indices),
            flying: Rc::default(),
        })
    }

    pub(super) fn set_faults(&self, faults: Faults) {
        self.faulty.borrow_mut().set_faults(faults);
    }

    pub(super) fn advance(&self, time: Duration) {
        self.line.advance(time);
        self.line.forget();
    }

    /// Since the last call.
    pub(super) fn most_in_flight(&self) -> MostInFlight {
        let mut flying = self.flying.borrow_mut();
        let most = MostInFlight {
            bytes: flying.most_bytes,
            requests: flying.most_requests,
            largest: flying.largest,
        };
        (flying.most_bytes, flying.most_requests) = (flying.open.values().sum(), flying.open.len());
        most
    }

    fn length(&self, request: &Request) -> u64 {
        let index = self.indices.get(&**request.archive());
        let record = index.and_then(|index| request.record(index).ok().flatten());
        record.map_or(0, |record| record.length.into())
    }

    fn took(&self, ticket: Option<Ticket>, length: u64) -> Option<Ticket> {
        let mut flying = self.flying.borrow_mut();
        flying.open.insert(ticket?, length);
        flying.largest = flying.largest.max(length);
        flying.most_bytes = flying.most_bytes.max(flying.open.values().sum());
        flying.most_requests = flying.most_requests.max(flying.open.len());
        ticket
    }
}

impl TileSource for Watched {
    fn capacity(&self) -> usize {
        self.line.capacity()
    }
    fn in_flight(&self) -> usize {
        self.line.in_flight()
    }
    fn submit(&mut self, request: Request) -> Option<Ticket> {
        let length = self.length(&request);
        let ticket = self.line.submit(request);
        self.took(ticket, length)
    }
    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        let length = self.length(&request);
        let ticket = self.line.submit_anew(request);
        self.took(ticket, length)
    }
    fn cancel(&mut self, ticket: Ticket) {
        self.flying.borrow_mut().open.remove(&ticket);
        self.line.cancel(ticket);
    }
    fn poll(&mut self) -> Option<Answer> {
        let answer = self.line.poll()?;
        self.flying.borrow_mut().open.remove(&answer.ticket);
        Some(answer)
    }
    fn wait(&mut self, limit: Duration) {
        self.line.wait(limit);
    }
}
