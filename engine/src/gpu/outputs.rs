//! What a renderer has to show, for programs that may wait.

use tileset::{Page, PageId};

use super::{readback, renderer::Renderer, resources::Materials};
use crate::{Result, metrics::Picture};

impl Renderer {
    /// A resident page as it lies in the cache, `[y][x]` with its border. Waits.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn page(&self, btf: usize, page: PageId) -> Result<Option<Page>> {
        let Materials {
            pages, page_table, ..
        } = &self.materials;
        let address = page_table.page(btf, page);
        address
            .map(|address| {
                Ok(Page {
                    texels: pages.read(&self.context, address)?,
                })
            })
            .transpose()
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

    /// Name of the adapter and its driver.
    pub fn adapter(&self) -> String {
        self.context.adapter()
    }
}
