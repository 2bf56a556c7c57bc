//! Records on their way: from a plan to decoded pages and columns.
//!
//! An item is in one place at a time: `queue` (to be submitted), `tickets` (in flight), `pending` (here, waiting to be
//! decoded), [`Decoding`] (with the workers, or decoded and not handed out yet). What residency asked for is in `wanted`
//! until it is handed out; ancestors that the host has dropped travel the same way without being wanted.
//!
//! What residency will ask for next is fetched early: its record waits in the store until then. Early records take what
//! the wanted ones leave of requests and bytes in flight, give way to them, and are given up in the frame in which residency
//! names them no more.

use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::sync::Arc;

use bytes::Bytes;
use tileset::{Page, PageId, Record};

use super::{decoding::Decoding, options::Budgets, problems::Problems, stats::Counters, workers::Workers};
use crate::{
    Error, Result,
    decode::{Decoded, Done, HostStore, Pending, Step, alone},
    gpu::materials::Btf,
    residency::{Item, MaterialId, Plan},
    stream::{Answer, Request, Ticket, TileSource},
};

/// How often a record is asked for again when it does not match the directory.
const ATTEMPTS: u32 = 3;

/// Least share of the newest record in the latency: after the first ones some thirty count.
const LATENCY_SHARE: f64 = 1.0 / 32.0;

/// Records between source and caches.
pub(super) struct Records {
    store: HostStore,
    queue: VecDeque<Item>,
    /// The order in which residency would have records fetched, of items that it has asked for or will.
    order: HashMap<Item, usize>,
    /// Items in `order` whose records came early, or could not be had: once is enough.
    early: HashSet<Item>,
    tickets: HashMap<Ticket, Item>,
    flying: HashMap<Item, Ticket>,
    bytes_in_flight: u64,
    /// With the time in seconds at which each was asked for.
    wanted: HashMap<Item, f64>,
    /// Seconds from there until it was decoded, of late.
    latency: f64,
    /// Records of which that is known.
    timed: f64,
    pending: VecDeque<Waiting>,
    decoding: Decoding,
    damaged: HashMap<Item, u32>,
    failed: Vec<Item>,
    /// Materials whose archives the source has in another version.
    changed: BTreeSet<MaterialId>,
    budgets: Budgets,
    /// The GPU decodes pages, as far as it can.
    on_gpu: bool,
}

struct Waiting {
    pending: Pending,
    /// The ancestor whose record is missing.
    needs: Option<Item>,
}

impl Records {
    /// `on_gpu`: the GPU decodes pages, as far as it can.
    pub(super) fn new(budgets: Budgets, workers: Workers<(u64, Done)>, on_gpu: bool) -> Self {
        Self {
            store: HostStore::new(budgets.host_bytes),
            queue: VecDeque::new(),
            order: HashMap::new(),
            early: HashSet::new(),
            tickets: HashMap::new(),
            flying: HashMap::new(),
            bytes_in_flight: 0,
            wanted: HashMap::new(),
            latency: 0.0,
            timed: 0.0,
            pending: VecDeque::new(),
            decoding: Decoding::new(workers),
            damaged: HashMap::new(),
            failed: Vec::new(),
            changed: BTreeSet::new(),
            budgets,
            on_gpu,
        }
    }

    /// Changes the budgets. What is on its way stays so.
    pub(super) fn set_budgets(&mut self, budgets: Budgets) {
        self.budgets = budgets;
        self.store.set_budget(budgets.host_bytes);
    }

    /// Lets the GPU decode pages from now on, or the host. Nothing may be with the decoder.
    pub(super) fn set_on_gpu(&mut self, on_gpu: bool) {
        self.on_gpu = on_gpu;
        for waiting in &mut self.pending {
            waiting.pending.set_on_gpu(on_gpu);
        }
    }

    /// Starts what a plan asks for and gives up what it cancels; fetches in the order of `upcoming`, also what is not
    /// asked for yet.
    pub(super) fn follow(
        &mut self,
        plan: &Plan,
        upcoming: &[Item],
        now: f64,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        self.cancel(&plan.cancel, btfs, source, counters);
        self.request(&plan.request, now, btfs, counters);
        self.arrange(upcoming, btfs);
        self.abort_stale(btfs, source, counters);
    }

    /// Brings what is to be submitted into the order of now: first ancestors that others wait for, then `upcoming`. What was
    /// queued early and is not among it any more is forgotten.
    fn arrange(&mut self, upcoming: &[Item], btfs: &[Arc<Btf>]) {
        self.order.clear();
        self.order.extend(upcoming.iter().copied().zip(1..));
        self.early.retain(|item| self.order.contains_key(item));
        let needed = self.needed();
        let mut queue: Vec<(usize, Item)> = Vec::new();
        for item in std::mem::take(&mut self.queue) {
            if needed.contains(&item) {
                queue.push((0, item));
            } else if self.wanted.contains_key(&item) {
                queue.push((self.order.get(&item).copied().unwrap_or(usize::MAX), item));
            }
        }
        let mut early_bytes = 0;
        for (&item, place) in upcoming.iter().zip(1..) {
            if self.wanted.contains_key(&item) || needed.contains(&item) {
                continue;
            }
            let bytes = length(item, btfs);
            early_bytes += bytes;
            if early_bytes > self.budgets.host_bytes / 4 {
                break; // The store would drop the first of them for the last.
            }
            let comes =
                self.flying.contains_key(&item) || self.early.contains(&item) || self.store.has_record(item);
            if bytes > 0 && !comes {
                queue.push((place, item));
            }
        }
        queue.sort_by_key(|(place, _)| *place);
        self.queue.extend(queue.into_iter().map(|(_, item)| item));
    }

    /// Gives up what is in flight early and has lost its place.
    fn abort_stale(&mut self, btfs: &[Arc<Btf>], source: &mut dyn TileSource, counters: &mut Counters) {
        let needed = self.needed();
        let is_stale = |item: &Item| {
            !self.wanted.contains_key(item) && !self.order.contains_key(item) && !needed.contains(item)
        };
        let stale = self.tickets.iter().filter(|(_, item)| is_stale(item));
        let mut stale: Vec<Ticket> = stale.map(|(ticket, _)| *ticket).collect();
        stale.sort_unstable();
        for ticket in stale {
            self.abort(ticket, btfs, source, counters);
        }
    }

    fn abort(
        &mut self,
        ticket: Ticket,
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        source.cancel(ticket);
        self.land(ticket, btfs);
        counters.requests_cancelled += 1;
    }

    /// Ancestors whose records pending pages wait for.
    fn needed(&self) -> HashSet<Item> {
        self.pending.iter().filter_map(|waiting| waiting.needs).collect()
    }

    /// Whether nobody has asked for an item yet.
    fn is_early(&self, item: Item) -> bool {
        !self.wanted.contains_key(&item) && self.order.contains_key(&item)
    }

    /// Gives items up.
    pub(super) fn cancel(
        &mut self,
        items: &[Item],
        btfs: &[Arc<Btf>],
        source: &mut dyn TileSource,
        counters: &mut Counters,
    ) {
        for &item in items {
            if self.wanted.remove(&item).is_some() {
                counters.requests_cancelled += 1;
                self.queue.retain(|&queued| queued != item);
                self.pending.retain(|waiting| waiting.pending.item != item);
                let needed = self.pending.iter().any(|waiting| waiting.needs == Some(item));
                if let Some(ticket) = self.flying.get(&item).copied().filter(|_| !needed) {
                    source.cancel(ticket);
                    self.land(ticket, btfs);
                }
            }
        }
    }

    /// Starts with items: those that the host still has can be decoded at once.
    fn request(&mut self, items: &[Item], now: f64, btfs: &[Arc<Btf>], counters: &mut Counters) {
        for &item in items {
            if self.wanted.insert(item, now).is_some() {
                continue;
            }
            if self.decoding.contains(item) {
                // Asked for before, given up, and wanted again: it is on its way.
                continue;
            }
            let stored = self.store.record(item);
            if record_of(item, btfs).is_ok_and(|record| record.length == 0) {
                counters.pages_not_stored += 1;
                self.pending.push_back(Waiting {
                    pending: Pending::new(item, Bytes::new(), self.on_gpu),
                    needs: None,
                });
            } else if let Some(record) = stored {
                match self.early.remove(&item) {
                    true => counters.records_early += 1,
                    false => counters.records_from_host += 1,
                }
                self.pending.push_back(Waiting {
                    pending: Pending::new(item, record, self.on_gpu),
                    needs: None,
                });
            } else if !self.flying.contains_key(&item) {
                self.queue.push_back(item);
            }
        }
    }

    /// Submits what waits, as far as the source and the budgets allow; one record always. What is in flight early
    /// gives way to what is wanted and comes before it in the order.
    pub(super) fn submit(&mut self, btfs: &[Arc<Btf>], source: &mut dyn TileSource, counters: &mut Counters) {
        let most = self.budgets.requests_in_flight.min(source.capacity());
        while let Some(&item) = self.queue.front() {
            let bytes = length(item, btfs);
            while !self.is_early(item)
                && !self.has_room(bytes, most)
                && let Some(last) = self.last_early_behind(item)
            {
                self.abort(last, btfs, source, counters);
            }
            if !self.has_room(bytes, most) {
                break;
            }
            let Some(ticket) = source.submit(request(item, btfs)) else {
                break;
            };
            self.bytes_in_flight += bytes;
            self.queue.pop_front();
            self.tickets.insert(ticket, item);
            self.flying.insert(item, ticket);
        }
    }

    fn has_room(&self, bytes: u64, most: usize) -> bool {
        let fits = self.bytes_in_flight.saturating_add(bytes) <= self.budgets.bytes_in_flight;
        self.tickets.is_empty() || (self.tickets.len() < most && fits)
    }

    /// Of what is in flight early the last in the order, if it comes after `item`.
    fn last_early_behind(&self, item: Item) -> Option<Ticket> {
        let place = |item: &Item| self.order.get(item).copied();
        let early = self.tickets.iter().filter(|(_, item)| self.is_early(**item));
        let (ticket, last) = early.max_by_key(|(_, item)| place(item))?;
        (place(last) > place(&item)).then_some(*ticket)
    }

    fn land(&mut self, ticket: Ticket, btfs: &[Arc<Btf>]) -> Option<Item> {
        let item = self.tickets.remove(&ticket)?;
        self.bytes_in_flight -= length(item, btfs);
        self.flying.remove(&item);
        Some(item)
    }

    /// Takes an answer about a record. Those that nobody waits for change nothing.
    pub(super) fn receive(
        &mut self,
        answer: Answer,
        btfs: &[Arc<Btf>],
        counters: &mut Counters,
        problems: &mut Problems,
    ) {
        let Some(item) = self.land(answer.ticket, btfs) else {
            return;
        };
        if self.is_early(item) {
            self.early.insert(item);
        }
        let bytes = match answer.bytes {
            Ok(bytes) => bytes,
            Err(error) => {
                counters.requests_failed += 1;
                if let Error::Changed { .. } = error {
                    self.changed.insert(material_of(item));
                }
                problems.add(format!("{}: {error}", name(item, btfs)));
                return self.give_up(item);
            }
        };
        let archive = &btf_of(item, btfs).archive;
        let checked = record_of(item, btfs)
            .and_then(|record| Ok(btf_of(item, btfs).index.verify(archive, record, &bytes)?));
        if let Err(error) = checked {
            counters.records_damaged += 1;
            let attempts = self.damaged.entry(item).or_default();
            *attempts += 1;
            if *attempts < ATTEMPTS {
                return self.queue.push_front(item);
            }
            let what = name(item, btfs);
            problems.add(format!("{what}: damaged {attempts} times in a row: {error}"));
            return self.give_up(item);
        }
        self.damaged.remove(&item);
        self.store.put_record(item, bytes.clone());
        if self.wanted.contains_key(&item) {
            self.pending.push_back(Waiting {
                pending: Pending::new(item, bytes, self.on_gpu),
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
            .extend(lost.into_iter().filter(|item| self.wanted.remove(item).is_some()));
    }

    /// The decoded ancestor of a pending page, if it can be had now; asks for what is missing otherwise.
    fn step(
        &mut self,
        at: usize,
        btfs: &[Arc<Btf>],
        counters: &mut Counters,
        problems: &mut Problems,
    ) -> Parent {
        let waiting = &mut self.pending[at];
        let busy = |item| self.decoding.is_busy(item);
        let index = &btf_of(waiting.pending.item, btfs).index;
        match waiting.pending.step(index, &mut self.store, busy) {
            Ok(Step::Ready(parent)) => Parent::Ready(parent),
            Ok(Step::Later) => Parent::Missing,
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

    /// Hands records that are here to the workers, in the order of their arrival: as many as the budget for a frame
    /// says, and as long as what is being decoded takes at most a quarter of the host's bytes; one always.
    pub(super) fn start_decoding(
        &mut self,
        btfs: &[Arc<Btf>],
        counters: &mut Counters,
        problems: &mut Problems,
    ) {
        let (mut at, mut started) = (0, 0);
        while at < self.pending.len() && started < self.budgets.decodes_per_frame {
            if self.pending[at].needs.is_some() {
                at += 1;
                continue;
            }
            match self.step(at, btfs, counters, problems) {
                Parent::Missing => at += 1,
                Parent::Broken => {
                    let broken = self.pending.remove(at).map(|waiting| waiting.pending.item);
                    self.failed
                        .extend(broken.filter(|item| self.wanted.remove(item).is_some()));
                }
                Parent::Ready(parent) => {
                    let Some(Waiting { pending, needs }) = self.pending.remove(at) else {
                        break;
                    };
                    let btf = btf_of(pending.item, btfs);
                    let budget_bytes = self.budgets.host_bytes / 4;
                    if let Err(pending) = self.decoding.start(pending, btf, parent, budget_bytes) {
                        self.pending.insert(at, Waiting { pending, needs });
                        break;
                    }
                    started += 1;
                }
            }
        }
        self.reserve();
    }

    /// What has been decoded: at most as much as may be uploaded in a frame.
    pub(super) fn finish_decoding(
        &mut self,
        now: f64,
        btfs: &[Arc<Btf>],
        problems: &mut Problems,
    ) -> Vec<(Item, Decoded)> {
        let mut finished = Vec::new();
        for done in self.decoding.finished(self.budgets.uploads_per_frame) {
            let item = done.item;
            for (page, texels) in done.ancestors {
                self.store.put_page(material_of(item), page, texels);
            }
            match done.decoded {
                Ok(decoded) => {
                    if let (Item::Page(material, page), Decoded::Page(texels)) = (item, &decoded)
                        && has_children_here(btf_of(item, btfs), page, self.on_gpu)
                    {
                        self.store.put_page(material, page, texels.clone());
                    }
                    if let Some(asked) = self.wanted.remove(&item) {
                        self.timed += 1.0;
                        let share = LATENCY_SHARE.max(1.0 / self.timed);
                        self.latency += share * (now - asked - self.latency);
                        finished.push((item, decoded));
                    }
                }
                Err(error) => {
                    problems.add(format!("{}: {error}", name(item, btfs)));
                    self.give_up(item);
                }
            }
        }
        self.reserve();
        finished
    }

    /// Seconds that records have taken lately from being asked for to being decoded.
    pub(super) fn latency(&self) -> f64 {
        self.latency
    }

    /// Whether records are being decoded beside the frames.
    pub(super) fn decoding(&self) -> bool {
        !self.decoding.idle()
    }

    /// Waits until something may have been decoded.
    pub(super) fn wait(&mut self, limit: std::time::Duration) {
        self.decoding.wait(limit);
    }

    /// Items that could not be had since the last call.
    pub(super) fn take_failed(&mut self) -> Vec<Item> {
        std::mem::take(&mut self.failed)
    }

    /// Materials of whose archives the source has said since the last call that they have changed.
    pub(super) fn take_changed(&mut self) -> BTreeSet<MaterialId> {
        std::mem::take(&mut self.changed)
    }

    /// Gives up all that is on its way for a material but not with the decoder yet.
    pub(super) fn forget(&mut self, material: MaterialId, btfs: &[Arc<Btf>], source: &mut dyn TileSource) {
        let is_of = |item: &Item| material_of(*item) == material;
        self.queue.retain(|item| !is_of(item));
        self.wanted.retain(|item, _| !is_of(item));
        self.pending.retain(|waiting| !is_of(&waiting.pending.item));
        self.order.retain(|item, _| !is_of(item));
        let mut flying: Vec<Ticket> = self
            .tickets
            .iter()
            .filter(|(_, item)| is_of(item))
            .map(|(ticket, _)| *ticket)
            .collect();
        flying.sort_unstable();
        for ticket in flying {
            source.cancel(ticket);
            self.land(ticket, btfs);
        }
    }

    /// Nothing is queued, in flight or waiting.
    pub(super) fn idle(&self) -> bool {
        self.queue.is_empty() && self.tickets.is_empty() && self.pending.is_empty() && self.decoding.idle()
    }

    /// Bytes held on the host.
    pub(super) fn bytes(&self) -> u64 {
        self.store.bytes() + self.waiting_bytes()
    }

    fn waiting_bytes(&self) -> u64 {
        let pending: u64 = self.pending.iter().map(|waiting| waiting.pending.bytes()).sum();
        pending + self.decoding.bytes()
    }

    /// What waits and what is being decoded counts against the budget of the store.
    fn reserve(&mut self) {
        self.store.reserve(self.waiting_bytes());
    }
}

enum Parent {
    Ready(Option<Arc<Page>>),
    Missing,
    Broken,
}

fn material_of(item: Item) -> MaterialId {
    let (Item::Page(material, _) | Item::Column(material, _)) = item;
    material
}

fn btf_of(item: Item, btfs: &[Arc<Btf>]) -> &Arc<Btf> {
    &btfs[usize::from(material_of(item).0)]
}

/// Whether a page has children that the host decodes.
fn has_children_here(btf: &Btf, page: PageId, on_gpu: bool) -> bool {
    let mut children = btf.pyramid().children(page.tile);
    children.any(|tile| !alone(&btf.index, PageId { tile, ..page }, on_gpu))
}

fn record_of(item: Item, btfs: &[Arc<Btf>]) -> Result<Record> {
    Ok(match item {
        Item::Page(_, page) => btf_of(item, btfs).index.page(page)?,
        Item::Column(_, group) => btf_of(item, btfs).index.column(group)?,
    })
}

/// Bytes of the record.
fn length(item: Item, btfs: &[Arc<Btf>]) -> u64 {
    record_of(item, btfs).map_or(0, |record| record.length.into())
}

fn request(item: Item, btfs: &[Arc<Btf>]) -> Request {
    let archive = btf_of(item, btfs).archive.clone();
    match item {
        Item::Page(_, page) => Request::Page { archive, page },
        Item::Column(_, group) => Request::Column { archive, group },
    }
}

fn name(item: Item, btfs: &[Arc<Btf>]) -> String {
    let archive = &btf_of(item, btfs).archive;
    match item {
        Item::Page(_, page) => format!("{archive} {page}"),
        Item::Column(_, group) => format!("{archive} column of group {group}"),
    }
}
