//! Residency of leading component groups.

use engine::frame::Policy;
use engine::residency::{
    Item, Limits, MaterialId, MaterialInfo, Placement, Plan, Residency, Resized, Slot, Summary, Vote,
};

/// Residency that is told of a share of each material's component groups, the leading ones: nothing is ever asked for of the
/// others, neither pages nor columns.
pub(crate) struct Capped {
    inner: Residency,
    share: f64,
}

/// So many of these groups: at least one.
pub(crate) fn groups(all: u16, share: f64) -> u16 {
    ((f64::from(all) * share).ceil() as u16).clamp(1, all.max(1))
}

impl Capped {
    pub(crate) fn new(share: f64) -> Self {
        let limits = Limits {
            page_slots: 0,
            column_slots: 0,
            in_flight: 1,
            bytes_in_flight: 1,
        };
        Self {
            inner: Residency::new(limits),
            share,
        }
    }
}

impl Policy for Capped {
    fn add_material(&mut self, mut info: MaterialInfo) {
        // Lists by page are group by group: what lies behind the leading groups is cut off.
        info.groups = groups(info.groups, self.share);
        let pages = usize::from(info.groups) * info.pyramid.tile_count() as usize;
        info.weights.truncate(pages);
        info.page_bytes.truncate(pages);
        info.column_bytes.truncate(info.groups.into());
        self.inner.add_material(info);
    }
    fn set_limits(&mut self, limits: Limits) -> Resized {
        self.inner.set_limits(limits)
    }
    fn update(&mut self, votes: &[Vote], ahead: &[Vote]) -> Plan {
        self.inner.update(votes, ahead)
    }
    fn arrived(&mut self, item: Item) -> Placement {
        self.inner.arrived(item)
    }
    fn failed(&mut self, item: Item) {
        self.inner.failed(item);
    }
    fn slot(&self, item: Item) -> Option<Slot> {
        self.inner.slot(item)
    }
    fn resident(&self) -> Vec<(Item, Slot)> {
        self.inner.resident()
    }
    fn upcoming(&mut self, most: usize) -> Vec<Item> {
        self.inner.upcoming(most)
    }
    fn set_retired(&mut self, material: MaterialId, retired: bool) {
        self.inner.set_retired(material, retired);
    }
    fn summary(&self) -> Summary {
        self.inner.summary()
    }
}
