//! What lies where: snapshots of the caches and of the page trees, made when they are asked for.

use tileset::PageId;

use super::Engine;
use crate::residency::{Item, MaterialId, Slot};

/// What a slot of the page cache holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CachedPage {
    /// Index into [`Engine::materials`].
    pub material: usize,
    /// Component group, mip, column and row.
    pub page: PageId,
    /// Frames since it came: 0 if that was the last one.
    pub age: u64,
    /// Stays as long as its material is seen.
    pub pinned: bool,
}

/// What a slot of the column cache holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CachedColumn {
    /// Index into [`Engine::materials`].
    pub material: usize,
    /// Component group.
    pub group: u16,
    /// Frames since it came: 0 if that was the last one.
    pub age: u64,
    /// Stays as long as its material is seen.
    pub pinned: bool,
}

/// The caches on the GPU, slot by slot; `None` is free.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CacheMap {
    /// Slots of pages.
    pub pages: Vec<Option<CachedPage>>,
    /// Slots of columns.
    pub columns: Vec<Option<CachedColumn>>,
}

/// How much of a material is resident.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageTree {
    /// Component groups.
    pub groups: u16,
    /// By group, whether its column is resident: without it no page of the group shows.
    pub columns: Vec<bool>,
    /// Mips with pages of their own, the finest first. The last one is the root, which holds all coarser mips.
    pub mips: Vec<MipTiles>,
}

/// The tiles of a mip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MipTiles {
    /// Tiles along the width.
    pub columns: u32,
    /// Tiles along the height.
    pub rows: u32,
    /// `[y][x]`: how many groups have their page of this tile in the cache.
    pub resident: Vec<u16>,
}

impl Engine {
    /// What lies in each slot of the caches. Costs nothing but the call.
    pub fn cache_map(&self) -> CacheMap {
        let (pages, columns) = self.renderer.slots();
        let mut map = CacheMap {
            pages: vec![None; pages as usize],
            columns: vec![None; columns as usize],
        };
        let materials = self.archives_of_btfs();
        for (item, slot) in self.residency.resident() {
            let Slot(at) = slot;
            let age = self.frames.saturating_sub(1 + self.placed.frame(item, slot));
            let pinned = self.residency.is_pinned(item);
            match item {
                Item::Page(material, page) => {
                    if let Some(place) = map.pages.get_mut(at as usize) {
                        let material = materials[usize::from(material.0)];
                        *place = Some(CachedPage {
                            material,
                            page,
                            age,
                            pinned,
                        });
                    }
                }
                Item::Column(material, group) => {
                    if let Some(place) = map.columns.get_mut(at as usize) {
                        let material = materials[usize::from(material.0)];
                        *place = Some(CachedColumn {
                            material,
                            group,
                            age,
                            pinned,
                        });
                    }
                }
            }
        }
        map
    }

    /// How much of a material is resident, by its index in [`Engine::materials`]; `None` if there is no such material, or its
    /// archive is not known yet.
    pub fn page_tree(&self, material: usize) -> Option<PageTree> {
        let btf = self.archives.shown_of(material)?;
        let (groups, pyramid) = (self.btfs[btf].groups(), *self.btfs[btf].pyramid());
        let mips = (0..=pyramid.tail_mip()).map(|mip| {
            let (columns, rows) = pyramid.grid(mip);
            MipTiles {
                columns,
                rows,
                resident: vec![0; (columns * rows) as usize],
            }
        });
        let mut tree = PageTree {
            groups,
            columns: vec![false; usize::from(groups)],
            mips: mips.collect(),
        };
        let id = MaterialId(btf as u16);
        for (item, _) in self.residency.resident() {
            match item {
                Item::Page(material, PageId { tile, .. }) if material == id => {
                    let mip = &mut tree.mips[usize::from(tile.mip)];
                    mip.resident[(u32::from(tile.y) * mip.columns + u32::from(tile.x)) as usize] += 1;
                }
                Item::Column(material, group) if material == id => tree.columns[usize::from(group)] = true,
                _ => {}
            }
        }
        Some(tree)
    }
}
