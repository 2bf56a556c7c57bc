//! The slots of one cache, and who gives way.

use std::{cmp::Reverse, collections::BinaryHeap};

use super::{Item, Move, Slot, rank::Rank};

/// Slots are filled in order, and only a smaller capacity makes one free again: an item leaves for another.
pub(super) struct Pool {
    capacity: u32,
    items: Vec<Item>,
    /// The lowest ranks of the items, and their slots, as they were when it was last [ordered](Pool::order), lowest last.
    order: Vec<(Rank, u32)>,
    /// Ranks of the items placed since.
    placed: BinaryHeap<Reverse<(Rank, u32)>>,
    ordered: bool,
}

impl Pool {
    pub(super) fn new(capacity: u32) -> Self {
        Self {
            capacity,
            items: Vec::new(),
            order: Vec::new(),
            placed: BinaryHeap::new(),
            ordered: false,
        }
    }

    pub(super) fn len(&self) -> u32 {
        self.items.len() as u32
    }

    pub(super) fn free(&self) -> u32 {
        self.capacity.saturating_sub(self.len())
    }

    /// To be followed by [`Pool::shrink`] where it is less than what is there.
    pub(super) fn set_capacity(&mut self, capacity: u32) {
        self.capacity = capacity;
        self.forget_order();
    }

    /// Empties these slots, as many as there are items too many; then moves what lies beyond the capacity into them.
    pub(super) fn shrink(&mut self, slots: impl Iterator<Item = Slot>) -> (Vec<(Item, Slot)>, Vec<Move>) {
        let mut slots: Vec<Slot> = slots.collect();
        slots.sort_unstable();
        let evicted = slots
            .iter()
            .map(|&slot| (self.items[slot.0 as usize], slot))
            .collect();
        let mut free = slots.iter().copied().filter(|slot| slot.0 < self.capacity);
        let mut moved = Vec::new();
        for from in (self.capacity..self.len()).map(Slot) {
            if slots.binary_search(&from).is_err()
                && let Some(to) = free.next()
            {
                let item = self.items[from.0 as usize];
                self.items[to.0 as usize] = item;
                moved.push(Move { item, from, to });
            }
        }
        self.items.truncate(self.capacity as usize);
        self.forget_order();
        (evicted, moved)
    }

    pub(super) fn capacity(&self) -> u32 {
        self.capacity
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (Item, Slot)> + '_ {
        self.items.iter().zip(0..).map(|(&item, slot)| (item, Slot(slot)))
    }

    /// To be called when ranks have changed.
    pub(super) fn forget_order(&mut self) {
        self.ordered = false;
    }

    /// Whether it is known who gives way.
    pub(super) fn ordered(&self) -> bool {
        self.ordered
    }

    /// Takes ranks and slots of resident items, those of as many of the lowest among them as will have to give way at
    /// most.
    pub(super) fn order(&mut self, at_most: usize, ranks: Vec<(Rank, u32)>) {
        self.placed.clear();
        self.order = ranks;
        if (1..self.order.len()).contains(&at_most) {
            self.order.select_nth_unstable(at_most - 1);
            self.order.truncate(at_most);
        }
        self.order.sort_unstable_by(|a, b| b.cmp(a));
        self.ordered = true;
    }

    /// The rank that gives way for the n-th newcomer. Needs the order, and nothing placed since.
    pub(super) fn nth_to_go(&self, n: usize) -> Option<&Rank> {
        debug_assert!(self.ordered && self.placed.is_empty());
        self.order.len().checked_sub(n + 1).map(|at| &self.order[at].0)
    }

    /// Puts an item into a free slot, if there is one.
    pub(super) fn add(&mut self, item: Item, rank: Rank) -> Option<Slot> {
        if self.free() == 0 {
            return None;
        }
        let slot = self.len();
        self.items.push(item);
        self.placed.push(Reverse((rank, slot)));
        Some(Slot(slot))
    }

    /// Puts an item in the place of the one with the lowest rank, if that is worth less. Needs the order.
    pub(super) fn swap(&mut self, item: Item, rank: Rank) -> Option<(Slot, Item)> {
        debug_assert!(self.ordered);
        let sorted = self.order.last().copied();
        let placed = self.placed.peek().map(|&Reverse(lowest)| lowest);
        let from_placed = match (sorted, placed) {
            (Some(sorted), Some(placed)) => placed < sorted,
            (sorted, _) => sorted.is_none(),
        };
        let (lowest, slot) = if from_placed { placed? } else { sorted? };
        if !rank.exceeds(&lowest) {
            return None;
        }
        if from_placed {
            self.placed.pop();
        } else {
            self.order.pop();
        }
        self.placed.push(Reverse((rank, slot)));
        // Nothing is known of those above the last that was sorted.
        self.ordered &= !self.order.is_empty();
        let evicted = std::mem::replace(&mut self.items[slot as usize], item);
        Some((Slot(slot), evicted))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tileset::{PageId, Tile};

    use super::*;
    use crate::residency::MaterialId;

    fn item(number: u16) -> Item {
        Item::Page(
            MaterialId(0),
            PageId {
                group: number,
                tile: Tile { mip: 0, x: 0, y: 0 },
            },
        )
    }

    fn rank(number: u16, value: f64) -> Rank {
        let group = Reverse(number);
        Rank {
            pinned: false,
            value,
            ahead: 0.0,
            last_wanted: 0,
            tile: Reverse(0),
            group,
            material: Reverse(0),
        }
    }

    proptest! {
        /// Against a list that is searched anew each time.
        #[test]
        fn the_least_gives_way(
            capacity in 0u32..12,
            newcomers in prop::collection::vec((0u32..20, any::<bool>()), 1..60),
        ) {
            let values: Vec<f64> = newcomers.iter().map(|(value, _)| f64::from(*value)).collect();
            let rank_of = |item: Item| match item {
                Item::Page(_, page) => rank(page.group, values[usize::from(page.group)]),
                Item::Column(..) => unreachable!(),
            };
            let ranks =
                |pool: &Pool| pool.iter().map(|(item, slot)| (rank_of(item), slot.0)).collect::<Vec<_>>();
            let mut pool = Pool::new(capacity);
            let mut model: Vec<Item> = Vec::new();
            for (number, (_, forget)) in newcomers.iter().enumerate() {
                let newcomer = item(number as u16);
                if *forget {
                    pool.forget_order();
                }
                let added = pool.add(newcomer, rank_of(newcomer));
                prop_assert_eq!(added.is_some(), model.len() < capacity as usize);
                if added.is_some() {
                    model.push(newcomer);
                    continue;
                }
                if !pool.ordered() {
                    pool.order(1, ranks(&pool));
                }
                let least = (0..model.len()).min_by_key(|&at| rank_of(model[at]));
                let expected = least.filter(|&at| rank_of(newcomer).exceeds(&rank_of(model[at])));
                let expected = expected.map(|at| (Slot(at as u32), std::mem::replace(&mut model[at], newcomer)));
                prop_assert_eq!(pool.swap(newcomer, rank_of(newcomer)), expected);
                prop_assert_eq!(pool.iter().map(|(item, _)| item).collect::<Vec<_>>(), model.clone());
            }
            pool.forget_order();
            pool.order(model.len(), ranks(&pool));
            model.sort_by_key(|item| rank_of(*item));
            for (n, item) in model.iter().enumerate() {
                prop_assert_eq!(pool.nth_to_go(n), Some(&rank_of(*item)));
            }
            prop_assert_eq!(pool.nth_to_go(model.len()), None);
        }
    }
}
