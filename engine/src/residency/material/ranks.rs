//! Ranks of the items of a material, and which of them could be added.

use std::cmp::Reverse;

use tileset::PageId;

use super::Material;
use crate::residency::{Item, Slot, group::Class, rank::Rank, value::Blocks, wanted::NONE};

impl Material {
    /// What an item of this material is worth.
    pub(in crate::residency) fn rank(&self, item: Item, pin: bool) -> Rank {
        match item {
            Item::Page(_, page) => {
                let tile = self.tile_index(page.tile).unwrap_or(0);
                self.page_rank(page.group.into(), tile, pin)
            }
            Item::Column(_, group) => self.column_rank(group.into(), pin),
        }
    }

    pub(in crate::residency) fn page_rank(&self, group: usize, tile: u32, pin: bool) -> Rank {
        self.rank_of(group, tile, self.page_worth(group, tile, pin))
    }

    /// Whether a page is pinned, its value, and its value ahead where it has none.
    fn page_worth(&self, group: usize, tile: u32, pin: bool) -> (bool, f64, f64) {
        let at = &self.groups[group];
        let pin = pin && group == 0 && tile == 0;
        if !(at.open || pin) {
            return (false, 0.0, 0.0);
        }
        let value = at.value_of(tile, Class::Now, &self.wanted[0]);
        if value > 0.0 {
            return (pin, value, 0.0);
        }
        (
            false,
            0.0,
            if at.open {
                at.value_of(tile, Class::Ahead, &self.wanted[1])
            } else {
                0.0
            },
        )
    }

    fn column_rank(&self, group: usize, pin: bool) -> Rank {
        let [worth, ahead] = self.groups[group].worth;
        let ahead = if worth > 0.0 { 0.0 } else { ahead };
        self.rank_of(group, 0, (pin && group == 0 && worth > 0.0, worth, ahead))
    }

    /// The root's rank, would the group be open.
    pub(in crate::residency) fn root_rank(&mut self, group: u16, pin: bool, blocks: &mut Blocks) -> Rank {
        let group = usize::from(group);
        self.value(group, blocks);
        let [value, ahead] = [Class::Now, Class::Ahead]
            .map(|class| self.groups[group].value_of(0, class, &self.wanted[class as usize]));
        let ahead = if value > 0.0 { 0.0 } else { ahead };
        self.rank_of(group, 0, (pin && group == 0 && value > 0.0, value, ahead))
    }

    /// Of a group's root: at most this much value of the present.
    pub(in crate::residency) fn root_bound(&self, group: u16) -> f64 {
        self.groups[usize::from(group)].worth[Class::Now as usize]
    }

    fn rank_of(&self, group: usize, tile: u32, (pinned, value, ahead): (bool, f64, f64)) -> Rank {
        let wanted = self.wanted[Class::Now as usize].has_tile(tile);
        Rank {
            pinned,
            value,
            ahead,
            last_wanted: if wanted {
                u64::MAX
            } else {
                self.last_wanted[tile as usize]
            },
            tile: Reverse(tile),
            group: Reverse(group as u16),
            material: Reverse(self.id.0),
        }
    }

    /// Ranks and slots of a group's resident pages.
    pub(in crate::residency) fn for_each_resident(
        &self,
        group: usize,
        pin: bool,
        mut each: impl FnMut(Rank, Slot),
    ) {
        let slots = self.page_slots(group);
        for &tile in &self.groups[group].residents {
            each(self.page_rank(group, tile, pin), Slot(slots[tile as usize]));
        }
    }

    /// Ranks of the pages that are wanted and not resident, but reachable.
    pub(in crate::residency) fn for_each_addable(&self, group: usize, pin: bool, mut each: impl FnMut(Rank)) {
        let at = &self.groups[group];
        if !(at.open || (pin && group == 0)) {
            return;
        }
        let mut each_wanted = |tile| {
            let rank = self.page_rank(group, tile, pin);
            if rank.is_wanted() {
                each(rank);
            }
        };
        if self.page_slots(group)[0] == NONE {
            each_wanted(0);
        }
        if at.column_slot != NONE {
            self.for_each_below_residents(group, each_wanted);
        }
    }

    /// Tiles of the pages right below resident ones, with the column or without.
    pub(in crate::residency) fn for_each_below_residents(&self, group: usize, mut each: impl FnMut(u32)) {
        let slots = self.page_slots(group);
        for &tile in &self.groups[group].residents {
            self.for_each_child(tile, |child| {
                if slots[child as usize] == NONE {
                    each(child);
                }
            });
        }
    }

    pub(in crate::residency) fn for_each_child(&self, tile: u32, mut each: impl FnMut(u32)) {
        let children = self.children[tile as usize].iter();
        children
            .filter(|child| **child != NONE)
            .for_each(|&child| each(child));
    }

    /// Ranks of all columns that are wanted and not resident.
    pub(in crate::residency) fn for_each_addable_column(&self, pin: bool, mut each: impl FnMut(Rank)) {
        for (at, group) in self.groups.iter().enumerate() {
            if group.column_slot == NONE && group.worth.iter().any(|worth| *worth > 0.0) {
                each(self.column_rank(at, pin));
            }
        }
    }

    /// The item with this rank.
    pub(in crate::residency) fn page_of(&self, rank: &Rank) -> Option<Item> {
        let tile = self.pyramid.tile_at(rank.tile.0)?;
        Some(Item::Page(
            self.id,
            PageId {
                group: rank.group.0,
                tile,
            },
        ))
    }
}
