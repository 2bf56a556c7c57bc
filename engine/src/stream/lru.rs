//! Keeps compressed records in memory, so that a page which comes back into view does not cross the wire again.

use std::{collections::VecDeque, sync::Arc, time::Duration};

use ::lru::LruCache;
use bytes::Bytes;

use super::{Answer, Request, SourceStats, Ticket, TileSource, directories::Directories, room::Room};

/// What an entry of the cache costs beside its bytes: key, list links, hash table. Keeps the bound honest when
/// there are very many empty records.
const ENTRY_BYTES: u64 = 128;

/// Answers records from memory, with no bytes on the wire, and asks the inner source for the others. Evicts the
/// record that was used least recently.
///
/// Only what holds against its archive's directory is kept: damaged bytes are passed on for their error to be
/// found, and asked for anew next time. Indices are always asked for, because they tell whether an archive has
/// changed; if it has, its records are forgotten.
pub struct CachedSource<S> {
    inner: S,
    room: Room,
    records: LruCache<Request, Bytes>,
    directories: Directories,
    hits: VecDeque<(Ticket, Request, Bytes)>,
    next_hit: u64,
    from_ram: u64,
    from_ram_bytes: u64,
}

impl<S: TileSource> CachedSource<S> {
    /// Keeps up to `budget_bytes` of records of `inner`; 0 keeps nothing. The directories of the archives in use
    /// are kept besides.
    pub fn new(inner: S, budget_bytes: u64) -> Self {
        Self {
            inner,
            room: Room::new(budget_bytes),
            records: LruCache::unbounded(),
            directories: Directories::default(),
            from_ram: 0,
            from_ram_bytes: 0,
            hits: VecDeque::new(),
            next_hit: 0,
        }
    }

    /// Bytes that the kept records take, never more than the budget.
    pub fn used_bytes(&self) -> u64 {
        self.room.used_bytes()
    }

    /// The source behind the cache.
    pub fn inner_mut(&mut self) -> &mut S {
        &mut self.inner
    }

    /// Keeps what came back if it holds.
    fn keep(&mut self, request: &Request, bytes: &Bytes, checked: bool) {
        if let Request::Index { archive } = request {
            self.keep_index(archive, bytes);
            return;
        }
        let cost = cost(bytes);
        if !self.room.admits(cost) || !(checked || self.directories.holds(request, bytes)) {
            return;
        }
        // A copy, where the bytes are a part of something larger that would be kept alive with them.
        if let Some(old) = self.records.put(request.clone(), Bytes::copy_from_slice(bytes)) {
            self.room.give_back(self::cost(&old));
        }
        self.room.take(cost);
        while self.room.is_over() {
            let Some((_, evicted)) = self.records.pop_lru() else {
                break;
            };
            self.room.give_back(self::cost(&evicted));
        }
    }

    fn keep_index(&mut self, archive: &Arc<str>, prefix: &Bytes) {
        let before = self.directories.get(archive).map(|index| index.id);
        let Ok(index) = self.directories.learn(archive, prefix) else {
            return;
        };
        if before == Some(index.id) {
            return;
        }
        let stale: Vec<Request> = self
            .records
            .iter()
            .map(|(request, _)| request)
            .filter(|r| r.archive() == archive)
            .cloned()
            .collect();
        for request in stale {
            if let Some(bytes) = self.records.pop(&request) {
                self.room.give_back(cost(&bytes));
            }
        }
    }
}

fn cost(bytes: &Bytes) -> u64 {
    bytes.len() as u64 + ENTRY_BYTES
}

/// Tickets of the inner source become even, those of hits are odd: no table of them is needed.
fn outer(inner: Ticket) -> Ticket {
    Ticket(inner.0 * 2)
}

impl<S: TileSource> TileSource for CachedSource<S> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.inner.in_flight() + self.hits.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let Some(bytes) = self.records.get(&request) else {
            return self.inner.submit(request).map(outer);
        };
        let ticket = Ticket(self.next_hit * 2 + 1);
        self.next_hit += 1;
        self.from_ram += 1;
        self.from_ram_bytes += bytes.len() as u64;
        self.hits.push_back((ticket, request, bytes.clone()));
        Some(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if ticket.0.is_multiple_of(2) {
            self.inner.cancel(Ticket(ticket.0 / 2));
        } else {
            self.hits.retain(|(hit, ..)| *hit != ticket);
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        if let Some((ticket, request, bytes)) = self.hits.pop_front() {
            return Some(Answer {
                ticket,
                request,
                bytes: Ok(bytes),
                checked: true,
                wire_bytes: 0,
            });
        }
        let mut answer = self.inner.poll()?;
        if let Ok(bytes) = &answer.bytes {
            self.keep(&answer.request, bytes, answer.checked);
        }
        answer.ticket = outer(answer.ticket);
        Some(answer)
    }

    fn wait(&mut self, limit: Duration) {
        if self.hits.is_empty() {
            self.inner.wait(limit);
        }
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        self.inner.submit_anew(request).map(outer)
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    fn stats(&self) -> SourceStats {
        let stats = self.inner.stats();
        SourceStats {
            from_ram: stats.from_ram + self.from_ram,
            from_ram_bytes: stats.from_ram_bytes + self.from_ram_bytes,
            ..stats
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{
            Faults, FaultySource, MemorySource,
            conformance::{Fixture, archive, fetch},
        },
        *,
    };

    fn wire_bytes(answers: &[Answer]) -> u64 {
        answers.iter().map(|answer| answer.wire_bytes).sum()
    }

    #[test]
    fn what_was_there_does_not_cross_the_wire_again() {
        let requests = Fixture::get().requests();
        let mut source = CachedSource::new(Fixture::get().memory(), 1 << 20);
        let first = wire_bytes(&fetch(&mut source, &requests));
        let indices = requests
            .iter()
            .filter(|request| matches!(request, Request::Index { .. }));
        let index_bytes: usize = indices
            .map(|request| Fixture::get().expected(request).len())
            .sum();
        assert_eq!(wire_bytes(&fetch(&mut source, &requests)), index_bytes as u64);
        assert!(
            first > 2 * index_bytes as u64,
            "{first} bytes, {index_bytes} of them indices"
        );
    }

    #[test]
    fn the_budget_holds_and_the_oldest_goes() {
        let requests = Fixture::get().requests();
        for budget in (0..3000).step_by(100) {
            let mut source = CachedSource::new(Fixture::get().memory(), budget);
            for request in &requests {
                fetch(&mut source, std::slice::from_ref(request));
                let counted: u64 = source.records.iter().map(|(_, bytes)| cost(bytes)).sum();
                assert_eq!(source.used_bytes(), counted);
                assert!(counted <= budget, "{counted} of {budget}");
            }
            if budget > 1000 {
                let last = std::slice::from_ref(requests.last().unwrap());
                assert_eq!(
                    wire_bytes(&fetch(&mut source, last)),
                    0,
                    "the newest record is there"
                );
                assert!(
                    wire_bytes(&fetch(&mut source, &requests[1..2])) > 0,
                    "the oldest is not"
                );
            }
        }
    }

    #[test]
    fn damaged_records_are_not_kept() {
        let requests = Fixture::get().requests();
        let faulty = FaultySource::new(Fixture::get().memory(), Faults::default(), 1);
        let mut source = CachedSource::new(faulty, 1 << 20);
        fetch(&mut source, &requests[..1]);
        source.inner_mut().set_faults(Faults {
            damage: 1.0,
            ..Faults::default()
        });
        let column = &requests[1..2];
        assert_ne!(
            fetch(&mut source, column)[0].bytes.as_ref().unwrap(),
            &Fixture::get().expected(&column[0])
        );
        source.inner_mut().set_faults(Faults::default());
        assert_eq!(
            fetch(&mut source, column)[0].bytes.as_ref().unwrap(),
            &Fixture::get().expected(&column[0])
        );
        assert_eq!(wire_bytes(&fetch(&mut source, column)), 0);
    }

    #[test]
    fn records_of_a_replaced_archive_are_forgotten() {
        let mut memory = MemorySource::new();
        memory.insert("cloth", archive(1)).unwrap();
        let mut source = CachedSource::new(memory, 1 << 20);
        let requests = [
            Request::Index {
                archive: "cloth".into(),
            },
            Request::Column {
                archive: "cloth".into(),
                group: 0,
            },
        ];
        let old = fetch(&mut source, &requests)[1].bytes.as_ref().unwrap().clone();
        source.inner_mut().insert("cloth", archive(2)).unwrap();
        fetch(&mut source, &requests[..1]);
        let new = &fetch(&mut source, &requests[1..])[0];
        assert_ne!(new.bytes.as_ref().unwrap(), &old);
        assert!(new.wire_bytes > 0);
        assert_eq!(source.used_bytes(), new.wire_bytes + ENTRY_BYTES);
    }
}
