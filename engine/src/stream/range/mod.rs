//! Archives on any static host, by ranges.
//!
//! No server of ours is needed: a web server, a bucket, whatever answers `Range`. The first 64 KiB of an archive hold its
//! index as a rule, and its coarsest pages; records follow, those that lie near each other in one range. The host's
//! ETag or date tells one version of a file from the next, so that bytes of two are never mixed.
//!
//! It does not ask again when something fails, and does not check hashes: [`super::RetriedSource`] does both.

mod fetch;
mod load;
mod plan;
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
    load::{Known, Loading, Next},
    plan::Wanted,
    trouble::Trouble,
};
use super::{
    Answer, Request, SourceStats, Ticket, TileSource,
    escape::escape,
    source::plain_name,
    transport::{Event, Get, GetId, Transport},
};
use crate::{Error, Result};

/// Requests in flight: enough to find neighbours among them.
const CAPACITY: usize = 128;
/// Ranges in flight, and so connections: as many as browsers open to one host.
const EXCHANGES: usize = 6;
/// Archives that are known at the same time.
const MAX_ARCHIVES: usize = 4096;
/// Beginnings of archives, and whole ones, that are kept in memory.
const MAX_HEAD_BYTES: usize = 512 << 20;

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

/// An archive, and who waits for its index.
#[derive(Default)]
struct Site {
    state: State,
    waiting: Vec<Ticket>,
    /// Bytes on the wire for the index.
    wire_bytes: u64,
}

#[derive(Default)]
enum State {
    #[default]
    Unknown,
    Queued,
    Loading(GetId, Loading),
    Known(Known),
    /// The host has another version than the one that was loaded.
    Changed(String),
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

    fn url(&self, archive: &str) -> String {
        format!("{}/{}.bsvtf", self.base, escape(archive))
    }

    /// Answers a request, unless it was given up.
    fn answer(&mut self, ticket: Ticket, bytes: Result<Bytes>, wire_bytes: u64) {
        self.anew.remove(&ticket);
        if let Some(request) = self.open.get(&ticket) {
            self.ready.push_back(Answer {
                ticket,
                request: request.clone(),
                bytes,
                wire_bytes,
            });
        }
    }

    fn fail(&mut self, ticket: Ticket, trouble: &Trouble, wire_bytes: u64) {
        let Some(request) = self.open.get(&ticket) else {
            return;
        };
        let error = trouble.error(request, &self.url(request.archive()));
        self.answer(ticket, Err(error), wire_bytes);
    }

    fn begin(&mut self, ticket: Ticket, request: &Request) -> Result<()> {
        let archive = request.archive();
        plain_name(archive)?;
        if self.sites.len() >= MAX_ARCHIVES && !self.sites.contains_key(archive) {
            return Err(Error::Source {
                what: request.to_string(),
                detail: format!("more than {MAX_ARCHIVES} archives from one host: use fewer materials"),
            });
        }
        let is_index = matches!(request, Request::Index { .. });
        let site = self.sites.entry(Arc::clone(archive)).or_default();
        match &site.state {
            State::Queued | State::Loading(..) => site.waiting.push(ticket),
            State::Known(_) if !is_index => self.plan(ticket, request),
            State::Changed(detail) if !is_index => {
                let trouble = Trouble::Changed(detail.clone());
                self.fail(ticket, &trouble, 0);
            }
            State::Unknown | State::Known(_) | State::Changed(_) => {
                site.state = State::Queued;
                site.waiting.push(ticket);
                // Other bytes may stand at these places in what is loaded now: they are found anew.
                let placed = self.wanted.extract_if(.., |wanted| wanted.archive == *archive);
                site.waiting.extend(placed.map(|wanted| wanted.ticket));
                self.to_load.push_back(Arc::clone(archive));
            }
        }
        Ok(())
    }

    /// Answers a record of a known archive at once, or lines it up.
    fn plan(&mut self, ticket: Ticket, request: &Request) {
        let Some(Site {
            state: State::Known(known),
            ..
        }) = self.sites.get(request.archive())
        else {
            return;
        };
        let (bytes, wire_bytes) = match request.record(&known.index) {
            Err(error) => (Err(error), 0),
            Ok(None) => return,
            Ok(Some(record)) => {
                let range = record.offset..record.offset + u64::from(record.length);
                let at_hand = known
                    .at_hand(&range)
                    .filter(|_| range.is_empty() || !self.anew.contains(&ticket));
                match at_hand {
                    Some(bytes) => {
                        self.stats.from_ram += 1;
                        self.stats.from_ram_bytes += bytes.len() as u64;
                        (Ok(bytes), 0)
                    }
                    None => {
                        self.wanted.push(Wanted {
                            ticket,
                            archive: Arc::clone(request.archive()),
                            range,
                        });
                        return;
                    }
                }
            }
        };
        self.answer(ticket, bytes, wire_bytes);
    }

    /// Sends what there is a connection for. Called when the caller looks, not when it asks, so that what was
    /// asked for in one go is seen together.
    fn send(&mut self) {
        while self.loads.len() + self.fetches.len() < EXCHANGES {
            if let Some(archive) = self.to_load.pop_front() {
                self.load(archive, Loading::new());
                continue;
            }
            let Some((range, records)) = plan::take(&mut self.wanted) else {
                return;
            };
            let anew = records.iter().any(|record| self.anew.contains(&record.ticket));
            let archive = Arc::clone(&records[0].archive);
            let Some(Site {
                state: State::Known(known),
                ..
            }) = self.sites.get(&archive)
            else {
                self.fail_records(records, &Trouble::passing("the archive is being loaded again"));
                continue;
            };
            let get = Get {
                url: self.url(&archive),
                range: Some(range.clone()),
                if_range: known.version.validator(),
                anew,
            };
            self.stats.requested += records.len() as u64;
            self.stats.exchanges += 1;
            if let Some(fetch) = Fetch::new(known.version.clone(), range, records) {
                let id = self.transport.start(get);
                self.fetches.insert(id, fetch);
            }
        }
    }

    fn load(&mut self, archive: Arc<str>, loading: Loading) {
        let url = self.url(&archive);
        let Some(site) = self.sites.get_mut(&archive) else {
            return;
        };
        let get = Get {
            url,
            range: Some(loading.asked.clone()),
            if_range: loading.validator(),
            anew: site.waiting.iter().any(|ticket| self.anew.contains(ticket)),
        };
        self.stats.requested += 1;
        self.stats.exchanges += 1;
        let id = self.transport.start(get);
        site.state = State::Loading(id, loading);
        self.loads.insert(id, archive);
    }

    /// An event of a GET that loads an index.
    fn loading(&mut self, id: GetId, archive: &Arc<str>, event: Event) {
        let Some(site) = self.sites.get_mut(archive) else {
            return;
        };
        let State::Loading(_, loading) = &mut site.state else {
            return;
        };
        let result = match event {
            Event::Head(head) => {
                site.wire_bytes += head.wire_bytes;
                self.stats.wire_bytes += head.wire_bytes;
                loading.head(&head).map(|()| None)
            }
            Event::Body(data) => {
                site.wire_bytes += data.len() as u64;
                self.stats.wire_bytes += data.len() as u64;
                loading.body(&data).map(|()| None)
            }
            Event::End => loading.end().map(Some),
            Event::Failed(detail) => Err(Trouble::passing(detail)),
        };
        match result {
            Ok(None) => {}
            Ok(Some(Next::Rest)) => {
                self.loads.remove(&id);
                if let State::Loading(_, loading) = std::mem::take(&mut site.state) {
                    self.load(Arc::clone(archive), loading);
                }
            }
            Ok(Some(Next::Done(known))) => {
                self.loads.remove(&id);
                self.loaded(archive, Ok(known));
            }
            Err(trouble) => {
                self.loads.remove(&id);
                self.transport.abort(id);
                self.loaded(archive, Err(trouble));
            }
        }
    }

    /// The end of loading an index: everybody who waits is told.
    fn loaded(&mut self, archive: &Arc<str>, mut result: std::result::Result<Known, Trouble>) {
        let kept: usize = self.sites.values().map(Site::head_bytes).sum();
        if let Ok(known) = &result
            && kept + known.head.len() > MAX_HEAD_BYTES
        {
            let detail = format!(
                "the host ignores ranges, and its archives are more than {} MiB together",
                MAX_HEAD_BYTES >> 20
            );
            result = Err(Trouble::Lasting(detail));
        }
        let Some(site) = self.sites.get_mut(archive) else {
            return;
        };
        let waiting = std::mem::take(&mut site.waiting);
        let mut wire_bytes = std::mem::take(&mut site.wire_bytes);
        let outcome = match result {
            Ok(known) => {
                let prefix = known.prefix();
                site.state = State::Known(known);
                Ok(prefix)
            }
            Err(trouble) => {
                site.state = State::Unknown;
                Err(match trouble {
                    Trouble::Changed(detail) => {
                        Trouble::passing(format!("the archive was replaced while it was loaded ({detail})"))
                    }
                    other => other,
                })
            }
        };
        for ticket in waiting {
            let Some(request) = self.open.get(&ticket).cloned() else {
                continue;
            };
            match (&outcome, &request) {
                (Ok(prefix), Request::Index { .. }) => {
                    self.answer(ticket, Ok(prefix.clone()), std::mem::take(&mut wire_bytes));
                }
                (Ok(_), _) => self.plan(ticket, &request),
                (Err(trouble), _) => self.fail(ticket, trouble, std::mem::take(&mut wire_bytes)),
            }
        }
    }

    /// An event of a GET of records.
    fn fetching(&mut self, id: GetId, event: Event) {
        let Some(mut fetch) = self.fetches.remove(&id) else {
            return;
        };
        let mut came = Vec::new();
        let result = match event {
            Event::Head(head) => {
                self.stats.wire_bytes += head.wire_bytes;
                fetch.head(&head).map(|()| false)
            }
            Event::Body(data) => {
                self.stats.wire_bytes += data.len() as u64;
                fetch.body(&data, |record| came.push(record))
            }
            Event::End => Err(fetch.short()),
            Event::Failed(detail) => Err(Trouble::passing(detail)),
        };
        for (record, bytes, wire_bytes) in came {
            self.answer(record.ticket, Ok(bytes), wire_bytes);
        }
        match result {
            Ok(false) => {
                self.fetches.insert(id, fetch);
            }
            // All have come: what may still follow is of no use.
            Ok(true) => self.transport.abort(id),
            Err(trouble) => {
                self.transport.abort(id);
                if matches!(trouble, Trouble::Changed(_)) {
                    self.changed(&fetch, &trouble);
                }
                self.fail_records(fetch.records, &trouble);
            }
        }
    }

    fn fail_records(&mut self, records: Vec<Wanted>, trouble: &Trouble) {
        for record in records {
            self.fail(record.ticket, trouble, 0);
        }
    }

    /// The host has another version than the one that `fetch` was of: nothing of the old one can be had.
    fn changed(&mut self, fetch: &Fetch, trouble: &Trouble) {
        let Some(site) = self.sites.get_mut(&fetch.archive) else {
            return;
        };
        let (State::Known(known), Trouble::Changed(detail)) = (&site.state, trouble) else {
            return;
        };
        if known.version != fetch.version {
            return; // It has been loaded again since.
        }
        site.state = State::Changed(detail.clone());
        let stale = self
            .wanted
            .extract_if(.., |wanted| wanted.archive == fetch.archive)
            .collect();
        self.fail_records(stale, trouble);
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

impl Site {
    fn head_bytes(&self) -> usize {
        match &self.state {
            State::Known(known) => known.head.len(),
            _ => 0,
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
