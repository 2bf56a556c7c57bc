//! Since when slots hold what they hold.

use crate::residency::{Item, Slot};

/// By slot, the frame in which its item came.
#[derive(Default)]
pub(super) struct Placed {
    pages: Vec<u64>,
    columns: Vec<u64>,
}

impl Placed {
    /// An item has come into a slot.
    pub(super) fn set(&mut self, item: Item, slot: Slot, frame: u64) {
        let frames = match item {
            Item::Page(..) => &mut self.pages,
            Item::Column(..) => &mut self.columns,
        };
        let at = slot.0 as usize;
        if frames.len() <= at {
            frames.resize(at + 1, 0);
        }
        frames[at] = frame;
    }

    /// Pages and columns stay only where these moves lead, from slot to slot.
    pub(super) fn move_to(&mut self, pages: &[(Slot, Slot)], columns: &[(Slot, Slot)]) {
        let before = std::mem::take(self);
        for (frames, before, moves) in [
            (&mut self.pages, before.pages, pages),
            (&mut self.columns, before.columns, columns),
        ] {
            let slots = moves.iter().map(|(_, to)| to.0 as usize + 1).max();
            frames.resize(slots.unwrap_or(0), 0);
            for (from, to) in moves {
                frames[to.0 as usize] = before.get(from.0 as usize).copied().unwrap_or(0);
            }
        }
    }

    /// Of pages, by slot, as far as any has been used.
    pub(super) fn pages(&self) -> &[u64] {
        &self.pages
    }

    /// Of the item in a slot.
    pub(super) fn frame(&self, item: Item, slot: Slot) -> u64 {
        let frames = match item {
            Item::Page(..) => &self.pages,
            Item::Column(..) => &self.columns,
        };
        frames.get(slot.0 as usize).copied().unwrap_or(0)
    }
}
