//! From answers to placements.

use super::{Failure, Item, LONGEST_BACK_OFF, MOST_FAILURES, Placement, Residency};

impl Residency {
    /// An item that was asked for is here: where does it go? Items nobody asked for are dropped.
    pub fn arrived(&mut self, item: Item) -> Placement {
        if item.material() >= self.materials.len() || !self.take_off(item) {
            return Placement::Drop;
        }
        self.moved(item);
        self.failures.remove(&item);
        let placement = self.place(item);
        match placement {
            Placement::Place { slot, evicted } => {
                if let Some(evicted) = evicted {
                    self.materials[evicted.material()].set_slot(evicted, None, self.pin_pages);
                    self.swapped += 1;
                } else {
                    self.added += 1;
                }
                self.materials[item.material()].set_slot(item, Some(slot), self.pin_pages);
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
        if item.material() >= self.materials.len() || !self.take_off(item) {
            return;
        }
        self.moved(item);
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

    /// Forgets all failures: what could not be had is asked for with the next update.
    pub fn retry(&mut self) {
        self.unsettled |= !self.failures.is_empty();
        self.failures.clear();
    }

    /// Something has happened to an item: the next update has to look again.
    fn moved(&mut self, item: Item) {
        if self.rank(item).is_present() {
            self.unsettled = true;
        } else {
            self.prefetching = true;
        }
    }

    fn place(&mut self, item: Item) -> Placement {
        if let Item::Page(material, page) = item
            && !self.materials[usize::from(material.0)].reachable(page)
        {
            return Placement::Drop;
        }
        let rank = self.rank(item);
        let at_most = self.in_flight.len() + 1;
        let pool = match item {
            Item::Page(..) => &mut self.pages,
            Item::Column(..) => &mut self.columns,
        };
        if let Some(slot) = pool.add(item, rank) {
            return Placement::Place { slot, evicted: None };
        }
        let swapped = match item {
            Item::Page(..) => {
                self.order_pages(at_most);
                self.pages.swap(item, rank)
            }
            Item::Column(..) => {
                self.order_columns(at_most);
                self.columns.swap(item, rank)
            }
        };
        match swapped {
            Some((slot, evicted)) => Placement::Place {
                slot,
                evicted: Some(evicted),
            },
            None => Placement::Drop,
        }
    }

    /// Without its column a group's pages are worth nothing.
    fn close(&mut self, item: Item) {
        if let Item::Column(..) = item {
            self.set_open(item, false);
            self.pages.forget_order();
        }
    }
}
