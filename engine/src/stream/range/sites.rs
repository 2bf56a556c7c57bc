//! Archives on the host: their indices, and which version of them is meant.

use std::sync::Arc;

use super::{
    super::{
        Request, Ticket,
        source::plain_name,
        transport::{Event, Get, GetId, Transport},
    },
    RangeSource,
    fetch::Fetch,
    load::{Known, Loading, Next},
    trouble::Trouble,
};
use crate::{Error, Result};

/// Archives that are known at the same time.
const MAX_ARCHIVES: usize = 4096;
/// Beginnings of archives, and whole ones, that are kept in memory.
const MAX_HEAD_BYTES: usize = 512 << 20;

/// An archive, and who waits for its index.
#[derive(Default)]
pub(super) struct Site {
    pub(super) state: State,
    pub(super) waiting: Vec<Ticket>,
    /// Bytes on the wire for the index.
    wire_bytes: u64,
}

#[derive(Default)]
pub(super) enum State {
    #[default]
    Unknown,
    Queued,
    Loading(GetId, Loading),
    Known(Known),
    /// The host has another version than the one that was loaded.
    Changed(String),
}

impl Site {
    fn head_bytes(&self) -> usize {
        match &self.state {
            State::Known(known) => known.head.len(),
            _ => 0,
        }
    }
}

impl<T: Transport> RangeSource<T> {
    /// Takes a request: an index waits to be loaded, a record for its index.
    pub(super) fn begin(&mut self, ticket: Ticket, request: &Request) -> Result<()> {
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

    pub(super) fn load(&mut self, archive: Arc<str>, loading: Loading) {
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
    pub(super) fn loading(&mut self, id: GetId, archive: &Arc<str>, event: Event) {
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

    /// The host has another version than the one that `fetch` was of: nothing of the old one can be had.
    pub(super) fn changed(&mut self, fetch: &Fetch, trouble: &Trouble) {
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
}
