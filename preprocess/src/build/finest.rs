//! The finest mip of a group, put together from decoded pages.

use half::f16;
use tileset::{Page, Pyramid, SLOT_TEXELS, Tile};

/// One group's eigen-textures at mip 0 as a decoder sees them, `[y][x][component of the group]`, scaled as stored.
pub(crate) struct Finest {
    pub(crate) texels: Vec<[f16; 4]>,
}

impl Finest {
    pub(crate) fn new(pyramid: &Pyramid) -> Self {
        let (width, height) = pyramid.mip_size(0);
        Self {
            texels: vec![[f16::ZERO; 4]; width as usize * height as usize],
        }
    }

    /// Copies the payload of a page of mip 0; other pages change nothing.
    pub(crate) fn put(&mut self, pyramid: &Pyramid, tile: Tile, page: &Page) {
        if tile.mip != 0 {
            return;
        }
        let stride = pyramid.mip_size(0).0 as usize;
        let (width, height) = pyramid.payload(tile);
        let (left, top) = pyramid.payload_origin(tile, 0);
        let (x, y) = (
            u32::from(tile.x) * tileset::PAGE_TEXELS,
            u32::from(tile.y) * tileset::PAGE_TEXELS,
        );
        for row in 0..height {
            let from = ((top + row) * SLOT_TEXELS + left) as usize;
            let to = (y + row) as usize * stride + x as usize;
            let width = width as usize;
            self.texels[to..to + width].copy_from_slice(&page.texels[from..from + width]);
        }
    }
}
