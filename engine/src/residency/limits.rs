//! Budgets that change at run time.

use super::{Item, Limits, Residency, Resized, Slot, rank::Rank};

impl Residency {
    /// Sets new limits, which hold from now on, and says what has to go or to move for them.
    ///
    /// Where a cache shrinks, the items that are worth least go, so that what stays is closed under ancestors, and those
    /// in slots that are no more move to free ones. Where it grows, nothing moves; the next update fills it.
    pub fn set_limits(&mut self, limits: Limits) -> Resized {
        let mut resized = Resized::default();
        if limits == self.limits {
            return resized;
        }
        self.limits = limits;
        self.unsettled = true;
        self.columns.set_capacity(limits.column_slots);
        self.pages.set_capacity(limits.page_slots);
        self.find_pins();
        // Columns first: without its column a page is worth nothing.
        self.shrink(false, &mut resized);
        self.shrink(true, &mut resized);
        let mut in_flight: Vec<Item> = self.in_flight.iter().copied().collect();
        in_flight.sort_by_key(|item| self.rank(*item));
        for item in in_flight {
            if self.in_flight.len() <= limits.in_flight
                && (self.bytes_in_flight <= limits.bytes_in_flight || self.in_flight.len() == 1)
            {
                break;
            }
            self.take_off(item);
            resized.cancel.push(item);
        }
        resized
    }

    fn shrink(&mut self, pages: bool, resized: &mut Resized) {
        let pool = if pages { &self.pages } else { &self.columns };
        if pool.len() <= pool.capacity() {
            return;
        }
        let mut ranks: Vec<(Rank, Slot)> = pool.iter().map(|(item, slot)| (self.rank(item), slot)).collect();
        ranks.sort_unstable();
        ranks.truncate((pool.len() - pool.capacity()) as usize);
        let pool = if pages { &mut self.pages } else { &mut self.columns };
        let (evicted, moved) = pool.shrink(ranks.into_iter().map(|(_, slot)| slot));
        for &(item, _) in &evicted {
            self.materials[item.material()].set_slot(item, None, self.pin_pages);
        }
        for step in &moved {
            self.materials[step.item.material()].set_slot(step.item, Some(step.to), self.pin_pages);
        }
        resized.evicted.extend(evicted);
        resized.moved.extend(moved);
    }
}
