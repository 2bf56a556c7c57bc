//! From answers to placements.

use super::{Failure, Item, LONGEST_BACK_OFF, MOST_FAILURES, Placement, Residency};

impl Residency {
    /// An item that was asked for is here: where does it go? Items nobody asked for are dropped.
    pub fn arrived(&mut self, item: Item) -> Placement {
        if !self.in_flight.remove(&item) {
            return Placement::Drop;
        }
        self.unsettled = true;
        self.failures.remove(&item);
        let placement = self.place(item);
        match placement {
            Placement::Place { slot, evicted } => {
                if let Some(evicted) = evicted {
                    self.materials[evicted.material()].set_slot(evicted, None);
                    self.swapped += 1;
                } else {
                    self.added += 1;
                }
                self.materials[item.material()].set_slot(item, Some(slot));
                if let Some(Item::Column(..)) = evicted {
                    self.pages.forget_order();
                }
            }
            Placement::Drop => self.close(item),
        }
        placement
    }

    /// An item could not be had; it is asked for again after a number of updates that doubles each time.
    pub fn failed(&mut self, item: Item) {
        if !self.in_flight.remove(&item) {
            return;
        }
        self.unsettled = true;
        self.close(item);
        if self.failures.len() >= MOST_FAILURES {
            self.failures.clear();
        }
        let failure = self
            .failures
            .entry(item)
            .or_insert(Failure { count: 0, retry: 0 });
        failure.count = failure.count.saturating_add(1);
        let wait = 1u64
            .checked_shl(failure.count)
            .unwrap_or(LONGEST_BACK_OFF)
            .min(LONGEST_BACK_OFF);
        failure.retry = self.now + wait;
    }

    fn place(&mut self, item: Item) -> Placement {
        let material = &self.materials[item.material()];
        let pool = match item {
            Item::Page(_, page) if !material.reachable(page) => return Placement::Drop,
            Item::Page(..) => &self.pages,
            Item::Column(..) => &self.columns,
        };
        let pin = self.pins(pool);
        let rank = material.rank(item, pin);
        let pool = match item {
            Item::Page(..) => &mut self.pages,
            Item::Column(..) => &mut self.columns,
        };
        if let Some(slot) = pool.add(item, rank) {
            return Placement::Place { slot, evicted: None };
        }
        let materials = &self.materials;
        pool.order(self.in_flight.len() + 1, |item| {
            materials[item.material()].rank(item, pin)
        });
        match pool.swap(item, rank) {
            Some((slot, evicted)) => Placement::Place {
                slot,
                evicted: Some(evicted),
            },
            None => Placement::Drop,
        }
    }

    /// Without its column a group's pages are worth nothing.
    fn close(&mut self, item: Item) {
        if let Item::Column(_, group) = item {
            self.materials[item.material()].groups[usize::from(group)].open = false;
            self.pages.forget_order();
        }
    }
}
