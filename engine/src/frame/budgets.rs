//! Budgets and forms of caches that change between frames.

use std::{sync::Arc, time::Duration};

use super::{Budgets, Engine, Options};
use crate::{
    Result,
    angular::Angular,
    decode::PAGE_BYTES,
    gpu::{Caches, column_cache::most_slot_bytes, materials::Btf},
    residency::{Item, Limits, SLOTS_PER_PIN, Slot},
};

/// Most items that residency may have asked for: more than a line carries in the time that an order holds.
const MOST_ASKED: usize = 512;

/// From slot to slot.
type Moves = Vec<(Slot, Slot)>;

impl Engine {
    /// What may be used of each resource.
    pub fn budgets(&self) -> Budgets {
        self.options.budgets
    }

    /// Changes the budgets, at once. What stays in the caches on the GPU is copied there; what has no room any more goes,
    /// the least worth first. While that lasts old and new caches are both in memory. What is asked for or being decoded
    /// stays so. Whether another format of the page cache would be better now, the next frames see.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] for budgets that cannot work with the materials that are known; then all stays as it is.
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn set_budgets(&mut self, budgets: Budgets) -> Result<()> {
        let options = Options {
            budgets,
            ..self.options.clone()
        };
        options.check()?;
        let quads = self.column_quads();
        let caches = Caches {
            page_format: self.format,
            ..options.caches()
        };
        self.renderer.layout(caches, quads)?;
        self.options = options;
        self.records.set_budgets(budgets);
        self.resize_caches()
    }

    /// Chooses how columns are interpolated, at once: all columns leave the cache and come back in the other form, from the
    /// same archives. Waits for what is being decoded.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] if the column cache has no room for one column in that form; then all stays as it is.
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn set_angular(&mut self, angular: Angular) -> Result<()> {
        if angular == self.options.angular {
            return Ok(());
        }
        let quads = self.btfs.iter().map(|btf| btf.column_quads_as(angular));
        let caches = Caches {
            angular,
            ..self.caches()
        };
        self.renderer.layout(caches, quads.max().unwrap_or(0))?;
        // Columns with the decoder still come in the old form.
        self.finish_decoding()?;
        self.options.angular = angular;
        for btf in &mut self.btfs {
            Arc::make_mut(btf).angular = angular;
        }
        let (page_slots, _) = self.renderer.slots();
        self.set_slots(page_slots, 0);
        self.changed = true;
        self.resize_caches()
    }

    /// Waits for what is being decoded, and places it.
    pub(super) fn finish_decoding(&mut self) -> Result<()> {
        while self.records.decoding() {
            self.records.wait(Duration::from_millis(10));
            let decoded = self.take_decoded();
            self.place(decoded)?;
        }
        Ok(())
    }

    /// Budgets and forms of the caches as they are.
    pub(super) fn caches(&self) -> Caches {
        Caches {
            page_format: self.format,
            ..self.options.caches()
        }
    }

    /// The same without what could never be filled: slots for more than all pages and columns of the known materials. Numbers of slots
    /// are powers of two, so that materials that become known one after another seldom move what is there, and there are enough to
    /// pin what is always kept.
    fn useful_caches(&self) -> Caches {
        let caches = self.caches();
        let slots = |of: fn(&Btf) -> u64| {
            let each = self.btfs.iter().map(|btf| of(btf).max(SLOTS_PER_PIN.into()));
            let sum = each.fold(0, u64::saturating_add);
            sum.checked_next_power_of_two().unwrap_or(u64::MAX)
        };
        let pages = slots(|btf| u64::from(btf.groups()) * u64::from(btf.pyramid().tile_count()));
        let columns = slots(|btf| btf.groups().into());
        let page_bytes = caches.page_format.slot_bytes();
        let column_bytes = most_slot_bytes(self.column_quads());
        Caches {
            page_bytes: caches.page_bytes.min(pages.saturating_mul(page_bytes)),
            column_bytes: caches.column_bytes.min(columns.saturating_mul(column_bytes)),
            ..caches
        }
    }

    /// Makes the caches what budgets and known materials ask for.
    pub(super) fn resize_caches(&mut self) -> Result<()> {
        let layout = self.renderer.layout(self.useful_caches(), self.column_quads())?;
        let (page_slots, column_slots) = layout.slots();
        self.count_format_slots();
        let (pages, columns) = self.set_slots(page_slots, column_slots);
        self.renderer.resize_caches(layout, &pages, &columns)
    }

    /// Gives residency so many slots, and takes what loses its own out of the page table. Returns from where to where pages
    /// and columns that stay are to be moved.
    pub(super) fn set_slots(&mut self, page_slots: u32, column_slots: u32) -> (Moves, Moves) {
        let before = self.residency.resident();
        let resized = self.residency.set_limits(Limits {
            page_slots,
            column_slots,
            in_flight: self.in_flight_limit(),
            bytes_in_flight: self.options.budgets.bytes_in_flight,
        });
        self.records
            .cancel(&resized.cancel, &self.btfs, &mut *self.source, &mut self.counters);
        let (mut pages, mut columns): (Moves, Moves) = Default::default();
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
        self.placed.move_to(&pages, &columns);
        (pages, columns)
    }

    /// Size of the largest column in the cache.
    pub(super) fn column_quads(&self) -> u64 {
        self.btfs
            .iter()
            .map(|btf| Btf::column_quads(btf))
            .max()
            .unwrap_or(0)
    }

    /// What residency may ask for: more than is on its way, so that what is asked of the source next is chosen among it by the
    /// order of now. What waits to be decoded takes at most a quarter of the host's memory: a record and a page each.
    fn in_flight_limit(&self) -> usize {
        let host = self.options.budgets.host_bytes / 4 / (2 * PAGE_BYTES);
        usize::try_from(host).unwrap_or(usize::MAX).clamp(1, MOST_ASKED)
    }
}
