//! A plain policy for the engine: asks for what is seen in a given order, and works everything out anew in each frame.
//!
//! Children are asked for while their parents are in flight, so that no baseline waits a round trip for each mip. What of them
//! arrives first is dropped, and taken from the host's cache as soon as the parent is there.

use std::cell::Cell;
use std::collections::BTreeMap;

use engine::frame::Policy;
use engine::residency::{
    Item, Limits, MaterialId, MaterialInfo, Placement, Plan, Resized, Slot, Summary, Vote,
};
use tileset::PageId;

use super::Contender;
use super::order::{Key, Order, Seen};
use super::slots::Slots;

/// Updates after which what failed is asked for again.
const RETRY: u64 = 60;
/// Most records that are asked for and not here: what can be on its way by the engine's own budgets.
const REQUESTS: usize = 64;

pub(super) struct Baseline {
    contender: Contender,
    limits: Limits,
    seen: Vec<Seen>,
    votes: Vec<Vote>,
    pages: Slots,
    columns: Slots,
    /// With the bytes of each record.
    in_flight: BTreeMap<Item, u64>,
    failed: BTreeMap<Item, u64>,
    now: u64,
    /// Something has changed since the last update.
    changed: bool,
    /// The last update left something to ask for.
    open: bool,
    added: u64,
    swapped: u64,
    predicted: Cell<Option<f64>>,
}

fn material(item: Item) -> usize {
    let (Item::Page(material, _) | Item::Column(material, _)) = item;
    usize::from(material.0)
}

impl Baseline {
    pub(super) fn new(contender: Contender) -> Self {
        Self {
            contender,
            limits: Limits {
                page_slots: 0,
                column_slots: 0,
                in_flight: 1,
                bytes_in_flight: 1,
            },
            seen: Vec::new(),
            votes: Vec::new(),
            pages: Slots::default(),
            columns: Slots::default(),
            in_flight: BTreeMap::new(),
            failed: BTreeMap::new(),
            now: 0,
            changed: true,
            open: true,
            added: 0,
            swapped: 0,
            predicted: Cell::new(None),
        }
    }

    fn slots(&self, item: Item) -> &Slots {
        match item {
            Item::Page(..) => &self.pages,
            Item::Column(..) => &self.columns,
        }
    }

    fn slots_mut(&mut self, item: Item) -> &mut Slots {
        match item {
            Item::Page(..) => &mut self.pages,
            Item::Column(..) => &mut self.columns,
        }
    }

    fn parent(&self, item: Item) -> Option<Item> {
        let Item::Page(id, page) = item else { return None };
        let tile = self.seen[material(item)].info.pyramid.parent(page.tile)?;
        Some(Item::Page(id, PageId { tile, ..page }))
    }

    fn is_wanted(&self, item: Item) -> bool {
        let seen = &self.seen[material(item)];
        match item {
            Item::Page(_, page) => seen.tile(page).is_some_and(|tile| seen.counts[tile] > 0),
            Item::Column(..) => !seen.wanted.is_empty(),
        }
    }

    fn is_leaf(&self, item: Item) -> bool {
        let Item::Page(id, page) = item else { return true };
        let mut children = self.seen[material(item)].info.pyramid.children(page.tile);
        children.all(|tile| {
            let child = Item::Page(id, PageId { tile, ..page });
            !self.pages.contains(child) && !self.in_flight.contains_key(&child)
        })
    }

    /// Equation 10 for a leaf whose parent is there.
    fn cost(&self, item: Item) -> f64 {
        let seen = &self.seen[material(item)];
        match item {
            Item::Page(_, page) => seen
                .tile(page)
                .map_or(0.0, |tile| seen.priority(page.group, tile)),
            Item::Column(..) => f64::INFINITY,
        }
    }

    /// What could give way, the first to go first, with what a new item must be worth more than.
    fn leaving(&self, pages: bool) -> Vec<(f64, Item)> {
        let slots = if pages { &self.pages } else { &self.columns };
        let mut leaving: Vec<(f64, Item)> = match self.contender {
            Contender::Paper if !pages => Vec::new(),
            Contender::Paper => {
                let leaves = slots
                    .iter()
                    .map(|(item, _)| item)
                    .filter(|item| self.is_leaf(*item));
                leaves.map(|item| (self.cost(item), item)).collect()
            }
            _ => {
                let leaves = slots.unwanted(self.now).filter(|(_, item)| self.is_leaf(*item));
                leaves.map(|(wanted, item)| (wanted as f64, item)).collect()
            }
        };
        leaving.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        leaving
    }

    /// Whether an item is worth more than what gives way.
    fn worth_more(&self, item: Item, gives_way: f64) -> bool {
        self.contender != Contender::Paper || self.cost(item) > gives_way
    }

    /// All that is seen, neither here nor on its way, and can be asked for, in order.
    fn candidates(&self) -> Vec<Item> {
        let order = Order::new(self.contender, &self.seen);
        let missing = |item: Item| {
            !self.slots(item).contains(item)
                && !self.in_flight.contains_key(&item)
                && self.failed.get(&item).is_none_or(|retry| *retry <= self.now)
        };
        let mut found: Vec<(Key, Item)> = Vec::new();
        for seen in self.seen.iter().filter(|seen| !seen.wanted.is_empty()) {
            for group in 0..seen.info.groups {
                let mut resident = 0.0;
                for &tile in &seen.wanted {
                    let Some(item) = seen.page(group, tile) else {
                        continue;
                    };
                    if self.pages.contains(item) {
                        resident += seen.priority(group, tile);
                    }
                    let reachable =
                        |parent: Item| self.pages.contains(parent) || self.in_flight.contains_key(&parent);
                    let matters = self.contender != Contender::Paper || seen.priority(group, tile) > 0.0;
                    if matters && missing(item) && self.parent(item).is_none_or(reachable) {
                        found.push((order.page(seen, group, tile), item));
                    }
                }
                let column = Item::Column(seen.id, group);
                let matters = self.contender != Contender::Paper || resident > 0.0;
                if matters && missing(column) {
                    found.push((order.column(seen, group, resident), column));
                }
            }
        }
        found.sort_by(|a, b| {
            let by_key = a.0.partial_cmp(&b.0).unwrap_or(std::cmp::Ordering::Equal);
            by_key.then(a.1.cmp(&b.1))
        });
        found.into_iter().map(|(_, item)| item).collect()
    }

    fn request(&mut self, plan: &mut Plan) {
        self.open = false;
        let leaving = [self.leaving(true), self.leaving(false)];
        // Children become candidates with their parents.
        loop {
            let before = plan.request.len();
            for item in self.candidates() {
                let pages = matches!(item, Item::Page(..));
                let coming = self
                    .in_flight
                    .keys()
                    .filter(|item| matches!(item, Item::Page(..)) == pages);
                let place = coming.count();
                let free = self.slots(item).free();
                let has_place = place < free
                    || leaving[usize::from(!pages)]
                        .get(place - free)
                        .is_some_and(|(value, _)| self.worth_more(item, *value));
                if !has_place {
                    continue;
                }
                let bytes = self.seen[material(item)].bytes(item);
                let in_flight: u64 = self.in_flight.values().sum();
                let none = self.in_flight.is_empty();
                self.open = true;
                if self.in_flight.len() >= self.limits.in_flight
                    || (!none && in_flight + bytes > self.limits.bytes_in_flight)
                {
                    return;
                }
                self.in_flight.insert(item, bytes);
                plan.request.push(item);
            }
            if plan.request.len() == before {
                return;
            }
        }
    }

    /// Σ over the pixels of the weights that they miss: as `engine::residency` predicts it.
    fn predict(&self) -> f64 {
        let (mut sum, mut pixels) = (0.0, 0);
        let mut missing = Vec::new();
        for seen in &self.seen {
            pixels += seen.own.iter().sum::<u64>();
            missing.resize(seen.tiles(), 0.0);
            for group in 0..seen.info.groups {
                let column = self.columns.contains(Item::Column(seen.id, group));
                for &tile in &seen.wanted {
                    let above = seen.parents[tile].map_or(0.0, |parent| missing[parent]);
                    let page = seen.page(group, tile);
                    let there = column && page.is_some_and(|page| self.pages.contains(page));
                    missing[tile] = if there {
                        0.0
                    } else {
                        above + seen.weight(group, tile)
                    };
                    sum += seen.own[tile] as f64 * missing[tile];
                }
            }
        }
        sum / pixels.max(1) as f64
    }

    /// Takes out what has no slot any more, and with a page all below it.
    fn evict(&mut self, item: Item, evicted: &mut Vec<(Item, Slot)>) {
        if let Item::Page(id, page) = item {
            let pyramid = self.seen[material(item)].info.pyramid;
            for tile in pyramid.children(page.tile) {
                self.evict(Item::Page(id, PageId { tile, ..page }), evicted);
            }
        }
        evicted.extend(self.slots_mut(item).remove(item).map(|slot| (item, slot)));
    }
}

impl Policy for Baseline {
    fn add_material(&mut self, info: MaterialInfo) {
        // The engine refuses scenes with more materials than ids.
        let id = MaterialId(self.seen.len().min(usize::from(u16::MAX)) as u16);
        self.seen.push(Seen::new(id, info));
        self.changed = true;
    }

    fn set_limits(&mut self, limits: Limits) -> Resized {
        // Records are asked for in the order in which they are named here: no more at a time than can be on their way.
        let in_flight = limits.in_flight.min(REQUESTS);
        self.limits = Limits { in_flight, ..limits };
        self.changed = true;
        self.predicted.set(None);
        let mut resized = Resized::default();
        let beyond = self.columns.set_capacity(limits.column_slots);
        for item in beyond
            .into_iter()
            .chain(self.pages.set_capacity(limits.page_slots))
        {
            self.evict(item, &mut resized.evicted);
        }
        while self.in_flight.len() > limits.in_flight {
            resized
                .cancel
                .extend(self.in_flight.pop_last().map(|(item, _)| item));
        }
        resized
    }

    fn update(&mut self, votes: &[Vote], _ahead: &[Vote]) -> Plan {
        let mut plan = Plan::default();
        if !self.changed && self.failed.is_empty() && self.votes == votes {
            return plan;
        }
        self.now += 1;
        self.changed = false;
        self.predicted.set(None);
        self.votes.clear();
        self.votes.extend_from_slice(votes);
        for seen in &mut self.seen {
            seen.set_votes(votes, self.now);
            if self.contender == Contender::Bound {
                seen.schedule();
            }
        }
        let wanted = |item: &Item| self.is_wanted(*item);
        let resident: Vec<Item> = self
            .resident()
            .into_iter()
            .map(|(item, _)| item)
            .filter(wanted)
            .collect();
        plan.cancel = self
            .in_flight
            .keys()
            .copied()
            .filter(|item| !wanted(item))
            .collect();
        let now = self.now;
        for item in resident {
            self.slots_mut(item).touch(item, now);
        }
        for item in &plan.cancel {
            self.in_flight.remove(item);
        }
        self.request(&mut plan);
        plan
    }

    fn arrived(&mut self, item: Item) -> Placement {
        if self.in_flight.remove(&item).is_none() {
            return Placement::Drop;
        }
        self.changed = true;
        self.predicted.set(None);
        self.failed.remove(&item);
        if self
            .parent(item)
            .is_some_and(|parent| !self.pages.contains(parent))
        {
            return Placement::Drop;
        }
        let mut evicted = None;
        if self.slots(item).free() == 0 {
            let leaving = self.leaving(matches!(item, Item::Page(..))).into_iter();
            let mut leaving = leaving.filter(|(_, leaf)| self.parent(item) != Some(*leaf));
            evicted = leaving.next().filter(|(value, _)| self.worth_more(item, *value));
            let Some((_, victim)) = evicted else {
                return Placement::Drop;
            };
            self.slots_mut(victim).remove(victim);
        }
        let now = self.now;
        let Some(slot) = self.slots_mut(item).add(item, now) else {
            return Placement::Drop;
        };
        let evicted = evicted.map(|(_, victim)| victim);
        self.added += u64::from(evicted.is_none());
        self.swapped += u64::from(evicted.is_some());
        Placement::Place { slot, evicted }
    }

    fn failed(&mut self, item: Item) {
        if self.in_flight.remove(&item).is_some() {
            self.failed.insert(item, self.now + RETRY);
            self.changed = true;
        }
    }

    fn slot(&self, item: Item) -> Option<Slot> {
        self.slots(item).slot(item)
    }

    fn resident(&self) -> Vec<(Item, Slot)> {
        self.pages.iter().chain(self.columns.iter()).collect()
    }

    fn summary(&self) -> Summary {
        let predicted = self.predicted.get().unwrap_or_else(|| self.predict());
        self.predicted.set(Some(predicted));
        let wanted = self
            .seen
            .iter()
            .map(|seen| seen.wanted.len() * usize::from(seen.info.groups));
        Summary {
            pages_wanted: wanted.sum::<usize>() as u32,
            pages_resident: self.pages.len() as u32,
            columns_resident: self.columns.len() as u32,
            in_flight: self.in_flight.len() as u32,
            added: self.added,
            swapped: self.swapped,
            predicted_mse: predicted,
            settled: !self.changed && !self.open && self.in_flight.is_empty(),
            prefetching: false,
        }
    }
}
