//! Records of archives that are known: lined up, sent as ranges, handed out as they come.

use std::sync::Arc;

use super::{
    super::{
        Request, Ticket,
        transport::{Event, Get, GetId, Transport},
    },
    EXCHANGES, RangeSource,
    fetch::Fetch,
    load::Loading,
    plan::{self, Wanted},
    sites::{Site, State},
    trouble::Trouble,
};

impl<T: Transport> RangeSource<T> {
    /// Answers a record of a known archive at once, or lines it up.
    pub(super) fn plan(&mut self, ticket: Ticket, request: &Request) {
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
    pub(super) fn send(&mut self) {
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

    /// An event of a GET of records.
    pub(super) fn fetching(&mut self, id: GetId, event: Event) {
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

    pub(super) fn fail_records(&mut self, records: Vec<Wanted>, trouble: &Trouble) {
        for record in records {
            self.fail(record.ticket, trouble, 0);
        }
    }
}
