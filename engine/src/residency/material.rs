//! Votes, values and slots of one material.

mod ranks;

use tileset::{PageId, Pyramid, Tile};

use super::{
    HEAD_BYTES, Item, MaterialId, MaterialInfo, Slot, TileVotes,
    group::{Class, Group},
    rank::Rank,
    value::Blocks,
    wanted::{NONE, Wanted},
};

/// A material: what is known of it, what is wanted of it, what is resident of it.
pub(super) struct Material {
    id: MaterialId,
    pyramid: Pyramid,
    tiles: u32,
    /// Of each mip the index of its first tile, and its columns and rows of tiles.
    grids: Vec<(u32, u32, u32)>,
    parents: Vec<u32>,
    children: Vec<[u32; 4]>,
    /// What a squared error counts for where pixels want a tile; positive, finite.
    visibility: Vec<f32>,
    /// w, `[group][tile]`; finite and not negative.
    weights: Vec<f32>,
    /// The same, `[tile][group]`.
    weights_by_tile: Vec<f32>,
    page_bytes: Vec<u32>,
    column_bytes: Vec<u32>,
    /// Slots of the pages, `[group][tile]`.
    page_slots: Vec<u32>,
    /// Update at which each tile has lost its votes.
    last_wanted: Vec<u64>,
    /// What is wanted now, and ahead.
    wanted: [Wanted; 2],
    groups: Vec<Group>,
    /// Sum over the groups.
    missing: f64,
    retired: bool,
}

impl Material {
    pub(super) fn new(id: MaterialId, info: MaterialInfo) -> Self {
        let MaterialInfo {
            pyramid,
            groups,
            mut weights,
            mut visibility,
            page_bytes,
            column_bytes,
        } = info;
        let tiles = pyramid.tile_count();
        let pages = usize::from(groups) * tiles as usize;
        weights.resize(pages, 0.0);
        for weight in &mut weights {
            *weight = if weight.is_finite() { weight.max(0.0) } else { 0.0 };
        }
        visibility.resize(tiles as usize, 1.0);
        for visibility in &mut visibility {
            if !(visibility.is_normal() && *visibility > 0.0) {
                *visibility = 1.0;
            }
        }
        let index = |tile| pyramid.tile_index(tile).unwrap_or(NONE);
        let parents = pyramid
            .tiles()
            .map(|tile| pyramid.parent(tile).map_or(NONE, index));
        let children = pyramid.tiles().map(|tile| {
            let mut children = [NONE; 4];
            children
                .iter_mut()
                .zip(pyramid.children(tile))
                .for_each(|(child, tile)| *child = index(tile));
            children
        });
        let grids = (0..=pyramid.tail_mip()).map(|mip| {
            let (columns, rows) = pyramid.grid(mip);
            (pyramid.mip_base(mip), columns, rows)
        });
        let by_tile = (0..tiles as usize).flat_map(|tile| weights.iter().skip(tile).step_by(tiles as usize));
        let weights_by_tile = by_tile.copied().collect();
        Self {
            id,
            tiles,
            visibility,
            weights_by_tile,
            grids: grids.collect(),
            parents: parents.collect(),
            children: children.collect(),
            weights,
            page_bytes,
            column_bytes,
            page_slots: vec![NONE; pages],
            last_wanted: vec![0; tiles as usize],
            wanted: Default::default(),
            groups: (0..groups).map(|_| Group::default()).collect(),
            missing: 0.0,
            retired: false,
            pyramid,
        }
    }

    /// Whether it has votes of the present.
    pub(super) fn visible(&self) -> bool {
        !self.wanted[Class::Now as usize].is_empty()
    }

    /// Whether votes for a tile count.
    pub(super) fn has_tile(&self, tile: u32) -> bool {
        tile < self.tiles && !self.retired
    }

    /// Lets no vote count any more, or lets them again.
    pub(super) fn set_retired(&mut self, retired: bool) {
        self.retired = retired;
    }

    pub(super) fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Pages that the present votes want.
    pub(super) fn pages_wanted(&self) -> u32 {
        (self.wanted[Class::Now as usize].tiles().len() * self.groups.len()) as u32
    }

    /// Squared error of reflectance, summed over all pixels, of what is not resident.
    pub(super) fn missing(&self) -> f64 {
        self.missing
    }

    /// Squared errors, summed over all pixels, of what is not resident, and of all that is wanted.
    pub(super) fn errors(&self) -> [f64; 2] {
        [self.missing, self.groups.iter().map(|group| group.error).sum()]
    }

    /// Bytes of an item's record.
    pub(super) fn bytes(&self, item: Item) -> u64 {
        let bytes = match item {
            Item::Page(_, page) => self.page(page).and_then(|at| self.page_bytes.get(at)),
            Item::Column(_, group) => self.column_bytes.get(usize::from(group)),
        };
        bytes.copied().unwrap_or(0).into()
    }

    /// What an item costs on the line: nothing without a record.
    fn line_bytes(&self, item: Item) -> u64 {
        match self.bytes(item) {
            0 => 0,
            bytes => bytes + HEAD_BYTES,
        }
    }

    /// What an item costs on the line; a root or a column what both do, as far as they are not resident: neither is worth
    /// anything without the other.
    pub(super) fn opening_bytes(&self, item: Item) -> u64 {
        let tile = self.pyramid.root();
        let other = match item {
            Item::Column(material, group) => Item::Page(material, PageId { group, tile }),
            Item::Page(material, page) if page.tile == tile => Item::Column(material, page.group),
            Item::Page(..) => return self.line_bytes(item),
        };
        let missing = self.slot(other).is_none();
        self.line_bytes(item) + if missing { self.line_bytes(other) } else { 0 }
    }

    /// Whether these are the votes already.
    pub(super) fn has_votes(&self, votes: &TileVotes) -> bool {
        self.wanted
            .iter()
            .zip(votes)
            .all(|(wanted, votes)| wanted.has(votes))
    }

    /// Replaces the votes, by class, given by tile and each tile once, and works out what follows from them; `pin` as
    /// for ranks of pages.
    pub(super) fn set_votes(&mut self, votes: &mut TileVotes, now: u64, pin: bool, blocks: &mut Blocks) {
        for (class, (wanted, votes)) in self.wanted.iter_mut().zip(votes).enumerate() {
            if wanted.has(votes) {
                continue;
            }
            let last_wanted = &mut self.last_wanted;
            wanted.set(votes, &self.parents, &self.visibility, |tile| {
                if class == Class::Now as usize {
                    last_wanted[tile as usize] = now;
                }
            });
            let mut sums = vec![[0.0; 2]; self.groups.len()];
            wanted.sum(&self.weights_by_tile, &mut sums);
            for (group, [worth, error]) in self.groups.iter_mut().zip(sums) {
                group.worth[class] = worth;
                if class == Class::Now as usize {
                    group.error = error;
                }
            }
        }
        for group in 0..self.groups.len() {
            self.groups[group].valued = false;
            if self.groups[group].open || group == 0 {
                self.value(group, blocks);
            }
            self.find_missing(group);
            self.find_bounds(group, pin);
        }
        self.sum_missing();
    }

    /// Values of the pages of a group, unless they are known.
    fn value(&mut self, group: usize, blocks: &mut Blocks) {
        let weights = self.weights.chunks_exact(self.tiles as usize).nth(group);
        self.groups[group].value(weights.unwrap_or(&[]), &self.wanted, blocks);
    }

    fn page_slots(&self, group: usize) -> &[u32] {
        &self.page_slots[group * self.tiles as usize..][..self.tiles as usize]
    }

    /// The part of a group's error that is not resident: all of it without root or column.
    fn find_missing(&mut self, group: usize) {
        let slots = self.page_slots(group);
        let shown = self.groups[group].column_slot != NONE && slots[0] != NONE;
        let missing = if shown {
            let weights = &self.weights[group * self.tiles as usize..][..self.tiles as usize];
            let wanted = &self.wanted[Class::Now as usize];
            let errors = wanted.tiles().iter().zip(wanted.errors(weights));
            errors
                .map(|(&tile, error)| if slots[tile as usize] == NONE { error } else { 0.0 })
                .sum()
        } else {
            self.groups[group].error
        };
        self.groups[group].missing = missing;
    }

    fn sum_missing(&mut self) {
        self.missing = self.groups.iter().map(|group| group.missing).sum();
    }

    /// The lowest rank among the group's residents and the highest among what could be added to them. Ranks are made only
    /// of pages whose values may be the lowest and the highest.
    fn find_bounds(&mut self, group: usize, pin: bool) {
        let (mut lowest, mut highest): (Option<Rank>, Option<Rank>) = (None, None);
        let at = &self.groups[group];
        let lower = |lowest: Option<Rank>, rank: Rank| Some(lowest.map_or(rank, |lowest| lowest.min(rank)));
        let higher =
            |highest: Option<Rank>, rank: Rank| Some(highest.map_or(rank, |highest| highest.max(rank)));
        let mut unwanted = at.residents.len();
        if at.open {
            // Wanted tiles lie side by side with their values.
            let now = &self.wanted[Class::Now as usize];
            let (tiles, slots) = (now.tiles(), self.page_slots(group));
            let resident = |place: u32| {
                tiles
                    .get(place as usize)
                    .is_some_and(|&tile| slots[tile as usize] != NONE)
            };
            let (mut least, mut most) = (f64::INFINITY, 0.0);
            for ((&tile, &parent), &value) in tiles.iter().zip(now.parents()).zip(at.values(Class::Now)) {
                let pinned = pin && group == 0 && tile == 0;
                if slots[tile as usize] != NONE {
                    unwanted -= 1;
                    if pinned || value <= least {
                        lowest = lower(lowest, self.page_rank(group, tile, pin));
                        least = if pinned { least } else { value };
                    }
                } else if value > 0.0 && (pinned || value >= most) {
                    let reachable = tile == 0 || (at.column_slot != NONE && resident(parent));
                    if reachable {
                        highest = higher(highest, self.page_rank(group, tile, pin));
                        most = value.max(most);
                    }
                }
            }
        }
        if unwanted > 0 {
            let now = &self.wanted[Class::Now as usize];
            for &tile in &at.residents {
                if !(at.open && now.has_tile(tile)) {
                    lowest = lower(lowest, self.page_rank(group, tile, pin));
                }
            }
        }
        // What only votes ahead want, or only a pin, ranks below all of the present.
        let ahead = &self.wanted[Class::Ahead as usize];
        if highest.is_none() && !(at.open && ahead.is_empty()) {
            self.for_each_addable(group, pin, |rank| highest = higher(highest, rank));
        }
        let group = &mut self.groups[group];
        (group.lowest, group.highest) = (lowest, highest);
    }

    /// To be called when the pins have changed.
    pub(super) fn pins_changed(&mut self, pin: bool) {
        if !self.groups.is_empty() {
            self.find_bounds(0, pin);
        }
    }

    /// As [`Pyramid::tile_index`], from a table.
    fn tile_index(&self, tile: Tile) -> Option<u32> {
        let &(base, columns, rows) = self.grids.get(usize::from(tile.mip))?;
        let (x, y) = (u32::from(tile.x), u32::from(tile.y));
        (x < columns && y < rows).then(|| base + y * columns + x)
    }

    fn page(&self, page: PageId) -> Option<usize> {
        let tile = self.tile_index(page.tile)?;
        let group = usize::from(page.group);
        (group < self.groups.len()).then(|| group * self.tiles as usize + tile as usize)
    }

    pub(super) fn slot(&self, item: Item) -> Option<Slot> {
        let slot = match item {
            Item::Page(_, page) => self.page_slots[self.page(page)?],
            Item::Column(_, group) => self.groups.get(usize::from(group))?.column_slot,
        };
        (slot != NONE).then_some(Slot(slot))
    }

    /// Notes where an item is now.
    pub(super) fn set_slot(&mut self, item: Item, slot: Option<Slot>, pin: bool) {
        let to = slot.map_or(NONE, |slot| slot.0);
        let group = match item {
            Item::Page(_, page) => {
                let Some(at) = self.page(page) else { return };
                let from = std::mem::replace(&mut self.page_slots[at], to);
                let group = usize::from(page.group);
                let tile = at as u32 - group as u32 * self.tiles;
                let residents = &mut self.groups[group].residents;
                match (from, to) {
                    (NONE, NONE) => {}
                    (NONE, _) => residents.push(tile),
                    (_, NONE) => residents.retain(|resident| *resident != tile),
                    _ => {}
                }
                group
            }
            Item::Column(_, group) => {
                let Some(at) = self.groups.get_mut(usize::from(group)) else {
                    return;
                };
                at.column_slot = to;
                at.open = to != NONE;
                let group = usize::from(group);
                if to != NONE {
                    self.value(group, &mut Blocks::default());
                }
                group
            }
        };
        self.find_missing(group);
        self.sum_missing();
        self.find_bounds(group, pin);
    }

    /// Opens a group, or closes it.
    pub(super) fn set_open(&mut self, group: u16, open: bool, pin: bool, blocks: &mut Blocks) {
        let group = usize::from(group);
        if self.groups[group].open != open {
            self.groups[group].open = open;
            if open {
                self.value(group, blocks);
            }
            self.find_bounds(group, pin);
        }
    }

    /// Whether what the page needs is there: the parent, and for all but the root the column.
    pub(super) fn reachable(&self, page: PageId) -> bool {
        let group = usize::from(page.group);
        match self.tile_index(page.tile) {
            Some(0) => group < self.groups.len(),
            Some(tile) if group < self.groups.len() => {
                let parent = self.parents[tile as usize];
                self.groups[group].column_slot != NONE && self.page_slots(group)[parent as usize] != NONE
            }
            _ => false,
        }
    }
}
