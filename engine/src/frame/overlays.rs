//! What covers the picture, and what it has to be told for that.

use super::Engine;
use crate::{
    Result,
    gpu::{cutoff::energies, materials::Btf},
    overlay::Overlay,
};

/// Energies beyond this are told as this: differences stay numbers.
const MOST_ENERGY: f64 = 1e30;

/// The overlay that is chosen.
pub(super) struct Chosen {
    pub(super) overlay: Overlay,
    opacity: f32,
    /// BTFs whose energies it knows.
    known: usize,
    /// The screen has to be drawn again.
    changed: bool,
}

impl Default for Chosen {
    fn default() -> Self {
        Self {
            overlay: Overlay::None,
            opacity: 0.7,
            known: 0,
            changed: false,
        }
    }
}

impl Engine {
    /// Chooses what the next pictures on the screen ([`Engine::tonemapped`]) are covered with; [`Engine::picture`] stays as it
    /// is. Without an overlay nothing of this takes time or memory.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn set_overlay(&mut self, overlay: Overlay) -> Result<()> {
        if overlay != self.chosen.overlay {
            self.renderer.set_overlay(overlay)?;
            self.chosen.overlay = overlay;
            self.chosen.known = 0;
            self.chosen.changed = true;
        }
        Ok(())
    }

    /// The overlay.
    pub fn overlay(&self) -> Overlay {
        self.chosen.overlay
    }

    /// How much of the picture overlays cover: 0 nothing, 1 all. 0.7 at first.
    pub fn set_overlay_opacity(&mut self, opacity: f32) {
        let opacity = if opacity.is_finite() {
            opacity.clamp(0.0, 1.0)
        } else {
            1.0
        };
        self.chosen.changed |= opacity != self.chosen.opacity && self.chosen.overlay != Overlay::None;
        self.chosen.opacity = opacity;
    }

    /// How much of the picture overlays cover.
    pub fn overlay_opacity(&self) -> f32 {
        self.chosen.opacity
    }

    /// Tells the overlay what it has to know. Returns whether the screen has to be drawn although the picture has not changed.
    pub(super) fn tell_overlay(&mut self) -> Result<bool> {
        let changed = std::mem::take(&mut self.chosen.changed);
        match self.chosen.overlay {
            Overlay::None => return Ok(changed),
            Overlay::Age => {
                // Of the cache that is shown: while it is an old one its pages are as old as can be.
                let frames = if self.renderer.keeps() {
                    &[][..]
                } else {
                    self.placed.pages()
                };
                let mut words: Vec<u32> = frames.iter().map(|frame| *frame as u32).collect();
                words.resize(
                    self.renderer.slots().0 as usize,
                    self.frames.wrapping_sub(1 << 20) as u32,
                );
                self.renderer.set_overlay_knowledge(&words)?;
            }
            Overlay::PredictedError => {
                for btf in &self.btfs[self.chosen.known..] {
                    self.renderer.add_overlay_knowledge(&table_of_energies(btf))?;
                }
                self.chosen.known = self.btfs.len();
            }
            _ => {}
        }
        self.renderer.tune_overlay(self.chosen.opacity, self.frames);
        Ok(changed || self.chosen.overlay == Overlay::Age)
    }
}

/// A word for each entry that the BTF has in the page table: the bits of the energy as f32 for pages, zeros elsewhere.
fn table_of_energies(btf: &Btf) -> Vec<u32> {
    let groups = usize::from(btf.groups());
    let mut words = vec![0; groups + 1];
    for tile in energies(&btf.index).chunks_exact(groups.max(1)) {
        words.push(0);
        words.extend(
            tile.iter()
                .map(|energy| (energy.min(MOST_ENERGY) as f32).to_bits()),
        );
    }
    words
}
