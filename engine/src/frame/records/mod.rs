//! Records on their way: from a plan to decoded pages and columns.
//!
//! An item is in one place at a time: `queue` (to be submitted), `tickets` (in flight), `pending` (here, waiting to be
//! decoded), [`Decoding`] (with the workers, or decoded and not handed out yet). What residency asked for is in `wanted`
//! until it is handed out; ancestors that the host has dropped travel the same way without being wanted.
//!
//! What residency will ask for next is fetched early: its record waits in the store until then. Early records
//! are asked for where they stand in the order, and are given up in the frame in which residency names them no more.
//!
//! `queue`: the order in which records are asked for. `window`: how many of them are. `items`: what an item is to its archive.

mod items;
mod queue;
mod window;

use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};
use std::sync::Arc;

use tileset::{Page, archive::contents};

use self::{
    items::{btf_of, has_children_here, material_of, name, record_of},
    window::{Sent, Window},
};
use super::{decoding::Decoding, options::Budgets, problems::Problems, stats::Counters, workers::Workers};
use crate::{
    Error,
    decode::{Decoded, Done, HostStore, Pending, Step},
    gpu::materials::Btf,
    residency::{Item, MaterialId},
    stream::{Answer, Ticket},
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
    tickets: HashMap<Ticket, Flight>,
    flying: HashMap<Item, Ticket>,
    bytes_in_flight: u64,
    window: Window,
    /// Archives that are not known, and since when there are so many, in seconds.
    unknown: (usize, f64),
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

/// A request on its way.
struct Flight {
    item: Item,
    sent: Sent,
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
            window: Window::default(),
            unknown: (0, 0.0),
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

    /// The line has carried something else than records.
    pub(super) fn carried(&mut self, bytes: u64) {
        self.window.carried(bytes);
    }

    /// Takes an answer about a record. Those that nobody waits for change nothing.
    pub(super) fn receive(
        &mut self,
        answer: Answer,
        now: f64,
        btfs: &[Arc<Btf>],
        counters: &mut Counters,
        problems: &mut Problems,
    ) {
        let Some(Flight { item, sent }) = self.land(answer.ticket, btfs) else {
            return;
        };
        self.window.came(sent, answer.wire_bytes, now);
        if self.is_early(item) {
            self.early.insert(item);
        }
        let mut bytes = match answer.bytes {
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
        let verify = || {
            let (btf, record) = (btf_of(item, btfs), record_of(item, btfs)?);
            btf.index.verify(&btf.archive, record, &bytes)?;
            Ok::<_, Error>(())
        };
        if let Err(error) = if answer.checked { Ok(()) } else { verify() } {
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
        // From here on it is known to be whole.
        bytes.truncate(contents(&bytes).len());
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
