//! What pages and columns are worth, and the order that follows.

use std::cmp::Reverse;

use engine::residency::{Item, MaterialId, MaterialInfo, SLOTS_PER_PIN, SWAP_MARGIN};
use tileset::{PageId, Tile};

use super::Plain;

/// Pinned, value, value ahead, last wanted, tile, group, material.
pub(super) type Rank = (bool, f64, f64, u64, Reverse<u32>, Reverse<u16>, Reverse<u16>);

pub(super) fn compare(a: &Rank, b: &Rank) -> std::cmp::Ordering {
    a.partial_cmp(b).expect("numbers")
}

pub(super) fn exceeds(a: &Rank, b: &Rank) -> bool {
    (a.0, a.1, a.2) > (b.0, b.1, b.2)
}

pub(super) fn exceeds_by_margin(a: &Rank, b: &Rank) -> bool {
    let by = 1.0 + SWAP_MARGIN;
    (a.0 && !b.0) || (a.0 == b.0 && (a.1 > b.1 * by || (a.1 == 0.0 && b.1 == 0.0 && a.2 > b.2 * by)))
}

pub(super) fn is_wanted(rank: &Rank) -> bool {
    rank.1 > 0.0 || rank.2 > 0.0
}

impl Plain {
    /// w·v, each pixel by the visibility of errors where its vote falls.
    pub(super) fn gain(&self, material: u16, group: u16, tile: Tile, class: usize) -> f64 {
        let MaterialInfo { pyramid, weights, .. } = &self.materials[usize::from(material)];
        let index = pyramid.tile_index(tile).expect("a tile") as usize;
        let weight = weights[usize::from(group) * pyramid.tile_count() as usize + index];
        f64::from(weight) * self.visible_count(material, tile, class)
    }

    fn visible_count(&self, material: u16, tile: Tile, class: usize) -> f64 {
        let MaterialInfo {
            pyramid, visibility, ..
        } = &self.materials[usize::from(material)];
        let own = self.votes[class]
            .iter()
            .filter(|vote| vote.material.0 == material && pyramid.tile_at(vote.tile) == Some(tile));
        let index = pyramid.tile_index(tile).expect("a tile") as usize;
        let visibility = visibility
            .get(index)
            .map_or(1.0, |visibility| f64::from(*visibility));
        let below = pyramid
            .children(tile)
            .map(|child| self.visible_count(material, child, class));
        own.map(|vote| f64::from(vote.pixels)).sum::<f64>() * visibility + below.sum::<f64>()
    }

    /// v: votes of the tile and its descendants.
    pub(super) fn count(&self, material: u16, tile: Tile, class: usize) -> u64 {
        let pyramid = &self.materials[usize::from(material)].pyramid;
        let own = self.votes[class]
            .iter()
            .filter(|vote| vote.material.0 == material && pyramid.tile_at(vote.tile) == Some(tile));
        own.map(|vote| u64::from(vote.pixels)).sum::<u64>()
            + pyramid
                .children(tile)
                .map(|child| self.count(material, child, class))
                .sum::<u64>()
    }

    /// The block of a page, with the blocks below it.
    fn block(&self, material: u16, group: u16, tile: Tile, class: usize) -> Block {
        let pyramid = self.materials[usize::from(material)].pyramid;
        let children = pyramid.children(tile);
        let mut block = Block {
            sum: self.gain(material, group, tile, class),
            tiles: vec![tile],
            below: children
                .map(|child| self.block(material, group, child, class))
                .collect(),
        };
        while let Some(best) =
            (0..block.below.len()).max_by(|&a, &b| block.below[a].mean().total_cmp(&block.below[b].mean()))
            && block.below[best].mean() > block.mean()
        {
            let best = block.below.swap_remove(best);
            block.sum += best.sum;
            block.tiles.extend(best.tiles);
            block.below.extend(best.below);
        }
        block
    }

    /// Works out what follows from the votes, from nothing else.
    pub(super) fn find_values(&mut self) {
        self.values.clear();
        self.worths.clear();
        for (material, info) in (0..).zip(&self.materials) {
            for (group, class) in (0..info.groups).flat_map(|group| [(group, 0), (group, 1)]) {
                let worth = info
                    .pyramid
                    .tiles()
                    .map(|tile| self.gain(material, group, tile, class))
                    .sum();
                self.worths.insert((material, group, class), worth);
                let mut open = vec![self.block(material, group, info.pyramid.root(), class)];
                while let Some(block) = open.pop() {
                    let mean = block.mean();
                    let tiles = block.tiles.into_iter();
                    self.values
                        .extend(tiles.map(|tile| ((material, group, tile, class), mean)));
                    open.extend(block.below);
                }
            }
        }
    }

    pub(super) fn value(&self, material: u16, group: u16, tile: Tile, class: usize) -> f64 {
        self.values
            .get(&(material, group, tile, class))
            .copied()
            .unwrap_or(0.0)
    }

    pub(super) fn worth(&self, material: u16, group: u16, class: usize) -> f64 {
        self.worths.get(&(material, group, class)).copied().unwrap_or(0.0)
    }

    pub(super) fn visible(&self, material: u16) -> bool {
        self.count(material, self.materials[usize::from(material)].pyramid.root(), 0) > 0
    }

    pub(super) fn pins(&self, slots: u32) -> bool {
        (0..self.materials.len() as u16)
            .filter(|&material| self.visible(material))
            .count()
            <= (slots / SLOTS_PER_PIN) as usize
    }

    pub(super) fn is_open(&self, material: u16, group: u16) -> bool {
        self.opened.contains(&(material, group)) || self.has(Item::Column(MaterialId(material), group))
    }

    pub(super) fn page_rank(&self, material: u16, page: PageId, open: bool) -> Rank {
        let pyramid = self.materials[usize::from(material)].pyramid;
        let first = page.group == 0 && page.tile == pyramid.root();
        let value = self.value(material, page.group, page.tile, 0);
        let pinned = first && value > 0.0 && self.pins(self.limits.page_slots);
        let value = if open || pinned { value } else { 0.0 };
        let ahead = if open && value == 0.0 {
            self.value(material, page.group, page.tile, 1)
        } else {
            0.0
        };
        self.rank_of(material, page.group, page.tile, (pinned, value, ahead))
    }

    pub(super) fn rank_of(
        &self,
        material: u16,
        group: u16,
        tile: Tile,
        (pinned, value, ahead): (bool, f64, f64),
    ) -> Rank {
        let index = self.materials[usize::from(material)]
            .pyramid
            .tile_index(tile)
            .expect("a tile");
        let last = self.last_wanted.get(&(material, index)).copied().unwrap_or(0);
        (
            pinned,
            value,
            ahead,
            last,
            Reverse(index),
            Reverse(group),
            Reverse(material),
        )
    }

    pub(super) fn rank(&self, item: Item) -> Rank {
        match item {
            Item::Page(MaterialId(material), page) => {
                self.page_rank(material, page, self.is_open(material, page.group))
            }
            Item::Column(MaterialId(material), group) => {
                let value = self.worth(material, group, 0);
                let ahead = if value > 0.0 {
                    0.0
                } else {
                    self.worth(material, group, 1)
                };
                let pinned = group == 0 && value > 0.0 && self.pins(self.limits.column_slots);
                let root = self.materials[usize::from(material)].pyramid.root();
                self.rank_of(material, group, root, (pinned, value, ahead))
            }
        }
    }

    pub(super) fn root_rank(&self, material: u16, group: u16) -> Rank {
        let tile = self.materials[usize::from(material)].pyramid.root();
        self.page_rank(material, PageId { group, tile }, true)
    }
}

#[derive(Clone)]
struct Block {
    sum: f64,
    tiles: Vec<Tile>,
    below: Vec<Block>,
}

impl Block {
    fn mean(&self) -> f64 {
        self.sum / self.tiles.len() as f64
    }
}
