//! Who decides what is resident: residency, or what it is measured against.

use crate::residency::{
    Item, Limits, MaterialId, MaterialInfo, Placement, Plan, Residency, Resized, Slot, Summary, Vote,
};

/// The contract of [`Residency`]: votes in, operations out. A program has no use for another implementation; measurements
/// compare with some ([`super::Engine::with_policy`]).
///
/// What is resident must be closed: a page is placed only while its parent is resident, and gives way before its parent.
pub trait Policy {
    /// Registers a material; ids count up from 0.
    fn add_material(&mut self, info: MaterialInfo);
    /// Sets new limits and says what has to go for them.
    fn set_limits(&mut self, limits: Limits) -> Resized;
    /// Takes the newest votes, and votes for what may be seen soon, and says what to ask for.
    fn update(&mut self, votes: &[Vote], ahead: &[Vote]) -> Plan;
    /// An item that was asked for is here and decoded.
    fn arrived(&mut self, item: Item) -> Placement;
    /// An item that was asked for cannot be had now.
    fn failed(&mut self, item: Item);
    /// Where an item is.
    fn slot(&self, item: Item) -> Option<Slot>;
    /// Everything that is resident, pages first, each cache in the order of its slots.
    fn resident(&self) -> Vec<(Item, Slot)>;
    /// What is in flight and what will be asked for next, best first; records may come early. None where nothing is known.
    fn upcoming(&mut self, _most: usize) -> Vec<Item> {
        Vec::new()
    }
    /// What has failed may be asked for again at once.
    fn retry(&mut self) {}
    /// Whether an item that may not be asked for yet is still worth having.
    fn wants(&self, _item: Item) -> bool {
        true
    }
    /// Says that nothing more of a material can be had, or, with `false`, that it can again.
    fn set_retired(&mut self, _material: MaterialId, _retired: bool) {}
    /// Whether an item stays as long as its material is seen.
    fn is_pinned(&self, _item: Item) -> bool {
        false
    }
    /// Of a material the squared errors, summed over all pixels, of what is not resident, and of all; zeros where nothing is known.
    fn errors(&self, _material: MaterialId) -> [f64; 2] {
        [0.0; 2]
    }
    /// What is known after the last update and the arrivals since.
    fn summary(&self) -> Summary;
}

impl Policy for Residency {
    fn add_material(&mut self, info: MaterialInfo) {
        Residency::add_material(self, info);
    }
    fn set_limits(&mut self, limits: Limits) -> Resized {
        Residency::set_limits(self, limits)
    }
    fn update(&mut self, votes: &[Vote], ahead: &[Vote]) -> Plan {
        Residency::update(self, votes, ahead)
    }
    fn arrived(&mut self, item: Item) -> Placement {
        Residency::arrived(self, item)
    }
    fn failed(&mut self, item: Item) {
        Residency::failed(self, item);
    }
    fn slot(&self, item: Item) -> Option<Slot> {
        Residency::slot(self, item)
    }
    fn resident(&self) -> Vec<(Item, Slot)> {
        Residency::resident(self)
    }
    fn upcoming(&mut self, most: usize) -> Vec<Item> {
        Residency::upcoming(self, most)
    }
    fn retry(&mut self) {
        Residency::retry(self);
    }
    fn wants(&self, item: Item) -> bool {
        Residency::wants(self, item)
    }
    fn set_retired(&mut self, material: MaterialId, retired: bool) {
        Residency::set_retired(self, material, retired);
    }
    fn is_pinned(&self, item: Item) -> bool {
        Residency::is_pinned(self, item)
    }
    fn errors(&self, material: MaterialId) -> [f64; 2] {
        Residency::errors(self, material)
    }
    fn summary(&self) -> Summary {
        Residency::summary(self)
    }
}
