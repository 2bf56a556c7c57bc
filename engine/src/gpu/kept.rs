//! What stays in the picture while the page cache fills anew in another format.
//!
//! The old cache and the page table as it was are drawn on until [`Renderer::show_filled`]; meanwhile pages are placed and stitched
//! in the new one, which nobody sees. Columns are in both tables: where one comes or goes, keeping ends.

use super::{
    fade::{Fade, SlotWeights},
    page_cache::PageCache,
    renderer::Renderer,
    resources::Groups,
    slot_scales::SlotScales,
};

/// What slots hold, with weights and scales.
pub(super) struct Slots {
    pub(super) pages: PageCache,
    pub(super) weights: SlotWeights,
    pub(super) scales: SlotScales,
}

/// The old cache, and what draws from it.
pub(super) struct Kept {
    pub(super) slots: Slots,
    table: wgpu::Buffer,
    pub(super) caches: wgpu::BindGroup,
}

impl Kept {
    pub(super) fn bytes(&self) -> u64 {
        let Slots {
            pages,
            weights,
            scales,
        } = &self.slots;
        pages.bytes() + weights.bytes() + scales.bytes() + self.table.size()
    }
}

impl Renderer {
    /// Draws on from slots that have just been replaced, by the page table as the GPU has it: not yet told of what has
    /// been removed since the last [`Renderer::flush`].
    pub(super) fn keep(&mut self, mut slots: Slots) {
        let context = &self.context;
        // Nothing fades in any more.
        let whole = Fade::new(0, slots.pages.grid.slots());
        slots.weights = SlotWeights::new(context, &whole);
        let current = &self.materials.page_table_buffer.buffer;
        let table = context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("page tables before"),
            size: current.size(),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = context.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(current, 0, &table, 0, current.size());
        context.queue.submit([encoder.finish()]);
        let caches = Groups::caches(
            context,
            &self.passes,
            &table,
            &self.materials.directions.buffer,
            &slots.pages,
            &slots.weights,
            &slots.scales,
        );
        self.kept = Some(Kept { slots, table, caches });
    }

    /// Whether the picture shows an old page cache while the new one fills.
    pub fn keeps(&self) -> bool {
        self.kept.is_some()
    }

    /// Shows the page cache as it is, and lets an older one go.
    pub fn show_filled(&mut self) {
        if self.kept.take().is_some() {
            self.bind();
        }
    }
}
