//! Mips and tiles of a material.
//!
//! Mip 0 is the finest; each next one has half the side, rounded up, so that the tile at (x, y) always has a
//! parent at (x/2, y/2). Mips whose sides are both at most [`TAIL_TEXELS`] are packed into one page, the mip
//! tail: it is the root of the quadtree and reaches down to 1×1, so that minification never aliases.
//!
//! A [`Tile`] is a place in the pyramid, shared by all component groups; a [`PageId`] is one group's page
//! there.

use crate::{BORDER_TEXELS, Error, MAX_SIDE_TEXELS, PAGE_TEXELS, Result, TAIL_TEXELS};

/// A place in the pyramid: the mip, and the page's column and row in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tile {
    /// Mip; 0 is the finest, [`Pyramid::tail_mip`] the packed tail.
    pub mip: u8,
    /// Column of the page.
    pub x: u16,
    /// Row of the page.
    pub y: u16,
}

/// A page of one archive: a component group at a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PageId {
    /// Component group; group g holds components 4g to 4g+3.
    pub group: u16,
    /// Where.
    pub tile: Tile,
}

impl std::fmt::Display for PageId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Tile { mip, x, y } = self.tile;
        write!(f, "page group {} mip {mip} x {x} y {y}", self.group)
    }
}

/// The geometry of a material's mips and pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pyramid {
    width: u32,
    height: u32,
    wrap: bool,
}

impl Pyramid {
    /// The pyramid of a material of `width` × `height` texels that repeats (`wrap`) or is clamped.
    ///
    /// # Errors
    /// [`Error::OverLimit`] if a side exceeds [`MAX_SIDE_TEXELS`], [`Error::Invalid`] if one is zero.
    pub fn new(width: u32, height: u32, wrap: bool) -> Result<Self> {
        if width == 0 || height == 0 {
            return Err(Error::Invalid {
                what: format!("material of {width}x{height} texels"),
                detail: "both sides must be at least one texel".into(),
            });
        }
        let side = width.max(height);
        if side > MAX_SIDE_TEXELS {
            return Err(Error::OverLimit {
                what: "side of the material in texels",
                found: side.into(),
                limit: MAX_SIDE_TEXELS.into(),
            });
        }
        Ok(Self { width, height, wrap })
    }

    /// Whether the material repeats.
    pub fn wrap(&self) -> bool {
        self.wrap
    }

    /// Width and height of a mip, in texels; mips beyond the last are 1×1.
    pub fn mip_size(&self, mip: u8) -> (u32, u32) {
        // Rounded up.
        let halved = |side: u32| (side - 1).checked_shr(mip.into()).unwrap_or(0) + 1;
        (halved(self.width), halved(self.height))
    }

    /// Number of mips, down to and including 1×1.
    pub fn mip_count(&self) -> u8 {
        let side = self.width.max(self.height);
        (u32::BITS - (side - 1).leading_zeros()) as u8 + 1
    }

    /// The finest mip that lies in the packed tail; also the mip of the root's [`Tile`].
    pub fn tail_mip(&self) -> u8 {
        (self.mip_count() - 1).saturating_sub(TAIL_TEXELS.ilog2() as u8)
    }

    /// The root: the packed mip tail.
    pub fn root(&self) -> Tile {
        Tile {
            mip: self.tail_mip(),
            x: 0,
            y: 0,
        }
    }

    /// Columns and rows of pages in a mip; one page from the tail on.
    pub fn grid(&self, mip: u8) -> (u32, u32) {
        if mip >= self.tail_mip() {
            return (1, 1);
        }
        let (width, height) = self.mip_size(mip);
        (width.div_ceil(PAGE_TEXELS), height.div_ceil(PAGE_TEXELS))
    }

    /// Number of tiles in all mips; each group has as many pages.
    pub fn tile_count(&self) -> u32 {
        (0..=self.tail_mip())
            .map(|mip| self.grid(mip).0 * self.grid(mip).1)
            .sum()
    }

    /// Index of the first tile of a mip in the order of [`Pyramid::tile_index`].
    pub fn mip_base(&self, mip: u8) -> u32 {
        (mip.saturating_add(1)..=self.tail_mip())
            .map(|mip| self.grid(mip).0 * self.grid(mip).1)
            .sum()
    }

    /// Index of a tile: coarse to fine, row by row; 0 is the root. `None` if there is no such tile.
    pub fn tile_index(&self, tile: Tile) -> Option<u32> {
        self.contains(tile).then(|| {
            let (columns, _) = self.grid(tile.mip);
            self.mip_base(tile.mip) + u32::from(tile.y) * columns + u32::from(tile.x)
        })
    }

    /// Whether there is such a tile.
    pub fn contains(&self, tile: Tile) -> bool {
        let (columns, rows) = self.grid(tile.mip);
        tile.mip <= self.tail_mip() && u32::from(tile.x) < columns && u32::from(tile.y) < rows
    }

    /// The tile with this index: the inverse of [`Pyramid::tile_index`].
    pub fn tile_at(&self, index: u32) -> Option<Tile> {
        let mut base = 0;
        for mip in (0..=self.tail_mip()).rev() {
            let (columns, rows) = self.grid(mip);
            if index < base + columns * rows {
                let local = index - base;
                return Some(Tile {
                    mip,
                    x: (local % columns) as u16,
                    y: (local / columns) as u16,
                });
            }
            base += columns * rows;
        }
        None
    }

    /// All tiles, in the order of their indices.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + '_ {
        (0..self.tile_count()).filter_map(|index| self.tile_at(index))
    }

    /// The next coarser tile that covers this one; `None` for the root and for what lies outside the pyramid.
    pub fn parent(&self, tile: Tile) -> Option<Tile> {
        let inside = tile.mip < self.tail_mip() && self.contains(tile);
        inside.then(|| Tile {
            mip: tile.mip + 1,
            x: tile.x / 2,
            y: tile.y / 2,
        })
    }

    /// The up to four next finer tiles; none for a tile outside the pyramid.
    pub fn children(&self, tile: Tile) -> impl Iterator<Item = Tile> + use<> {
        let mip = tile.mip.checked_sub(1).filter(|_| self.contains(tile));
        let (columns, rows) = mip.map_or((0, 0), |mip| self.grid(mip));
        (0..4u32).filter_map(move |i| {
            let (x, y) = (u32::from(tile.x) * 2 + i % 2, u32::from(tile.y) * 2 + i / 2);
            (x < columns && y < rows).then_some(Tile {
                mip: mip?,
                x: x as u16,
                y: y as u16,
            })
        })
    }

    /// Width and height of a tile's payload, in texels; for the root that of the tail's finest mip. Zero
    /// for a tile outside the pyramid.
    pub fn payload(&self, tile: Tile) -> (u32, u32) {
        let (width, height) = self.mip_size(tile.mip);
        (
            width
                .saturating_sub(u32::from(tile.x) * PAGE_TEXELS)
                .min(PAGE_TEXELS),
            height
                .saturating_sub(u32::from(tile.y) * PAGE_TEXELS)
                .min(PAGE_TEXELS),
        )
    }

    /// Where in the slot of a tile's page the payload of `mip` begins, in texels.
    ///
    /// Ordinary pages hold their payload behind the border. The tail packs its mips, each with its own
    /// border: the finest at the left, the others in a column beside it and in a second row; see
    /// [`TAIL_ORIGINS`]. Mips beyond the last lie where the last does.
    pub fn payload_origin(&self, tile: Tile, mip: u8) -> (u32, u32) {
        let coarsest = self.mip_count() - 1 - self.tail_mip();
        let packed = if tile.mip == self.tail_mip() {
            mip.saturating_sub(tile.mip).min(coarsest)
        } else {
            0
        };
        let (x, y) = TAIL_ORIGINS[usize::from(packed)];
        (x + BORDER_TEXELS, y + BORDER_TEXELS)
    }
}

/// Upper left corners, in texels, of the bordered mips of the tail: sides 40, 24, 16, 12, 10 and 9.
pub const TAIL_ORIGINS: [(u32, u32); 6] = [(0, 0), (40, 0), (0, 40), (16, 40), (28, 40), (38, 40)];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SLOT_TEXELS;
    use proptest::prelude::*;

    const SIZES: [(u32, u32); 9] = [
        (1, 1),
        (32, 32),
        (33, 1),
        (1, 4096),
        (346, 335),
        (2048, 2048),
        (64, 65),
        (129, 5),
        (1 << 16, 3),
    ];

    fn check(width: u32, height: u32) {
        let pyramid = Pyramid::new(width, height, true).unwrap();
        let mut size = (width, height);
        for mip in 0..pyramid.mip_count() {
            assert_eq!(pyramid.mip_size(mip), size);
            assert_eq!(size == (1, 1), mip + 1 == pyramid.mip_count());
            size = (size.0.div_ceil(2), size.1.div_ceil(2));
        }
        assert_eq!(pyramid.tile_at(0), Some(pyramid.root()));
        assert_eq!(pyramid.tile_at(pyramid.tile_count()), None);

        let mut covered = vec![0u64; usize::from(pyramid.tail_mip()) + 1];
        for (index, tile) in (0..).zip(pyramid.tiles()) {
            assert_eq!(pyramid.tile_index(tile), Some(index));
            let (width, height) = pyramid.payload(tile);
            assert!((1..=PAGE_TEXELS).contains(&width) && (1..=PAGE_TEXELS).contains(&height));
            covered[usize::from(tile.mip)] += u64::from(width * height);
            match pyramid.parent(tile) {
                None => assert_eq!(tile, pyramid.root()),
                Some(parent) => {
                    assert!(pyramid.tile_index(parent).unwrap() < index);
                    assert_eq!(pyramid.children(parent).filter(|child| *child == tile).count(), 1);
                }
            }
            assert!(
                pyramid
                    .children(tile)
                    .all(|child| pyramid.parent(child) == Some(tile))
            );
        }
        for (mip, covered) in (0..).zip(covered) {
            let (width, height) = pyramid.mip_size(mip);
            assert_eq!(
                covered,
                u64::from(width) * u64::from(height),
                "payloads tile mip {mip}"
            );
        }
    }

    fn check_tail(width: u32, height: u32) {
        let pyramid = Pyramid::new(width, height, false).unwrap();
        let mut taken = vec![false; crate::SLOT_AREA];
        for mip in pyramid.tail_mip()..pyramid.mip_count() {
            let (x, y) = pyramid.payload_origin(pyramid.root(), mip);
            let (width, height) = pyramid.mip_size(mip);
            for y in y - BORDER_TEXELS..y + height + BORDER_TEXELS {
                for x in x - BORDER_TEXELS..x + width + BORDER_TEXELS {
                    assert!(
                        x < SLOT_TEXELS && y < SLOT_TEXELS,
                        "mip {mip} lies inside the slot"
                    );
                    let place = &mut taken[(y * SLOT_TEXELS + x) as usize];
                    assert!(!*place, "mip {mip} overlaps another at {x}, {y}");
                    *place = true;
                }
            }
        }
    }

    #[test]
    fn pyramids_of_awkward_sizes_are_whole() {
        for (width, height) in SIZES {
            check(width, height);
            check_tail(width, height);
        }
    }

    #[test]
    fn sizes_beyond_the_limits_are_refused() {
        assert!(matches!(Pyramid::new(0, 1, true), Err(Error::Invalid { .. })));
        assert!(matches!(
            Pyramid::new(1, (1 << 16) + 1, true),
            Err(Error::OverLimit { .. })
        ));
    }

    proptest! {
        #[test]
        fn pyramids_are_whole(width in 1u32..700, height in 1u32..700) {
            check(width, height);
            check_tail(width, height);
        }

        #[test]
        fn nothing_panics_outside_the_pyramid(
            width in 1u32..=1 << 16, height in 1u32..=1 << 16, mip: u8, x: u16, y: u16, index: u32,
        ) {
            let pyramid = Pyramid::new(width, height, true).unwrap();
            let tile = Tile { mip, x, y };
            let inside = pyramid.tile_index(tile).is_some();
            prop_assert!(inside || (pyramid.parent(tile).is_none() && pyramid.children(tile).count() == 0));
            prop_assert!(pyramid.mip_base(mip) <= pyramid.tile_count());
            let (left, top) = pyramid.payload_origin(tile, mip);
            let (width, height) = pyramid.payload(tile);
            prop_assert!(left + width <= SLOT_TEXELS && top + height <= SLOT_TEXELS);
            prop_assert_eq!(pyramid.tile_at(index).is_some(), index < pyramid.tile_count());
        }
    }
}
