//! New pages come in by weight over a few frames: which slots are on their way, and how far.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 3, shows pages as soon as they are there. Here the weight of a slot
//! rises from frame to frame, and shaders mix its page with what the page table had before; see `eigen.wgsl`. Frames
//! count, not time, so that the same frames give the same pictures.

use std::collections::BTreeMap;

use super::{context::Context, targets, uploads::Uploads};
use crate::residency::Slot;

/// Slots in a row of the texture of weights; see `eigen.wgsl`.
const ROW: u32 = 256;

/// Slots whose pages fade in.
#[derive(Debug, Default)]
pub(super) struct Fade {
    /// Frames that it takes; 0 and 1: pages are there at once.
    pub(super) frames: u32,
    /// Frames that each slot has behind it.
    slots: BTreeMap<u32, u32>,
    /// By slot; those that are not here are one.
    weights: Vec<f32>,
}

impl Fade {
    /// For a cache of so many slots, in none of which a page fades.
    pub(super) fn new(frames: u32, slots: u32) -> Self {
        Self {
            frames,
            slots: BTreeMap::new(),
            weights: vec![1.0; slots.next_multiple_of(ROW) as usize],
        }
    }

    /// For a cache of another number of slots, to which pages have moved from slot to slot.
    pub(super) fn moved(&self, slots: u32, moves: impl Iterator<Item = (Slot, Slot)>) -> Self {
        let mut fade = Self::new(self.frames, slots);
        for (from, to) in moves {
            fade.weights[to.0 as usize] = self.weights[from.0 as usize];
            if let Some(&done) = self.slots.get(&from.0) {
                fade.slots.insert(to.0, done);
            }
        }
        fade
    }

    /// A slot has a new page, to be seen from the next [`Fade::step`] on.
    pub(super) fn start(&mut self, slot: Slot) {
        if self.frames > 1 {
            self.slots.insert(slot.0, 0);
        }
    }

    /// A frame. Returns whether there are other weights.
    pub(super) fn step(&mut self) -> bool {
        let any = self.active();
        let (frames, weights) = (self.frames, &mut self.weights);
        self.slots.retain(|&slot, done| {
            *done += 1;
            weights[slot as usize] = *done as f32 / frames as f32;
            *done < frames
        });
        any
    }

    /// Whether any page is still coming in.
    pub(super) fn active(&self) -> bool {
        !self.slots.is_empty()
    }

    /// The weights.
    pub(super) fn weights(&self) -> &[f32] {
        &self.weights
    }
}

/// The weights on the GPU.
pub(super) struct SlotWeights {
    texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

impl SlotWeights {
    pub(super) fn new(context: &Context, fade: &Fade) -> Self {
        let size = wgpu::Extent3d {
            width: ROW,
            height: fade.weights().len() as u32 / ROW,
            depth_or_array_layers: 1,
        };
        let texture = context.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("weights of slots"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        let weights = Self { texture, view };
        let (size, bytes) = weights.contents(fade);
        targets::write(
            context,
            &weights.texture,
            wgpu::Origin3d::ZERO,
            size,
            ROW * 4,
            bytes,
        );
        weights
    }

    pub(super) fn write(&self, context: &Context, uploads: &mut Uploads, fade: &Fade) {
        let (size, bytes) = self.contents(fade);
        uploads.write(context, &self.texture, wgpu::Origin3d::ZERO, size, ROW * 4, bytes);
    }

    fn contents<'a>(&self, fade: &'a Fade) -> ((u32, u32), &'a [u8]) {
        let size = (self.texture.width(), self.texture.height());
        (size, bytemuck::cast_slice(fade.weights()))
    }

    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.texture.width()) * u64::from(self.texture.height()) * 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_rise_to_one_and_start_again_with_a_new_page() {
        let mut fade = Fade::new(4, 3);
        fade.start(Slot(1));
        for weight in [0.25, 0.5] {
            assert!(fade.step());
            assert_eq!(fade.weights()[..3], [1.0, weight, 1.0]);
        }
        fade.start(Slot(1));
        fade.start(Slot(2));
        for weight in [0.25, 0.5, 0.75] {
            fade.step();
            assert_eq!(fade.weights()[..3], [1.0, weight, weight]);
            assert!(fade.active());
        }
        assert!(fade.step());
        assert!(!fade.active());
        assert_eq!(fade.weights()[..3], [1.0; 3]);
        assert!(!fade.step());
    }

    #[test]
    fn pages_that_move_go_on_where_they_were() {
        let mut fade = Fade::new(4, 300);
        fade.start(Slot(299));
        fade.start(Slot(0));
        fade.step();
        let mut moved = fade.moved(5, [(Slot(299), Slot(2)), (Slot(7), Slot(0))].into_iter());
        assert_eq!(moved.weights()[..5], [1.0, 1.0, 0.25, 1.0, 1.0]);
        moved.step();
        assert_eq!(moved.weights()[..5], [1.0, 1.0, 0.5, 1.0, 1.0]);
    }

    #[test]
    fn without_frames_nothing_fades() {
        for frames in [0, 1] {
            let mut fade = Fade::new(frames, 1);
            fade.start(Slot(0));
            assert!(!fade.active());
        }
    }
}
