//! The page table: for each tile and group the finest resident page among the tile and its ancestors.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 3. Kept up to date by the subtree of each page that comes or
//! goes, and longer by each BTF that becomes known; only changed stretches are written to the GPU. A BTF has rows of
//! groups + 1 words, so that a pixel that sums over groups reads one stretch: first how many groups may have a column, then
//! the columns; after that for each tile how many groups matter there, then the pages.

use shaders::mirror::NONE;
use tileset::{PageId, Pyramid, Tile};

/// Entries written together.
const CHUNK: usize = 256;
/// Shift of the mip in an entry of a page; below it lies the slot's address.
const MIP_SHIFT: u32 = 27;
const ADDRESS: u32 = (1 << MIP_SHIFT) - 1;

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

    /// Words that it takes.
    pub fn entries(&self) -> usize {
        Self::words(self.groups, self.pyramid.tile_count()) as usize
    }

    /// Words of a row.
    fn row(&self) -> usize {
        usize::from(self.groups) + 1
    }
}

/// The table on the host, and what of it has changed.
#[derive(Debug, Default)]
pub struct PageTable {
    entries: Vec<u32>,
    regions: Vec<Region>,
    changed: Vec<bool>,
    any_changed: bool,
}

impl PageTable {
    /// Appends a BTF, of which nothing is resident; its index counts up from 0. `matter` says how many groups matter, by
    /// tile; where it ends, none.
    pub fn add(&mut self, region: Region, matter: &[u16]) {
        let first = self.entries.len();
        let base = region.base as usize;
        self.entries.resize(base + region.entries(), NONE);
        let rows = self.entries[base..].chunks_exact_mut(region.row());
        let firsts = std::iter::once(0).chain(matter.iter().copied().chain(std::iter::repeat(0)));
        rows.zip(firsts).for_each(|(row, first)| row[0] = first.into());
        self.changed.resize(self.entries.len().div_ceil(CHUNK), true);
        if first < self.entries.len() {
            self.changed[first / CHUNK] = true;
        }
        self.any_changed = true;
        self.regions.push(region);
    }

    /// Says anew how many groups of a BTF matter, by tile.
    pub fn set_matter(&mut self, btf: usize, matter: &[u16]) {
        let region = self.regions[btf];
        let tiles = region.pyramid.tile_count() as usize;
        for (tile, &groups) in (1..=tiles).zip(matter) {
            self.set(region.base as usize + tile * region.row(), groups.into());
        }
    }

    /// Gives the slots of all resident pages and columns new addresses.
    pub fn relocate(&mut self, page: impl Fn(u32) -> u32, column: impl Fn(u32) -> u32) {
        for region in 0..self.regions.len() {
            let region = self.regions[region];
            let base = region.base as usize;
            for at in (0..region.entries()).filter(|at| at % region.row() > 0) {
                match self.entries[base + at] {
                    NONE => {}
                    entry if at < region.row() => self.set(base + at, column(entry)),
                    entry => self.set(base + at, entry & !ADDRESS | page(entry & ADDRESS)),
                }
            }
        }
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
        (entry != NONE && entry >> MIP_SHIFT == u32::from(page.tile.mip)).then_some(entry & ADDRESS)
    }

    /// Addresses of the pages that stand for a tile, by its index: one of each group that has a page there and a column.
    pub fn shown(&self, btf: usize, tile: u32) -> impl Iterator<Item = u32> + '_ {
        let region = self.regions[btf];
        let row = |row: usize| {
            let first = region.base as usize + row * region.row() + 1;
            &self.entries[first..first + usize::from(region.groups)]
        };
        let pages = row(1 + tile as usize).iter().zip(row(0));
        pages
            .filter(|(page, column)| **page != NONE && **column != NONE)
            .map(|(page, _)| page & ADDRESS)
    }

    /// Geometry of a BTF's pages.
    pub fn pyramid(&self, btf: usize) -> Pyramid {
        self.regions[btf].pyramid
    }

    /// The parts of all BTFs.
    pub fn regions(&self) -> &[Region] {
        &self.regions
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
            self.any_changed = true;
        }
    }

    /// Hands each changed stretch, with its first entry, to `write`, and calls it unchanged.
    pub fn flush(&mut self, mut write: impl FnMut(usize, &[u32])) {
        if !std::mem::take(&mut self.any_changed) {
            return;
        }
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

    /// Of two BTFs; in each tile as many groups matter as the last digit of its index says.
    fn table(pyramid: Pyramid) -> PageTable {
        let words = Region::words(GROUPS, pyramid.tile_count()) as u32;
        let matter: Vec<_> = (0..pyramid.tile_count()).map(|tile| (tile % 10) as u16).collect();
        let mut table = PageTable::default();
        for base in [0, words] {
            let region = Region {
                base,
                groups: GROUPS,
                pyramid,
            };
            table.add(region, &matter);
        }
        table
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
            let mut on_gpu = vec![0; table.entries().len()];
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
                let half = table.entries().len() / 2;
                prop_assert_eq!(&table.entries()[half..2 * half], &naive(pyramid, &resident)[..]);
                prop_assert_eq!(&table.entries()[..half], &naive(pyramid, &BTreeMap::new())[..]);
                prop_assert_eq!(&on_gpu[..], table.entries());
                prop_assert_eq!(table.page(1, page), resident.get(&page).copied());
            }
            // To other addresses, with a BTF more.
            table.set_column(0, 1, Some(3));
            resident.values_mut().for_each(|address| *address = 1000 - *address);
            table.add(Region { base: table.entries().len() as u32, groups: 1, pyramid }, &[]);
            table.relocate(|address| 1000 - address, |address| address + 4);
            on_gpu.resize(table.entries().len(), 0);
            table.flush(|first, entries| on_gpu[first..first + entries.len()].copy_from_slice(entries));
            let words = Region::words(GROUPS, pyramid.tile_count()) as usize;
            prop_assert_eq!(on_gpu[..3].to_vec(), vec![2, NONE, 7]);
            prop_assert_eq!(&on_gpu[words..2 * words], &naive(pyramid, &resident)[..]);
            prop_assert!(on_gpu[2 * words..].chunks_exact(2).all(|row| row == [0, NONE]));
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
}
