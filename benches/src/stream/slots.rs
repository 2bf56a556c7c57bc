//! The slots of one cache, and when each item was wanted last.

use std::collections::BTreeMap;

use engine::residency::{Item, Slot};

#[derive(Default)]
pub(super) struct Slots {
    capacity: u32,
    items: BTreeMap<Item, Held>,
    /// By slot.
    taken: BTreeMap<u32, Item>,
}

struct Held {
    slot: Slot,
    wanted: u64,
}

impl Slots {
    pub(super) fn len(&self) -> usize {
        self.items.len()
    }

    pub(super) fn free(&self) -> usize {
        (self.capacity as usize).saturating_sub(self.items.len())
    }

    pub(super) fn slot(&self, item: Item) -> Option<Slot> {
        self.items.get(&item).map(|held| held.slot)
    }

    pub(super) fn contains(&self, item: Item) -> bool {
        self.items.contains_key(&item)
    }

    /// By slot.
    pub(super) fn iter(&self) -> impl Iterator<Item = (Item, Slot)> + '_ {
        self.taken.iter().map(|(&slot, &item)| (item, Slot(slot)))
    }

    /// Items that were not wanted at this time, with the last time at which they were.
    pub(super) fn unwanted(&self, now: u64) -> impl Iterator<Item = (u64, Item)> + '_ {
        let held = self.items.iter().filter(move |(_, held)| held.wanted < now);
        held.map(|(&item, held)| (held.wanted, item))
    }

    pub(super) fn touch(&mut self, item: Item, now: u64) {
        if let Some(held) = self.items.get_mut(&item) {
            held.wanted = now;
        }
    }

    /// Puts an item into the first free slot.
    pub(super) fn add(&mut self, item: Item, now: u64) -> Option<Slot> {
        let slot = (0..self.capacity).find(|slot| !self.taken.contains_key(slot))?;
        self.taken.insert(slot, item);
        let slot = Slot(slot);
        self.items.insert(item, Held { slot, wanted: now });
        Some(slot)
    }

    pub(super) fn remove(&mut self, item: Item) -> Option<Slot> {
        let held = self.items.remove(&item)?;
        self.taken.remove(&held.slot.0);
        Some(held.slot)
    }

    /// Sets how many slots there are; what lies beyond has to go.
    pub(super) fn set_capacity(&mut self, capacity: u32) -> Vec<Item> {
        self.capacity = capacity;
        self.taken.range(capacity..).map(|(_, &item)| item).collect()
    }
}
