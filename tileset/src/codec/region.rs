//! The texels of a page that are coded: where they lie in the slot and in the mip.

use super::{MipImage, dct::BLOCK, texel::Texel};
use crate::{BORDER_TEXELS, Error, PAGE_TEXELS, Pyramid, Result, Tile};

/// The largest half float.
pub(crate) const HALF_MAX: f32 = 65504.0;

/// The coded texels of one page: payload and border, or for the tail the payload of its finest mip alone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Region {
    /// Texels.
    pub width: usize,
    /// Texels.
    pub height: usize,
    /// Texels between the region's and the slot's left and upper side.
    pub slot_origin: usize,
    /// Position of the first texel in the mip; negative in the border at the left.
    pub mip_x: i64,
    /// Position of the first texel in the mip.
    pub mip_y: i64,
}

impl Region {
    /// # Errors
    /// [`Error::NotFound`] if the pyramid has no such tile.
    pub(crate) fn new(pyramid: &Pyramid, tile: Tile) -> Result<Self> {
        if pyramid.tile_index(tile).is_none() {
            return Err(Error::NotFound {
                what: format!("page mip {} x {} y {}", tile.mip, tile.x, tile.y),
                detail: format!("the coarsest page is in mip {}", pyramid.tail_mip()),
            });
        }
        // The border of the tail follows from its payload, so only that is coded.
        let border = if tile == pyramid.root() { 0 } else { BORDER_TEXELS };
        let (width, height) = pyramid.payload(tile);
        let start = |page: u16| i64::from(page) * i64::from(PAGE_TEXELS) - i64::from(border);
        Ok(Self {
            width: (width + 2 * border) as usize,
            height: (height + 2 * border) as usize,
            slot_origin: (BORDER_TEXELS - border) as usize,
            mip_x: start(tile.x),
            mip_y: start(tile.y),
        })
    }

    /// Columns and rows of 8×8 blocks; the last ones may reach beyond the region.
    pub(crate) fn blocks(&self) -> (usize, usize) {
        (self.width.div_ceil(BLOCK), self.height.div_ceil(BLOCK))
    }

    /// Columns and rows of the region that are payload.
    pub(crate) fn payload(&self) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let border = BORDER_TEXELS as usize - self.slot_origin;
        (border..self.width - border, border..self.height - border)
    }

    /// The wanted texels, row by row; the border shows what the wrapped or clamped mip has there.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a value that a half float cannot hold.
    pub(crate) fn cut(&self, mip: &MipImage, wrap: bool) -> Result<Vec<Texel>> {
        let columns: Vec<usize> = (self.mip_x..)
            .take(self.width)
            .map(|x| address(x, mip.width, wrap))
            .collect();
        let mut texels = Vec::with_capacity(self.width * self.height);
        for y in (self.mip_y..).take(self.height) {
            let row = &mip.texels[address(y, mip.height, wrap) * mip.width as usize..];
            texels.extend(columns.iter().map(|&x| Texel(row[x])));
        }
        if let Some(bad) = texels
            .iter()
            .flat_map(|texel| texel.0)
            .find(|value| !(-HALF_MAX..=HALF_MAX).contains(value))
        {
            return Err(Error::Invalid {
                what: "value of an eigen-texture".into(),
                detail: format!("{bad} is not a number within ±{HALF_MAX}, scale the textures down"),
            });
        }
        Ok(texels)
    }
}

/// The texel of a side of `size` texels that is seen at `position`.
pub(crate) fn address(position: i64, size: u32, wrap: bool) -> usize {
    let size = i64::from(size);
    (if wrap {
        position.rem_euclid(size)
    } else {
        position.clamp(0, size - 1)
    }) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_wrap_and_clamp() {
        let all = |wrap| (-4..7).map(|i| address(i, 3, wrap)).collect::<Vec<_>>();
        assert_eq!(all(true), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0]);
        assert_eq!(all(false), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2]);
    }
}
