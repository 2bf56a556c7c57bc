//! Other limits, at run time.

use super::{Item, Limits, Residency, pool::Pool};

impl Residency {
    /// Changes the limits at once. Where a cache gets smaller, what is worth least goes first, so that what stays is
    /// closed under ancestors; it stays in the order of its slots and moves to the first ones. [`Residency::slot`] tells
    /// where everything is afterwards. What is in flight stays so, also beyond a lower limit.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
        self.unsettled = true;
        // Pages of groups whose column goes are the first to go after it.
        self.resize(limits.column_slots, |residency| &mut residency.columns);
        self.resize(limits.page_slots, |residency| &mut residency.pages);
    }

    /// Changes the slots of a cache.
    fn resize(&mut self, capacity: u32, pool: fn(&mut Self) -> &mut Pool) {
        if pool(self).capacity() == capacity {
            return;
        }
        let empty = Pool::new(capacity);
        let pin = self.pins(&empty);
        let mut taken = std::mem::replace(pool(self), empty);
        let before: Vec<Item> = taken.iter().map(|(item, _)| item).collect();
        let materials = &self.materials;
        taken.resize(capacity, |item| materials[item.material()].rank(item, pin));
        for item in before {
            self.materials[item.material()].set_slot(item, None);
        }
        for (item, slot) in taken.iter() {
            self.materials[item.material()].set_slot(item, Some(slot));
        }
        *pool(self) = taken;
    }
}
