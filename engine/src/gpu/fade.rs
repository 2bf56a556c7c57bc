//! New pages come in by weight over a few frames: which slots are on their way, and how far.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 3, shows pages as soon as they are there. Here the weight of a slot
//! rises from frame to frame, and shaders mix its page with what the page table had before; see `eigen.wgsl`. Frames
//! count, not time, so that the same frames give the same pictures.

use std::collections::BTreeMap;

use super::page_table::PageTable;
use crate::residency::Slot;

/// Slots whose pages fade in.
#[derive(Debug, Default)]
pub(super) struct Fade {
    /// Frames that it takes.
    pub(super) frames: u32,
    /// Frames that each slot has behind it.
    slots: BTreeMap<u32, u32>,
}

impl Fade {
    /// Fades take this many frames; 0 and 1: pages are there at once.
    pub(super) fn new(frames: u32) -> Self {
        Self {
            frames,
            slots: BTreeMap::new(),
        }
    }

    /// A slot has a new page, to be seen from the next [`Fade::step`] on.
    pub(super) fn start(&mut self, slot: Slot) {
        if self.frames > 1 {
            self.slots.insert(slot.0, 0);
        }
    }

    /// A frame: the next weights go into the table.
    pub(super) fn step(&mut self, table: &mut PageTable) {
        let frames = self.frames;
        self.slots.retain(|&slot, done| {
            *done += 1;
            table.set_slot_weight(Slot(slot), *done as f32 / frames as f32);
            *done < frames
        });
    }

    /// Whether any weight is below one.
    pub(super) fn active(&self) -> bool {
        !self.slots.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(table: &PageTable) -> Vec<f32> {
        table.entries().iter().map(|&bits| f32::from_bits(bits)).collect()
    }

    #[test]
    fn weights_rise_to_one_and_start_again_with_a_new_page() {
        let mut table = PageTable::new(Vec::new(), &[], 3);
        let mut fade = Fade::new(4);
        fade.start(Slot(1));
        for weight in [0.25, 0.5] {
            fade.step(&mut table);
            assert_eq!(weights(&table), [1.0, weight, 1.0]);
        }
        fade.start(Slot(1));
        fade.start(Slot(2));
        for weight in [0.25, 0.5, 0.75] {
            fade.step(&mut table);
            assert_eq!(weights(&table), [1.0, weight, weight]);
            assert!(fade.active());
        }
        fade.step(&mut table);
        assert!(!fade.active());
        assert_eq!(weights(&table), [1.0; 3]);
    }

    #[test]
    fn without_frames_nothing_fades() {
        for frames in [0, 1] {
            let mut fade = Fade::new(frames);
            fade.start(Slot(0));
            assert!(!fade.active());
        }
    }
}
