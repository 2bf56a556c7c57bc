//! Pages and columns in and out of their slots, once a frame brought to the GPU: texels, tables, borders.

use std::sync::Arc;

use half::f16;
use shaders::mirror;
use tileset::{BORDER_TEXELS, Page, PageId, Pyramid, SLOT_TEXELS, Tile, codec::pyramid_dct::Coefficients};

use super::{
    decode::{self, Decode, Waiting},
    page_format::PageFormat,
    renderer::Renderer,
    resources::Materials,
    slot_scales::Rounded,
    stitch,
};
use crate::{Result, residency::Slot};

impl Renderer {
    /// Gives a page its slot and enters it into the page table. What its border holds counts only where a
    /// neighbour is missing, and at the outer sides of a clamped mip.
    pub fn place_page(&mut self, btf: usize, page: PageId, slot: Slot, texels: &Page) {
        let Materials {
            pages, page_table, ..
        } = &mut self.materials;
        let pyramid = page_table.pyramid(btf);
        if pages.format == PageFormat::Byte {
            let rounded = Rounded::new(Arc::new(texels.clone()), pyramid.payload(page.tile));
            return self.place_rounded(btf, page, slot, rounded);
        }
        let used = used_texels(&pyramid, page.tile);
        let texels = bytemuck::cast_slice(&texels.texels);
        pages.write(&self.context, &mut self.uploads, slot, used, texels);
        self.enter(btf, page, slot);
    }

    /// The same for a page that has been rounded already.
    pub fn place_rounded(&mut self, btf: usize, page: PageId, slot: Slot, rounded: Rounded) {
        let Materials {
            pages,
            page_table,
            slot_scales,
            ..
        } = &mut self.materials;
        if pages.format == PageFormat::Half {
            return self.place_page(btf, page, slot, rounded.page());
        }
        // A page may be its own neighbour.
        page_table.insert(btf, page, pages.grid.address(slot));
        let strips = stitch::strips_into(page_table, &mut self.known_borders, btf, page);
        let bytes = slot_scales.place(pages.grid, slot, rounded, &strips);
        let used = used_texels(&page_table.pyramid(btf), page.tile);
        let texels = bytemuck::cast_slice(&bytes);
        pages.write(&self.context, &mut self.uploads, slot, used, texels);
        self.enter(btf, page, slot);
    }

    fn enter(&mut self, btf: usize, page: PageId, slot: Slot) {
        let Materials {
            pages,
            page_table,
            fade,
            ..
        } = &mut self.materials;
        page_table.insert(btf, page, pages.grid.address(slot));
        fade.start(slot);
        self.placed.push((btf, page));
    }

    /// The same for a page that the GPU decodes, at the next [`Renderer::flush`]. Its parent must be resident; without it
    /// debug builds panic, and others leave the page out, so that coarser ones show in its place.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if there are no passes to decode with, [`crate::Error::Budget`] if the adapter has no room for their
    /// buffers.
    ///
    /// [`crate::Error::Adapter`]: crate::Error::Adapter
    /// [`crate::Error::Budget`]: crate::Error::Budget
    pub fn place_coefficients(
        &mut self,
        btf: usize,
        page: PageId,
        slot: Slot,
        coefficients: Coefficients,
    ) -> Result<()> {
        if self.decode.is_none() {
            self.decode = Some(Decode::new(&self.context)?);
        }
        let Materials {
            pages, page_table, ..
        } = &self.materials;
        let parent = decode::parent(page_table, btf, page);
        debug_assert!(
            parent.is_some(),
            "BTF {btf}: {page} is placed, but its parent is not resident"
        );
        if parent.is_some() {
            let address = pages.grid.address(slot);
            self.enter(btf, page, slot);
            self.waiting.push(Waiting {
                btf,
                page,
                address,
                coefficients,
            });
        }
        Ok(())
    }

    /// Brings the texels of what was placed to where they belong.
    pub(super) fn fill_slots(&mut self) {
        self.uploads.submit(&self.context);
        let waiting = std::mem::take(&mut self.waiting);
        let Materials {
            pages, page_table, ..
        } = &self.materials;
        if let Some(decode) = &self.decode {
            decode.run(&self.context, pages, page_table, waiting, self.timers.as_mut());
        }
    }

    /// Takes a page out of the page table.
    pub fn remove_page(&mut self, btf: usize, page: PageId) {
        self.materials.page_table.remove(btf, page);
    }

    /// Writes a column, in the [form](super::materials::Btf::cached_column) that the cache has, into a slot and enters it into the page
    /// table. Before it the group's root was worth nothing: it comes in now.
    pub fn place_column(&mut self, btf: usize, group: u16, slot: Slot, quads: Vec<[f16; 4]>) {
        self.show_filled();
        let Materials {
            pages,
            columns,
            page_table,
            fade,
            ..
        } = &mut self.materials;
        columns.write(&self.context, &mut self.uploads, slot, quads);
        page_table.set_column(btf, group, Some(columns.rows.address(slot)));
        let tile = page_table.pyramid(btf).root();
        if let Some(address) = page_table.page(btf, PageId { group, tile }) {
            fade.start(pages.grid.slot(address));
        }
    }

    /// Takes a column out of the page table.
    pub fn remove_column(&mut self, btf: usize, group: u16) {
        self.show_filled();
        self.materials.page_table.set_column(btf, group, None);
    }

    /// Whether pages are on their way in: the next [`Renderer::flush`] changes the picture.
    pub fn fading(&self) -> bool {
        self.materials.fade.active()
    }

    /// Once a frame: lets new pages fade in and writes what has changed in the page table. Returns the strips that are to be
    /// stitched.
    pub fn flush(&mut self) -> Vec<mirror::Strip> {
        let Materials {
            page_table,
            page_table_buffer,
            fade,
            slot_weights,
            slot_scales,
            raised,
            pages,
            ..
        } = &mut self.materials;
        if fade.step() {
            slot_weights.write(&self.context, &mut self.uploads, fade);
        }
        self.fading = fade.active();
        page_table.flush(|first, entries| {
            self.uploads.write_buffer(
                &self.context,
                &page_table_buffer.buffer,
                first as u64 * 4,
                bytemuck::cast_slice(entries),
            );
        });
        let mut strips = stitch::strips(
            page_table,
            &mut self.known_borders,
            std::mem::take(&mut self.placed),
        );
        if pages.format == PageFormat::Byte {
            raised.extend(slot_scales.fit(pages.grid, &mut strips));
            slot_scales.flush(&self.context, &mut self.uploads);
        }
        strips
    }

    /// Copies or decodes what was placed to its slots, and stitches the borders between the pages placed before the last
    /// [`Renderer::flush`] and all that are resident. Returns how many texels stitching took: at most [`MOST_INTO`] + [`MOST_OUT`] a page placed.
    ///
    /// [`MOST_INTO`]: super::borders::MOST_INTO
    /// [`MOST_OUT`]: super::borders::MOST_OUT
    pub fn stitch(&mut self, strips: &[mirror::Strip]) -> u64 {
        self.fill_slots();
        let raised = std::mem::take(&mut self.materials.raised);
        let (stitch, groups) = (&self.passes.stitch, &self.groups.stitch);
        stitch.run(&self.context, groups, &raised, None);
        stitch.run(&self.context, groups, strips, self.timers.as_mut())
    }
}

/// Columns and rows of a slot that a page makes use of; the packed tail may lie anywhere.
fn used_texels(pyramid: &Pyramid, tile: Tile) -> (u32, u32) {
    if tile == pyramid.root() {
        return (SLOT_TEXELS, SLOT_TEXELS);
    }
    let (width, height) = pyramid.payload(tile);
    (width + 2 * BORDER_TEXELS, height + 2 * BORDER_TEXELS)
}
