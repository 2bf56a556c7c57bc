//! Budgets that change between frames.

use super::{Budgets, Engine};
use crate::{
    Result,
    decode::PAGE_BYTES,
    gpu::materials::Btf,
    residency::{Item, Limits, Slot},
};

impl Engine {
    /// What may be used of each resource.
    pub fn budgets(&self) -> Budgets {
        self.options.budgets()
    }

    /// Changes the budgets, at once. What stays in the caches on the GPU is copied there; what has no room any more goes,
    /// the least worth first. While that lasts old and new caches are both in memory. What is asked for or being decoded
    /// stays so.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] for budgets that cannot work with the materials that are known; then all stays as it is.
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn set_budgets(&mut self, budgets: Budgets) -> Result<()> {
        let options = self.options.clone().with_budgets(budgets);
        options.check()?;
        self.renderer.layout(options.caches(), self.column_quads())?;
        self.options = options;
        self.records.set_budgets(budgets);
        self.resize_caches()
    }

    /// Makes the caches what budgets and known materials ask for.
    pub(super) fn resize_caches(&mut self) -> Result<()> {
        let layout = self.renderer.layout(self.options.caches(), self.column_quads())?;
        let (page_slots, column_slots) = layout.slots();
        let before = self.residency.resident();
        let resized = self.residency.set_limits(Limits {
            page_slots,
            column_slots,
            in_flight: self.in_flight_limit(),
            bytes_in_flight: self.options.bytes_in_flight,
        });
        self.records
            .cancel(&resized.cancel, &self.btfs, &mut *self.source, &mut self.counters);
        let (mut pages, mut columns): (Vec<(Slot, Slot)>, Vec<_>) = Default::default();
        for (item, from) in before {
            match (item, self.residency.slot(item)) {
                (Item::Page(..), Some(to)) => pages.push((from, to)),
                (Item::Column(..), Some(to)) => columns.push((from, to)),
                (_, None) => {
                    self.remove(item);
                    self.changed = true;
                }
            }
        }
        self.renderer.resize_caches(layout, &pages, &columns)
    }

    /// Size of the largest column in the cache.
    fn column_quads(&self) -> u64 {
        self.btfs
            .iter()
            .map(|btf| Btf::column_quads(btf))
            .max()
            .unwrap_or(0)
    }

    /// What waits to be decoded takes at most a quarter of the host's memory: a record and a page each.
    fn in_flight_limit(&self) -> usize {
        let host = self.options.host_bytes / 4 / (2 * PAGE_BYTES);
        self.options
            .requests_in_flight
            .min(self.source.capacity())
            .min(usize::try_from(host).unwrap_or(usize::MAX))
            .max(1)
    }
}
