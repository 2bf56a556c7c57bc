//! Records on their way: from a plan to decoded pages and columns.
//!
//! An item is in one place at a time: `queue` (to be submitted), `tickets` (in flight), `pending` (here, waiting to be
//! decoded). What residency asked for is in `wanted` until it is handed out; ancestors that the host has dropped
//! travel the same way without being wanted.

use std::collections::{HashMap, HashSet, VecDeque};

use bytes::Bytes;
use tileset::{Page, Record, archive::Index};

use super::{problems::Problems, stats::Counters};
use crate::{
    Result,
    decode::{Decoded, HostStore, Pending, Step, decode},
    gpu::materials::Btf,
    residency::{Item, MaterialId, Plan},
    stream::{Answer, Request, Ticket, TileSource},
};

/// How often a record is asked for again when it does not match the directory.
const ATTEMPTS: u32 = 3;

/// Records between source and decoder.
pub(super) struct Records {
    store: HostStore,
    queue: VecDeque<Item>,
    tickets: HashMap<Ticket, Item>,
    flying: HashMap<Item, Ticket>,
    wanted: HashSet<Item>,
    pending: VecDeque<Waiting>,
    damaged: HashMap<Item, u32>,
    failed: Vec<Item>,
}

struct Waiting {
    pending: Pending,
    /// The ancestor whose record is missing.
    needs: Option<Item>,
}

impl Records {
    pub(super) fn new(host_bytes: u64) -> Self {
        Self {
            store: HostStore::new(host_bytes),
            queue: VecDeque::new(),
            tickets: HashMap::new(),
            flying: HashMap::new(),
            wanted: HashSet::new(),
            pending: VecDeque::new(),
            damaged: HashMap::new(),
            failed: Vec::new(),
        }
    }

    /// Starts what a plan asks for and gives up what it cancels.
    pub(super) fn follow(
        &mut self,
        plan: &Plan,
        btfs: &[Btf],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        for &item in &plan.cancel {
            if self.wanted.remove(&item) {
                counters.requests_cancelled += 1;
                self.queue.retain(|&queued| queued != item);
                self.pending.retain(|waiting| waiting.pending.item != item);
                let needed = self.pending.iter().any(|waiting| waiting.needs == Some(item));
                if let Some(ticket) = self.flying.get(&item).copied().filter(|_| !needed) {
                    source.cancel(ticket);
                    self.land(ticket);
                }
            }
        }
        for &item in &plan.request {
            if !self.wanted.insert(item) {
                continue;
            }
            let stored = self.store.record(item);
            if record_of(item, btfs).is_ok_and(|record| record.length == 0) {
                counters.pages_not_stored += 1;
                self.pending.push_back(Waiting {
                    pending: Pending::new(item, Bytes::new()),
                    needs: None,
                });
            } else if let Some(record) = stored {
                counters.records_from_host += 1;
                self.pending.push_back(Waiting {
                    pending: Pending::new(item, record),
                    needs: None,
                });
            } else if !self.flying.contains_key(&item) {
                self.queue.push_back(item);
            }
        }
    }

    /// Submits what waits, as far as the source takes it.
    pub(super) fn submit(&mut self, btfs: &[Btf], source: &mut dyn TileSource) {
        while let Some(&item) = self.queue.front() {
            let Some(ticket) = source.submit(request(item, btfs)) else {
                break;
            };
            self.queue.pop_front();
            self.tickets.insert(ticket, item);
            self.flying.insert(item, ticket);
        }
    }

    fn land(&mut self, ticket: Ticket) -> Option<Item> {
        let item = self.tickets.remove(&ticket)?;
        self.flying.remove(&item);
        Some(item)
    }

    /// Takes an answer about a record. Those that nobody waits for change nothing.
    pub(super) fn receive(
        &mut self,
        answer: Answer,
        btfs: &[Btf],
        counters: &mut Counters,
        problems: &mut Problems,
    ) {
        let Some(item) = self.land(answer.ticket) else {
            return;
        };
        let bytes = match answer.bytes {
            Ok(bytes) => bytes,
            Err(error) => {
                counters.requests_failed += 1;
                problems.add(format!("{}: {error}", name(item, btfs)));
                return self.give_up(item);
            }
        };
        let what = name(item, btfs);
        let checked =
            record_of(item, btfs).and_then(|record| Ok(index_of(item, btfs).verify(&what, record, &bytes)?));
        if let Err(error) = checked {
            counters.records_damaged += 1;
            let attempts = self.damaged.entry(item).or_default();
            *attempts += 1;
            if *attempts < ATTEMPTS {
                return self.queue.push_front(item);
            }
            problems.add(format!("{what}: damaged {attempts} times in a row: {error}"));
            return self.give_up(item);
        }
        self.damaged.remove(&item);
        self.store.put_record(item, bytes.clone());
        if self.wanted.contains(&item) {
            self.pending.push_back(Waiting {
                pending: Pending::new(item, bytes),
                needs: None,
            });
        }
        // At once, before the store has to let the record go again.
        for at in 0..self.pending.len() {
            if self.pending[at].needs == Some(item) {
                self.pending[at].needs = None;
                self.step(at, btfs, counters, problems);
            }
        }
        self.reserve();
    }

    /// An item cannot be had: neither can what waits for it.
    fn give_up(&mut self, item: Item) {
        self.damaged.remove(&item);
        let lost: Vec<_> = self
            .pending
            .iter()
            .filter(|waiting| waiting.needs == Some(item))
            .collect();
        let lost: Vec<_> = lost
            .iter()
            .map(|waiting| waiting.pending.item)
            .chain([item])
            .collect();
        self.pending.retain(|waiting| waiting.needs != Some(item));
        self.failed
            .extend(lost.into_iter().filter(|item| self.wanted.remove(item)));
    }

    /// The parent of a pending page, if it can be had now; asks for what is missing otherwise.
    fn step(&mut self, at: usize, btfs: &[Btf], counters: &mut Counters, problems: &mut Problems) -> Parent {
        let waiting = &mut self.pending[at];
        match waiting
            .pending
            .step(index_of(waiting.pending.item, btfs), &mut self.store)
        {
            Ok(Step::Ready(parent)) => Parent::Ready(parent),
            Ok(Step::Needs(ancestor)) => {
                let ancestor = Item::Page(material_of(waiting.pending.item), ancestor);
                waiting.needs = Some(ancestor);
                if !self.flying.contains_key(&ancestor) && !self.queue.contains(&ancestor) {
                    counters.ancestors_again += 1;
                    self.queue.push_front(ancestor);
                }
                Parent::Missing
            }
            Err(error) => {
                problems.add(format!("{}: {error}", name(waiting.pending.item, btfs)));
                Parent::Broken
            }
        }
    }

    /// Decodes up to `limit` records that are here, in the order of their arrival.
    pub(super) fn decode(
        &mut self,
        limit: usize,
        btfs: &[Btf],
        counters: &mut Counters,
        problems: &mut Problems,
    ) -> Vec<(Item, Decoded)> {
        let mut batch = Vec::new();
        let mut at = 0;
        while at < self.pending.len() && batch.len() < limit {
            if self.pending[at].needs.is_some() {
                at += 1;
                continue;
            }
            match self.step(at, btfs, counters, problems) {
                Parent::Missing => at += 1,
                Parent::Ready(parent) => {
                    batch.extend(self.pending.remove(at).map(|waiting| (waiting.pending, parent)))
                }
                Parent::Broken => {
                    let broken = self.pending.remove(at).map(|waiting| waiting.pending.item);
                    self.failed.extend(broken.filter(|item| self.wanted.remove(item)));
                }
            }
        }
        let mut done = Vec::with_capacity(batch.len());
        for (item, result) in decode_all(&batch, btfs) {
            match result {
                Ok(decoded) => {
                    if let (Item::Page(material, page), Decoded::Page(texels)) = (item, &decoded)
                        && page.tile.mip > 0
                    {
                        self.store.put_page(material, page, texels.clone());
                    }
                    self.wanted.remove(&item);
                    done.push((item, decoded));
                }
                Err(error) => {
                    problems.add(format!("{}: {error}", name(item, btfs)));
                    self.give_up(item);
                }
            }
        }
        self.reserve();
        done
    }

    /// Items that could not be had since the last call.
    pub(super) fn take_failed(&mut self) -> Vec<Item> {
        std::mem::take(&mut self.failed)
    }

    /// Nothing is queued, in flight or waiting.
    pub(super) fn idle(&self) -> bool {
        self.queue.is_empty() && self.tickets.is_empty() && self.pending.is_empty()
    }

    /// Bytes held on the host.
    pub(super) fn bytes(&self) -> u64 {
        self.store.bytes() + self.pending_bytes()
    }

    fn pending_bytes(&self) -> u64 {
        self.pending.iter().map(|waiting| waiting.pending.bytes()).sum()
    }

    /// What waits counts against the budget of the store.
    fn reserve(&mut self) {
        self.store.reserve(self.pending_bytes());
    }
}

enum Parent {
    Ready(Option<std::sync::Arc<Page>>),
    Missing,
    Broken,
}

type Batch = [(Pending, Option<std::sync::Arc<Page>>)];

fn decode_one(
    (pending, parent): &(Pending, Option<std::sync::Arc<Page>>),
    btfs: &[Btf],
) -> (Item, Result<Decoded>) {
    (
        pending.item,
        decode(index_of(pending.item, btfs), pending, parent.as_deref()),
    )
}

#[cfg(not(target_arch = "wasm32"))]
fn decode_all(batch: &Batch, btfs: &[Btf]) -> Vec<(Item, Result<Decoded>)> {
    use rayon::prelude::*;
    batch.par_iter().map(|one| decode_one(one, btfs)).collect()
}

#[cfg(target_arch = "wasm32")]
fn decode_all(batch: &Batch, btfs: &[Btf]) -> Vec<(Item, Result<Decoded>)> {
    batch.iter().map(|one| decode_one(one, btfs)).collect()
}

fn material_of(item: Item) -> MaterialId {
    let (Item::Page(material, _) | Item::Column(material, _)) = item;
    material
}

fn index_of(item: Item, btfs: &[Btf]) -> &Index {
    &btfs[usize::from(material_of(item).0)].index
}

fn record_of(item: Item, btfs: &[Btf]) -> Result<Record> {
    Ok(match item {
        Item::Page(_, page) => index_of(item, btfs).page(page)?,
        Item::Column(_, group) => index_of(item, btfs).column(group)?,
    })
}

fn request(item: Item, btfs: &[Btf]) -> Request {
    let archive = btfs[usize::from(material_of(item).0)].archive.clone();
    match item {
        Item::Page(_, page) => Request::Page { archive, page },
        Item::Column(_, group) => Request::Column { archive, group },
    }
}

fn name(item: Item, btfs: &[Btf]) -> String {
    let archive = &btfs[usize::from(material_of(item).0)].archive;
    match item {
        Item::Page(_, page) => format!("{archive} {page}"),
        Item::Column(_, group) => format!("{archive} column of group {group}"),
    }
}
