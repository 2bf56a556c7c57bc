//! Keeps records for the next visit, and for when there is no network, in a store that answers later.
//!
//! As [`engine::stream`]'s cache on disk, but for browsers, whose databases nobody can wait for. Records are kept by content: the identity
//! of their archive and which record of it they are. Indices are always asked for, because they tell whether an archive has changed; only
//! if the source cannot be reached, the last one that came from there is taken.

#[cfg(test)]
mod tests;

use std::{
    collections::{HashMap, VecDeque},
    sync::Arc,
    time::Duration,
};

use bytes::Bytes;
use engine::{
    Error,
    stream::{Answer, Request, SourceStats, Ticket, TileSource, parse_shared},
};
use tileset::archive::{Index, Record};

/// A store of bytes by key that answers later. Whoever implements it bounds what it keeps; failing is forgetting.
pub trait Store {
    /// Whether there is something under a key, as far as is known.
    fn holds(&self, key: &str) -> bool;
    /// Asks for what is under a key; [`Store::poll`] gives it, with this number.
    fn get(&mut self, number: u64, key: &str);
    /// The next answer that is there: `None` for what was not.
    fn poll(&mut self) -> Option<(u64, Option<Bytes>)>;
    /// Keeps bytes under a key.
    fn put(&mut self, key: &str, bytes: &Bytes);
    /// Forgets what is under a key.
    fn remove(&mut self, key: &str);
}

/// Answers records from a [`Store`], and asks the inner source for the others.
pub struct KeptSource<S, K> {
    inner: S,
    store: K,
    indices: HashMap<Arc<str>, Arc<Index>>,
    open: HashMap<Ticket, Open>,
    /// Requests that the inner source has, by its tickets.
    sent: HashMap<Ticket, Ticket>,
    /// Requests that the store could not answer after all, and that the inner source has no room for yet.
    late: VecDeque<Ticket>,
    next: u64,
    stats: SourceStats,
}

struct Open {
    request: Request,
    /// Why the source gave no index: what is answered if the store has none either.
    failure: Option<Error>,
}

impl<S: TileSource, K: Store> KeptSource<S, K> {
    /// Keeps records of `inner` in `store`, and finds those that are there.
    pub fn new(inner: S, store: K) -> Self {
        Self {
            inner,
            store,
            indices: HashMap::new(),
            open: HashMap::new(),
            sent: HashMap::new(),
            late: VecDeque::new(),
            next: 0,
            stats: SourceStats::default(),
        }
    }

    /// Where a record is kept, and what the directory says of it; `None` for indices, and where none is known.
    fn place(&self, request: &Request) -> Option<(String, &Index, Record)> {
        let index = self.indices.get(request.archive())?;
        let record = request.record(index).ok()??;
        let id = index.id;
        let key = match request {
            Request::Index { .. } => return None,
            Request::Page { page, .. } => {
                let tileset::Tile { mip, x, y } = page.tile;
                format!("{id:032x}/p{}.{mip}.{x}.{y}", page.group)
            }
            Request::Column { group, .. } => format!("{id:032x}/c{group}"),
        };
        (record.length > 0).then_some((key, index, record))
    }

    /// Where the last index that came from the source is kept.
    fn index_key(&self, archive: &str) -> String {
        format!("index {} {archive}", self.inner.origin())
    }

    fn begin(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        if self.in_flight() >= self.capacity() {
            return None;
        }
        let ticket = Ticket(self.next);
        let held = self.place(&request).filter(|(key, ..)| self.store.holds(key));
        match held.filter(|_| !anew).map(|(key, ..)| key) {
            Some(key) => self.store.get(ticket.0, &key),
            None => {
                let sent = match anew {
                    true => self.inner.submit_anew(request.clone()),
                    false => self.inner.submit(request.clone()),
                }?;
                self.sent.insert(sent, ticket);
            }
        }
        self.next += 1;
        let open = Open {
            request,
            failure: None,
        };
        self.open.insert(ticket, open);
        Some(ticket)
    }

    /// Hands what the store did not have to the source, as far as it takes it.
    fn send_late(&mut self) {
        while let Some(ticket) = self.late.front().copied() {
            if let Some(open) = self.open.get(&ticket) {
                let Some(sent) = self.inner.submit(open.request.clone()) else {
                    return;
                };
                self.sent.insert(sent, ticket);
            }
            self.late.pop_front();
        }
    }

    /// An answer of the store.
    fn found(&mut self, ticket: Ticket, bytes: Option<Bytes>) -> Option<Answer> {
        let open = self.open.get_mut(&ticket)?;
        let request = open.request.clone();
        let failure = open.failure.take();
        let bytes = match (&request, failure) {
            (Request::Index { archive }, failure) => {
                let held = bytes.filter(|bytes| self.learn(archive, bytes));
                self.stats.offline += u64::from(held.is_some());
                let missing = || failure.unwrap_or_else(|| Error::NotFound(request.to_string()));
                held.ok_or_else(missing)
            }
            _ => match bytes.filter(|bytes| self.is_whole(&request, bytes)) {
                Some(bytes) => {
                    self.stats.from_disk += 1;
                    self.stats.from_disk_bytes += bytes.len() as u64;
                    Ok(bytes)
                }
                None => {
                    if let Some((key, ..)) = self.place(&request) {
                        self.store.remove(&key);
                    }
                    self.late.push_back(ticket);
                    return None;
                }
            },
        };
        self.open.remove(&ticket);
        Some(Answer {
            ticket,
            request,
            bytes,
            checked: true,
            wire_bytes: 0,
        })
    }

    /// An answer of the source.
    fn came(&mut self, mut answer: Answer) -> Option<Answer> {
        let ticket = self.sent.remove(&answer.ticket)?;
        answer.ticket = ticket;
        match (&answer.request, &answer.bytes) {
            (Request::Index { archive }, Ok(bytes)) => {
                if self.learn(archive, bytes) {
                    let key = self.index_key(archive);
                    self.store.put(&key, bytes);
                }
            }
            (request, Ok(bytes)) => {
                if self.is_whole(request, bytes)
                    && let Some((key, ..)) = self.place(request)
                {
                    self.store.put(&key, bytes);
                }
            }
            (Request::Index { archive }, Err(Error::Unavailable { .. })) => {
                let key = self.index_key(archive);
                self.open.get_mut(&ticket)?.failure = answer.bytes.err();
                self.store.get(ticket.0, &key);
                return None;
            }
            (_, Err(_)) => {}
        }
        self.open.remove(&ticket)?;
        Some(answer)
    }

    /// Takes an index, if it is one.
    fn learn(&mut self, archive: &Arc<str>, bytes: &Bytes) -> bool {
        let index = parse_shared(bytes).ok();
        let is_one = index.is_some();
        self.indices
            .extend(index.map(|index| (Arc::clone(archive), index)));
        is_one
    }

    fn is_whole(&self, request: &Request, bytes: &Bytes) -> bool {
        self.place(request)
            .is_some_and(|(key, index, record)| index.verify(&key, record, bytes).is_ok())
    }
}

impl<S: TileSource, K: Store> TileSource for KeptSource<S, K> {
    fn capacity(&self) -> usize {
        self.inner.capacity()
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.begin(request, false)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.begin(request, true)
    }

    fn cancel(&mut self, ticket: Ticket) {
        if self.open.remove(&ticket).is_none() {
            return;
        }
        let sent = self.sent.iter().find(|(_, outer)| **outer == ticket);
        if let Some(sent) = sent.map(|(sent, _)| *sent) {
            self.sent.remove(&sent);
            self.inner.cancel(sent);
        }
        self.late.retain(|late| *late != ticket);
    }

    fn poll(&mut self) -> Option<Answer> {
        self.send_late();
        while let Some((number, bytes)) = self.store.poll() {
            if let Some(answer) = self.found(Ticket(number), bytes) {
                return Some(answer);
            }
        }
        self.send_late();
        while let Some(answer) = self.inner.poll() {
            if let Some(answer) = self.came(answer) {
                return Some(answer);
            }
        }
        None
    }

    fn wait(&mut self, limit: Duration) {
        self.inner.wait(limit);
    }

    fn origin(&self) -> String {
        self.inner.origin()
    }

    fn stats(&self) -> SourceStats {
        let stats = self.inner.stats();
        SourceStats {
            from_disk: stats.from_disk + self.stats.from_disk,
            from_disk_bytes: stats.from_disk_bytes + self.stats.from_disk_bytes,
            offline: stats.offline + self.stats.offline,
            ..stats
        }
    }
}
