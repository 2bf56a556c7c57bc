//! Archives on any static host, by ranges.
//!
//! No server of ours is needed: a web server, a bucket, whatever answers `Range`. The first 64 KiB of an archive hold its
//! index as a rule, and its coarsest pages; records follow, those that lie near each other in one range. The host's
//! ETag or date tells one version of a file from the next, so that bytes of two are never mixed.
//!
//! It does not ask again when something fails, and does not check hashes: [`super::RetriedSource`] does both.
//!
//! `sites`: archives and their indices. `records`: what is asked of archives that are known.

mod fetch;
mod load;
mod plan;
mod records;
mod sites;
#[cfg(test)]
mod tests;
mod trouble;
mod version;

use std::{
    collections::{HashMap, HashSet, VecDeque},
    sync::Arc,
    time::Duration,
};

use bytes::Bytes;

use self::{
    fetch::Fetch,
    plan::Wanted,
    sites::{Site, State},
    trouble::Trouble,
};
use super::{
    Answer, Request, SourceStats, Ticket, TileSource,
    escape::escape,
    transport::{GetId, Transport},
};
use crate::Result;

/// Requests in flight: enough to find neighbours among them.
const CAPACITY: usize = 128;
/// Ranges in flight, and so connections: as many as browsers open to one host.
const EXCHANGES: usize = 6;

/// The archives of a folder on a web server: `BASE/NAME.bsvtf` is the archive NAME.
///
/// An archive's index fixes its version. When the host has another one, records of the old are refused with
/// an error that says so, until the index is asked for again.
///
/// [`Answer::wire_bytes`] counts a record's own bytes; for the last one of a range also the range's head, and what lay between
/// its records. Records that came with the index cost nothing.
pub struct RangeSource<T> {
    transport: T,
    base: String,
    /// What stands behind the `?` of every address, with it; nothing as a rule.
    query: String,
    next: u64,
    open: HashMap<Ticket, Request>,
    /// Those among them that are to pass caches.
    anew: HashSet<Ticket>,
    sites: HashMap<Arc<str>, Site>,
    /// Archives whose index is to be loaded.
    to_load: VecDeque<Arc<str>>,
    /// Records that are to be asked for, in the order in which they were submitted.
    wanted: Vec<Wanted>,
    loads: HashMap<GetId, Arc<str>>,
    fetches: HashMap<GetId, Fetch>,
    ready: VecDeque<Answer>,
    stats: SourceStats,
}

impl<T: Transport> RangeSource<T> {
    /// A source of the archives at `http://HOST[:PORT]/FOLDER`, or beside the archive at an address that ends in
    /// `.bsvtf`. Nothing is asked yet.
    pub fn new(transport: T, address: &str) -> Self {
        let address = address.trim();
        let folder = match address.rsplit_once('/') {
            Some((folder, file)) if file.to_ascii_lowercase().ends_with(".bsvtf") => folder,
            _ => address,
        };
        Self {
            transport,
            base: folder.trim_end_matches('/').to_owned(),
            query: String::new(),
            next: 0,
            open: HashMap::new(),
            anew: HashSet::new(),
            sites: HashMap::new(),
            to_load: VecDeque::new(),
            wanted: Vec::new(),
            loads: HashMap::new(),
            fetches: HashMap::new(),
            ready: VecDeque::new(),
            stats: SourceStats::default(),
        }
    }

    /// The same with a query that goes with every request, as that of a presigned address. No message and no name in a cache has it.
    #[must_use]
    pub fn with_query(mut self, query: Option<&str>) -> Self {
        self.query = query.map_or(String::new(), |query| format!("?{query}"));
        self
    }

    /// Where an archive is, as it may be told.
    fn place(&self, archive: &str) -> String {
        format!("{}/{}.bsvtf", self.base, escape(archive))
    }

    fn url(&self, archive: &str) -> String {
        self.place(archive) + &self.query
    }

    /// Answers a request, unless it was given up.
    fn answer(&mut self, ticket: Ticket, bytes: Result<Bytes>, wire_bytes: u64) {
        self.anew.remove(&ticket);
        if let Some(request) = self.open.get(&ticket) {
            self.ready.push_back(Answer {
                ticket,
                request: request.clone(),
                bytes,
                checked: false,
                wire_bytes,
            });
        }
    }

    fn fail(&mut self, ticket: Ticket, trouble: &Trouble, wire_bytes: u64) {
        let Some(request) = self.open.get(&ticket) else {
            return;
        };
        let error = trouble.error(request, &self.place(request.archive()));
        self.answer(ticket, Err(error), wire_bytes);
    }

    fn open_request(&mut self, request: Request, anew: bool) -> Option<Ticket> {
        if self.open.len() >= CAPACITY {
            return None;
        }
        let ticket = Ticket(self.next);
        self.next += 1;
        self.open.insert(ticket, request.clone());
        if anew {
            self.anew.insert(ticket);
        }
        if let Err(error) = self.begin(ticket, &request) {
            self.answer(ticket, Err(error), 0);
        }
        Some(ticket)
    }

    /// Takes what has come.
    fn collect(&mut self) {
        while let Some((id, event)) = self.transport.poll() {
            match self.loads.get(&id).cloned() {
                Some(archive) => self.loading(id, &archive, event),
                None => self.fetching(id, event),
            }
        }
    }
}

impl<T: Transport> TileSource for RangeSource<T> {
    fn capacity(&self) -> usize {
        CAPACITY
    }

    fn in_flight(&self) -> usize {
        self.open.len()
    }

    fn submit(&mut self, request: Request) -> Option<Ticket> {
        self.open_request(request, false)
    }

    fn submit_anew(&mut self, request: Request) -> Option<Ticket> {
        self.open_request(request, true)
    }

    fn cancel(&mut self, ticket: Ticket) {
        let Some(request) = self.open.remove(&ticket) else {
            return;
        };
        self.stats.cancelled += 1;
        self.anew.remove(&ticket);
        self.ready.retain(|answer| answer.ticket != ticket);
        if let Some(at) = self.wanted.iter().position(|wanted| wanted.ticket == ticket) {
            let range = self.wanted.remove(at).range;
            self.stats.cancelled_bytes_saved += range.end - range.start;
            return;
        }
        let fetch = self.fetches.iter_mut().find(|(_, fetch)| fetch.has(ticket));
        if let Some((&id, fetch)) = fetch {
            if fetch.give_up(ticket) {
                self.stats.cancelled_bytes_saved += fetch.left();
                self.fetches.remove(&id);
                self.transport.abort(id);
            }
            return;
        }
        let Some(site) = self.sites.get_mut(request.archive()) else {
            return;
        };
        let waited = site.waiting.len();
        site.waiting.retain(|waiting| *waiting != ticket);
        if site.waiting.len() < waited && site.waiting.is_empty() {
            // Nobody wants the index any more.
            match std::mem::take(&mut site.state) {
                State::Loading(id, _) => {
                    self.loads.remove(&id);
                    self.transport.abort(id);
                }
                _ => self.to_load.retain(|archive| archive != request.archive()),
            }
        }
    }

    fn poll(&mut self) -> Option<Answer> {
        self.collect();
        self.send();
        let answer = self.ready.pop_front()?;
        self.open.remove(&answer.ticket);
        Some(answer)
    }

    fn wait(&mut self, limit: Duration) {
        self.send();
        if self.ready.is_empty() && !self.open.is_empty() {
            self.transport.wait(limit);
        }
    }

    fn origin(&self) -> String {
        self.base.clone()
    }

    fn stats(&self) -> SourceStats {
        self.stats
    }
}
