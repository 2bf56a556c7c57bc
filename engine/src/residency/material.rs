//! Votes, values and slots of one material.

use std::cmp::Reverse;

use tileset::{PageId, Pyramid, Tile};

use super::{Item, MaterialId, MaterialInfo, Slot, rank::Rank, value::Blocks};

const NONE: u32 = u32::MAX;

/// A material: what is known of it, what is wanted of it, what is resident of it.
///
/// What is wanted is kept for the tiles that have votes only, in the order of their indices, root first.
pub(super) struct Material {
    id: MaterialId,
    pyramid: Pyramid,
    tiles: u32,
    /// Of each mip the index of its first tile, and its columns and rows of tiles.
    grids: Vec<(u32, u32, u32)>,
    parents: Vec<u32>,
    /// w, `[group][tile]`; finite and not negative.
    weights: Vec<f32>,
    /// Slots of the pages, `[group][tile]`.
    page_slots: Vec<u32>,
    /// Last update at which each tile had votes.
    last_wanted: Vec<u64>,
    /// Last votes as they came: tile and pixels, by tile.
    votes: Vec<(u32, u64)>,
    wanted: Vec<Wanted>,
    /// For each tile its place in `wanted`.
    place: Vec<u32>,
    pub(super) groups: Vec<Group>,
}

/// A tile that has votes, its own or of descendants.
#[derive(Clone, Copy)]
struct Wanted {
    tile: u32,
    /// Place of the parent in `wanted`.
    parent: u32,
    pixels: f64,
}

impl Wanted {
    /// w·v, for the weights of a group.
    fn error(&self, weights: &[f32]) -> f64 {
        f64::from(weights[self.tile as usize]) * self.pixels
    }
}

/// The part of a group's error that is not resident: all of it without root or column.
fn missing(wanted: &[Wanted], own: &[f64], slots: &[u32], column_slot: u32) -> f64 {
    let shown = column_slot != NONE && slots[0] != NONE;
    let missing = |wanted: &Wanted| !shown || slots[wanted.tile as usize] == NONE;
    wanted
        .iter()
        .zip(own)
        .filter(|(wanted, _)| missing(wanted))
        .map(|(_, own)| own)
        .sum()
}

/// One component group.
pub(super) struct Group {
    column_slot: u32,
    /// The column is resident, in flight, or about to be asked for: without it pages are worth nothing.
    pub(super) open: bool,
    /// Σ w·v over the wanted pages: what the column is worth.
    pub(super) worth: f64,
    /// The part of `worth` that is not resident.
    missing: f64,
    /// Values of the pages of the wanted tiles.
    values: Vec<f64>,
}

impl Material {
    pub(super) fn new(id: MaterialId, info: MaterialInfo) -> Self {
        let MaterialInfo {
            pyramid,
            groups,
            mut weights,
        } = info;
        let tiles = pyramid.tile_count();
        let pages = usize::from(groups) * tiles as usize;
        weights.resize(pages, 0.0);
        for weight in &mut weights {
            *weight = if weight.is_finite() { weight.max(0.0) } else { 0.0 };
        }
        let parents = pyramid
            .tiles()
            .map(|tile| {
                pyramid
                    .parent(tile)
                    .and_then(|parent| pyramid.tile_index(parent))
                    .unwrap_or(NONE)
            })
            .collect();
        let grids = (0..=pyramid.tail_mip()).map(|mip| {
            let (columns, rows) = pyramid.grid(mip);
            (pyramid.mip_base(mip), columns, rows)
        });
        let grids = grids.collect();
        let group = || Group {
            column_slot: NONE,
            open: false,
            worth: 0.0,
            missing: 0.0,
            values: Vec::new(),
        };
        Self {
            id,
            pyramid,
            tiles,
            grids,
            parents,
            weights,
            page_slots: vec![NONE; pages],
            last_wanted: vec![0; tiles as usize],
            votes: Vec::new(),
            wanted: Vec::new(),
            place: vec![NONE; tiles as usize],
            groups: (0..groups).map(|_| group()).collect(),
        }
    }

    /// Whether it has votes.
    pub(super) fn visible(&self) -> bool {
        !self.wanted.is_empty()
    }

    pub(super) fn has_tile(&self, tile: u32) -> bool {
        tile < self.tiles
    }

    pub(super) fn pages_wanted(&self) -> u32 {
        (self.wanted.len() * self.groups.len()) as u32
    }

    /// Squared error, summed over all pixels, of what is not resident.
    pub(super) fn missing(&self) -> f64 {
        self.groups.iter().map(|group| group.missing).sum()
    }

    /// Replaces the votes, given in any order, and works out what follows from them.
    pub(super) fn set_votes(&mut self, mut votes: Vec<(u32, u64)>, now: u64, blocks: &mut Blocks) {
        votes.sort_unstable();
        votes.dedup_by(|later, earlier| {
            let same = later.0 == earlier.0;
            if same {
                earlier.1 += later.1;
            }
            same
        });
        if votes != self.votes {
            self.votes = votes;
            self.want();
            self.revalue(blocks);
        }
        for wanted in &self.wanted {
            self.last_wanted[wanted.tile as usize] = now;
        }
    }

    /// From votes for tiles to wanted tiles: each vote counts for all ancestors too (equation 9).
    fn want(&mut self) {
        for wanted in &self.wanted {
            self.place[wanted.tile as usize] = NONE;
        }
        self.wanted.clear();
        for &(tile, pixels) in &self.votes {
            let mut tile = tile;
            while tile != NONE {
                let place = &mut self.place[tile as usize];
                if *place == NONE {
                    *place = self.wanted.len() as u32;
                    self.wanted.push(Wanted {
                        tile,
                        parent: NONE,
                        pixels: 0.0,
                    });
                }
                self.wanted[*place as usize].pixels += pixels as f64;
                tile = self.parents[tile as usize];
            }
        }
        self.wanted.sort_unstable_by_key(|wanted| wanted.tile);
        for (place, wanted) in self.wanted.iter_mut().enumerate() {
            self.place[wanted.tile as usize] = place as u32;
            let parent = self.parents[wanted.tile as usize];
            wanted.parent = if parent == NONE {
                NONE
            } else {
                self.place[parent as usize]
            };
        }
    }

    fn revalue(&mut self, blocks: &mut Blocks) {
        let parents: Vec<u32> = self.wanted.iter().map(|wanted| wanted.parent).collect();
        let mut own = Vec::with_capacity(self.wanted.len());
        let tiles = self.tiles as usize;
        let pages = self
            .weights
            .chunks_exact(tiles)
            .zip(self.page_slots.chunks_exact(tiles));
        for (group, (weights, slots)) in self.groups.iter_mut().zip(pages) {
            own.clear();
            own.extend(self.wanted.iter().map(|wanted| wanted.error(weights)));
            group.worth = own.iter().sum();
            group.missing = missing(&self.wanted, &own, slots, group.column_slot);
            group.values.resize(own.len(), 0.0);
            if !own.is_empty() {
                blocks.values(&own, &parents, &mut group.values);
            }
        }
    }

    /// After a change of the group's pages or column.
    fn find_missing(&mut self, group: usize) {
        let pages = group * self.tiles as usize..(group + 1) * self.tiles as usize;
        let (weights, slots) = (&self.weights[pages.clone()], &self.page_slots[pages]);
        let own: Vec<f64> = self.wanted.iter().map(|wanted| wanted.error(weights)).collect();
        let group = &mut self.groups[group];
        group.missing = missing(&self.wanted, &own, slots, group.column_slot);
    }

    /// As [`Pyramid::tile_index`], from a table: it is asked for every resident page in every update.
    fn tile_index(&self, tile: Tile) -> Option<u32> {
        let &(base, columns, rows) = self.grids.get(usize::from(tile.mip))?;
        let (x, y) = (u32::from(tile.x), u32::from(tile.y));
        (x < columns && y < rows).then(|| base + y * columns + x)
    }

    fn page(&self, page: PageId) -> Option<usize> {
        let tile = self.tile_index(page.tile)?;
        (usize::from(page.group) < self.groups.len()).then(|| self.page_at(page.group.into(), tile))
    }

    fn page_at(&self, group: usize, tile: u32) -> usize {
        group * self.tiles as usize + tile as usize
    }

    pub(super) fn slot(&self, item: Item) -> Option<Slot> {
        let slot = match item {
            Item::Page(_, page) => self.page_slots[self.page(page)?],
            Item::Column(_, group) => self.groups.get(usize::from(group))?.column_slot,
        };
        (slot != NONE).then_some(Slot(slot))
    }

    /// Notes where an item is now.
    pub(super) fn set_slot(&mut self, item: Item, slot: Option<Slot>) {
        let slot = slot.map_or(NONE, |slot| slot.0);
        match item {
            Item::Page(_, page) => {
                let Some(at) = self.page(page) else { return };
                self.page_slots[at] = slot;
                self.find_missing(page.group.into());
            }
            Item::Column(_, group) => {
                let Some(at) = self.groups.get_mut(usize::from(group)) else {
                    return;
                };
                at.column_slot = slot;
                at.open = slot != NONE;
                self.find_missing(group.into());
            }
        }
    }

    /// What an item of this material is worth.
    pub(super) fn rank(&self, item: Item, pin: bool) -> Rank {
        match item {
            Item::Page(_, page) => {
                let tile = self.tile_index(page.tile).unwrap_or(0);
                self.page_rank(page.group.into(), tile, pin)
            }
            Item::Column(_, group) => self.column_rank(group.into(), pin),
        }
    }

    fn page_rank(&self, group: usize, tile: u32, pin: bool) -> Rank {
        let value = match self.place[tile as usize] {
            NONE => 0.0,
            place => self.groups[group].values[place as usize],
        };
        let pinned = pin && group == 0 && tile == 0 && value > 0.0;
        let value = if self.groups[group].open || pinned {
            value
        } else {
            0.0
        };
        self.rank_of(group, tile, pinned, value)
    }

    fn column_rank(&self, group: usize, pin: bool) -> Rank {
        let worth = if self.visible() {
            self.groups[group].worth
        } else {
            0.0
        };
        self.rank_of(group, 0, pin && group == 0 && worth > 0.0, worth)
    }

    /// The column's place in the order of requests: as its root, see the module's documentation.
    pub(super) fn column_urgency(&self, group: usize, rank: Rank) -> Rank {
        Rank {
            value: self.groups[group].values.first().copied().unwrap_or(0.0),
            ..rank
        }
    }

    fn rank_of(&self, group: usize, tile: u32, pinned: bool, value: f64) -> Rank {
        Rank {
            pinned,
            value,
            last_wanted: self.last_wanted[tile as usize],
            tile: Reverse(tile),
            group: Reverse(group as u16),
            material: Reverse(self.id.0),
        }
    }

    /// Whether what the page needs is there: the parent, and for all but the root the column.
    pub(super) fn reachable(&self, page: PageId) -> bool {
        let group = usize::from(page.group);
        match self.tile_index(page.tile) {
            Some(0) => group < self.groups.len(),
            Some(tile) => group < self.groups.len() && self.reachable_at(group, tile),
            None => false,
        }
    }

    fn reachable_at(&self, group: usize, tile: u32) -> bool {
        let parent = self.page_at(group, self.parents[tile as usize]);
        self.groups[group].column_slot != NONE && self.page_slots[parent] != NONE
    }

    /// Ranks of all pages of value that are not resident, but reachable.
    pub(super) fn for_each_addable_page(&self, pin: bool, mut each: impl FnMut(Rank)) {
        for group in 0..self.groups.len() {
            let Group {
                open, column_slot, ..
            } = self.groups[group];
            let pinned = pin && group == 0;
            if !(open || pinned) {
                continue;
            }
            let wanted = if column_slot == NONE {
                self.wanted.get(..1)
            } else {
                self.wanted.get(..)
            };
            let values = &self.groups[group].values;
            for (wanted, &value) in wanted.unwrap_or(&[]).iter().zip(values) {
                let addable = value > 0.0
                    && self.page_slots[self.page_at(group, wanted.tile)] == NONE
                    && (wanted.tile == 0 || self.reachable_at(group, wanted.tile));
                if addable {
                    each(self.page_rank(group, wanted.tile, pin));
                }
            }
        }
    }

    /// Ranks of all columns of value that are not resident.
    pub(super) fn for_each_addable_column(&self, pin: bool, mut each: impl FnMut(Rank)) {
        if !self.visible() {
            return;
        }
        for group in 0..self.groups.len() {
            if self.groups[group].column_slot == NONE && self.groups[group].worth > 0.0 {
                each(self.column_rank(group, pin));
            }
        }
    }

    /// The item with this rank.
    pub(super) fn page_of(&self, rank: &Rank) -> Option<Item> {
        let tile = self.pyramid.tile_at(rank.tile.0)?;
        Some(Item::Page(
            self.id,
            PageId {
                group: rank.group.0,
                tile,
            },
        ))
    }

    /// Closes all groups whose column is not resident.
    pub(super) fn close_groups(&mut self) {
        for group in &mut self.groups {
            group.open = group.column_slot != NONE;
        }
    }
}
