//! The page table: for each tile and group the finest resident page among the tile and its ancestors.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 3. Kept up to date by the subtree of each page that comes or
//! goes; only changed stretches are written to the GPU. A BTF has rows of groups + 1 words, so that a pixel that sums over
//! groups reads one stretch: first how many groups may have a column, then the columns; after that for each tile how many
//! groups matter there, then the pages. After all BTFs come the weights of slots, as floats.

use shaders::mirror::NONE;
use tileset::{PageId, Pyramid, Tile};

use crate::residency::Slot;

/// Entries written together.
const CHUNK: usize = 256;
/// Shift of the mip in an entry of a page; below it lies the slot's address.
const MIP_SHIFT: u32 = 27;

/// One BTF's part of the table.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// First entry.
    pub base: u32,
    /// Component groups.
    pub groups: u16,
    /// Geometry of the pages.
    pub pyramid: Pyramid,
}

impl Region {
    /// Words that a BTF of this many groups and tiles takes.
    pub fn words(groups: u16, tiles: u32) -> u64 {
        (u64::from(groups) + 1) * (u64::from(tiles) + 1)
    }
}

/// The table on the host, and what of it has changed.
#[derive(Debug, Default)]
pub struct PageTable {
    entries: Vec<u32>,
    regions: Vec<Region>,
    /// First of the weights of slots.
    slot_weights: usize,
    changed: Vec<bool>,
}

impl PageTable {
    /// A table in which nothing is resident, with weights of one for `slots` slots. `matter` says for each BTF how many
    /// groups matter, by tile.
    pub fn new(regions: Vec<Region>, matter: &[Vec<u16>], slots: u32) -> Self {
        let words = |region: &Region| Region::words(region.groups, region.pyramid.tile_count());
        let slot_weights = regions.iter().map(words).sum::<u64>() as usize;
        let mut entries = vec![NONE; slot_weights];
        entries.extend(std::iter::repeat_n(1f32.to_bits(), slots as usize));
        for (region, matter) in regions.iter().zip(matter) {
            let rows = entries[region.base as usize..].chunks_exact_mut(usize::from(region.groups) + 1);
            let firsts = std::iter::once(0).chain(matter.iter().copied());
            rows.zip(firsts).for_each(|(row, first)| row[0] = first.into());
        }
        Self {
            changed: vec![false; entries.len().div_ceil(CHUNK)],
            entries,
            regions,
            slot_weights,
        }
    }

    /// Where the weights of slots begin.
    pub fn slot_weights(&self) -> u32 {
        self.slot_weights as u32
    }

    /// By how much a slot's page is mixed with what was shown before it.
    pub fn set_slot_weight(&mut self, slot: Slot, weight: f32) {
        self.set(self.slot_weights + slot.0 as usize, weight.to_bits());
    }

    /// All entries.
    pub fn entries(&self) -> &[u32] {
        &self.entries
    }

    /// The address of a page, if it is resident.
    pub fn page(&self, btf: usize, page: PageId) -> Option<u32> {
        let region = self.regions[btf];
        if page.group >= region.groups || region.pyramid.tile_index(page.tile).is_none() {
            return None;
        }
        let entry = self.entries[region.entry(page.group, page.tile)];
        (entry != NONE && entry >> MIP_SHIFT == u32::from(page.tile.mip))
            .then_some(entry & ((1 << MIP_SHIFT) - 1))
    }

    /// Geometry of a BTF's pages.
    pub fn pyramid(&self, btf: usize) -> Pyramid {
        self.regions[btf].pyramid
    }

    /// Enters a column's slot, or takes it out.
    pub fn set_column(&mut self, btf: usize, group: u16, address: Option<u32>) {
        let region = self.regions[btf];
        let first = region.base as usize;
        self.set(first + 1 + usize::from(group), address.unwrap_or(NONE));
        let columns = &self.entries[first + 1..][..usize::from(region.groups)];
        let present = columns.iter().rposition(|&entry| entry != NONE);
        self.set(first, present.map_or(0, |last| last as u32 + 1));
    }

    /// Enters a page: its tile and all below it that have no finer page show it.
    pub fn insert(&mut self, btf: usize, page: PageId, address: u32) {
        let mip = u32::from(page.tile.mip);
        self.replace(btf, page, mip << MIP_SHIFT | address, |entry| {
            entry == NONE || entry >> MIP_SHIFT >= mip
        });
    }

    /// Takes a page out: whatever showed it shows its parent's entry.
    pub fn remove(&mut self, btf: usize, page: PageId) {
        let region = self.regions[btf];
        let parent = region
            .pyramid
            .parent(page.tile)
            .map_or(NONE, |tile| self.entries[region.entry(page.group, tile)]);
        let mip = u32::from(page.tile.mip);
        self.replace(btf, page, parent, |entry| {
            entry != NONE && entry >> MIP_SHIFT == mip
        });
    }

    /// Replaces the entries of a page's subtree that `applies` accepts.
    fn replace(&mut self, btf: usize, page: PageId, new: u32, applies: impl Fn(u32) -> bool) {
        let region = self.regions[btf];
        for mip in (0..=page.tile.mip).rev() {
            let depth = u32::from(page.tile.mip - mip);
            let (columns, rows) = region.pyramid.grid(mip);
            let range = |first: u16, count: u32| {
                let first = u32::from(first) << depth;
                first..(first + (1 << depth)).min(count)
            };
            for y in range(page.tile.y, rows) {
                for x in range(page.tile.x, columns) {
                    let entry = region.entry(
                        page.group,
                        Tile {
                            mip,
                            x: x as u16,
                            y: y as u16,
                        },
                    );
                    if applies(self.entries[entry]) {
                        self.set(entry, new);
                    }
                }
            }
        }
    }

    fn set(&mut self, entry: usize, value: u32) {
        if self.entries[entry] != value {
            self.entries[entry] = value;
            self.changed[entry / CHUNK] = true;
        }
    }

    /// Hands each changed stretch, with its first entry, to `write`, and calls it unchanged.
    pub fn flush(&mut self, mut write: impl FnMut(usize, &[u32])) {
        let mut chunk = 0;
        while chunk < self.changed.len() {
            let first = chunk;
            while chunk < self.changed.len() && std::mem::take(&mut self.changed[chunk]) {
                chunk += 1;
            }
            if first < chunk {
                write(
                    first * CHUNK,
                    &self.entries[first * CHUNK..(chunk * CHUNK).min(self.entries.len())],
                );
            }
            chunk += 1;
        }
    }
}

impl Region {
    fn entry(&self, group: u16, tile: Tile) -> usize {
        let (columns, _) = self.pyramid.grid(tile.mip);
        let index = self.pyramid.mip_base(tile.mip) + u32::from(tile.y) * columns + u32::from(tile.x);
        let row = index as usize + 1;
        self.base as usize + row * (usize::from(self.groups) + 1) + 1 + usize::from(group)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    const GROUPS: u16 = 2;

    const SLOTS: u32 = 3;

    /// Of two BTFs; in each tile as many groups matter as the last digit of its index says.
    fn table(pyramid: Pyramid) -> PageTable {
        let region = |base| Region {
            base,
            groups: GROUPS,
            pyramid,
        };
        let second = Region::words(GROUPS, pyramid.tile_count()) as u32;
        let matter: Vec<_> = (0..pyramid.tile_count()).map(|tile| (tile % 10) as u16).collect();
        PageTable::new(vec![region(0), region(second)], &[matter.clone(), matter], SLOTS)
    }

    /// What every entry should be: the finest resident page among tile and ancestors.
    fn naive(pyramid: Pyramid, resident: &BTreeMap<PageId, u32>) -> Vec<u32> {
        let mut entries = vec![0, NONE, NONE];
        for (index, tile) in (0..).zip(pyramid.tiles()) {
            entries.push(index % 10);
            for group in 0..GROUPS {
                let mut place = Some(tile);
                let entry = loop {
                    let Some(tile) = place else { break NONE };
                    if let Some(address) = resident.get(&PageId { group, tile }) {
                        break u32::from(tile.mip) << MIP_SHIFT | address;
                    }
                    place = pyramid.parent(tile);
                };
                entries.push(entry);
            }
        }
        entries
    }

    proptest! {
        #[test]
        fn entries_are_those_of_a_search(
            (width, height) in (1u32..700, 1u32..700),
            steps in prop::collection::vec((any::<u32>(), 0..GROUPS), 1..60),
        ) {
            let pyramid = Pyramid::new(width, height, true).unwrap();
            let mut table = table(pyramid);
            let mut on_gpu = table.entries().to_vec();
            let mut resident = BTreeMap::new();
            for (address, (tile, group)) in (0..).zip(steps) {
                let tile = pyramid.tile_at(tile % pyramid.tile_count()).unwrap();
                let page = PageId { group, tile };
                if resident.remove(&page).is_some() {
                    table.remove(1, page);
                } else {
                    resident.insert(page, address);
                    table.insert(1, page, address);
                }
                table.flush(|first, entries| on_gpu[first..first + entries.len()].copy_from_slice(entries));
                let half = table.slot_weights() as usize / 2;
                prop_assert_eq!(&table.entries()[half..2 * half], &naive(pyramid, &resident)[..]);
                prop_assert_eq!(&table.entries()[..half], &naive(pyramid, &BTreeMap::new())[..]);
                prop_assert_eq!(&on_gpu[..], table.entries());
                prop_assert_eq!(table.page(1, page), resident.get(&page).copied());
            }
        }
    }

    #[test]
    fn columns_stand_before_the_pages_and_are_counted() {
        let mut table = table(Pyramid::new(64, 64, false).unwrap());
        let before = table.entries().to_vec();
        assert_eq!(before[..3], [0, NONE, NONE]);
        table.set_column(0, 1, Some(7));
        assert_eq!(table.entries()[..3], [2, NONE, 7]);
        table.set_column(0, 0, Some(8));
        table.set_column(0, 1, None);
        assert_eq!(table.entries()[..3], [1, 8, NONE]);
        table.set_column(0, 0, None);
        assert_eq!(table.entries(), before);
    }

    #[test]
    fn weights_of_slots_stand_at_the_end() {
        let mut table = table(Pyramid::new(64, 64, false).unwrap());
        let first = table.slot_weights() as usize;
        assert_eq!(table.entries()[first..], [1f32.to_bits(); SLOTS as usize]);
        table.set_slot_weight(Slot(2), 0.5);
        let mut written = Vec::new();
        table.flush(|first, entries| written.push((first, entries.to_vec())));
        assert_eq!(written, [(0, table.entries().to_vec())]);
        assert_eq!(table.entries()[first..], [1f32, 1.0, 0.5].map(f32::to_bits));
    }
}
