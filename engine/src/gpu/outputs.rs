//! What a renderer has to show, for programs that may wait.

use tileset::{Page, PageId};

use super::{context::Context, page_format::PageFormat, readback, renderer::Renderer, resources::Materials};
use crate::{Result, metrics::Picture};

impl Renderer {
    /// A resident page as it lies in the cache, `[y][x]` with its border. Waits.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn page(&self, btf: usize, page: PageId) -> Result<Option<Page>> {
        let Materials {
            pages,
            page_table,
            slot_scales,
            ..
        } = &self.materials;
        let Some(address) = page_table.page(btf, page) else {
            return Ok(None);
        };
        let bytes = pages.read(&self.context, address)?;
        let texels = match pages.format {
            PageFormat::Half => bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect(),
            PageFormat::Byte => slot_scales.halves(pages.grid.slot(address), &bytes),
        };
        Ok(Some(Page { texels }))
    }

    /// Mean squared error that rounding has done to what a BTF shows at a tile, by its index: the sum over all groups that
    /// have a column, before `texture_scale`. 0 where the page cache holds half floats.
    pub fn rounding_mse(&self, btf: usize, tile: u32) -> f64 {
        let Materials {
            pages,
            page_table,
            slot_scales,
            ..
        } = &self.materials;
        let shown = page_table.shown(btf, tile);
        shown
            .map(|address| slot_scales.mse(pages.grid.slot(address)))
            .sum()
    }

    /// The last picture, linear. Waits.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn picture(&self) -> Result<Picture> {
        let bytes = readback::texels(&self.context, &self.targets.picture)?;
        let (width, height) = self.targets.size;
        let pixels = bytes.chunks_exact(16).map(|pixel| {
            let [r, g, b, _]: [f32; 4] = bytemuck::pod_read_unaligned(pixel);
            [r, g, b]
        });
        Ok(Picture {
            width,
            height,
            pixels: pixels.collect(),
        })
    }

    /// The last picture in 8-bit sRGB with alpha. Waits.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn tonemapped(&self) -> Result<Vec<u8>> {
        readback::texels(&self.context, &self.targets.screen)
    }

    /// For each pixel its instance, counted from 1, and triangle; 0 where nothing is. Waits.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn visibility(&self) -> Result<Vec<[u32; 2]>> {
        let bytes = readback::texels(&self.context, &self.targets.ids.visibility)?;
        Ok(bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect())
    }

    /// The device.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Name of the adapter and its driver.
    pub fn adapter(&self) -> String {
        self.context.adapter()
    }
}
