//! Least recently used, as virtual textures do it.

use std::collections::{BTreeMap, BTreeSet};

use engine::residency::{MaterialInfo, Vote};

use super::{
    run::Replay,
    view::{Forest, View},
};

/// Group, material, tile.
type Page = (usize, usize, usize);

/// Wants every page of every group that has votes; loads parents first, and within a mip group by group; evicts what
/// has not been wanted for longest, but nothing that is wanted now.
pub(super) struct Recency {
    forest: Forest,
    slots: usize,
    now: u64,
    /// Frame at which each resident page was wanted last.
    resident: BTreeMap<Page, u64>,
    /// The same the other way round. Of those wanted last in one frame the finest goes first.
    order: BTreeSet<(u64, std::cmp::Reverse<usize>, Page)>,
    loads: u64,
}

impl Recency {
    pub(super) fn new(materials: &[MaterialInfo], slots: usize) -> Self {
        Self {
            forest: Forest::new(materials),
            slots,
            now: 0,
            resident: BTreeMap::new(),
            order: BTreeSet::new(),
            loads: 0,
        }
    }

    fn touch(&mut self, page: Page) {
        let key = |last| (last, std::cmp::Reverse(page.2), page);
        if let Some(last) = self.resident.insert(page, self.now) {
            self.order.remove(&key(last));
        }
        self.order.insert(key(self.now));
    }
}

impl Replay for Recency {
    fn frame(&mut self, votes: &[Vote], loads: usize) -> usize {
        self.now += 1;
        let view = View::new(&self.forest, votes);
        let mut wanted = Vec::new();
        for (material, tree) in self.forest.trees.iter().enumerate() {
            let pages = (0..tree.groups)
                .flat_map(|group| view.wanted(material).iter().map(move |&tile| (group, tile)));
            wanted.extend(pages.map(|(group, tile)| (group, material, tile)));
        }
        let mut missing: Vec<(usize, Page)> = Vec::new();
        for page in wanted {
            let (group, material, tile) = page;
            if self.resident.contains_key(&page) {
                self.touch(page);
            } else if self.forest.trees[material].parents[tile]
                .is_none_or(|parent| self.resident.contains_key(&(group, material, parent)))
            {
                let mut depth = 0;
                let mut at = tile;
                while let Some(parent) = self.forest.trees[material].parents[at] {
                    (at, depth) = (parent, depth + 1);
                }
                missing.push((depth, page));
            }
        }
        missing.sort_unstable();
        let mut loaded = 0;
        for (_, page) in missing.into_iter().take(loads) {
            if self.resident.len() >= self.slots {
                let Some(&oldest) = self.order.first().filter(|(last, ..)| *last < self.now) else {
                    break;
                };
                self.order.remove(&oldest);
                self.resident.remove(&oldest.2);
            }
            self.touch(page);
            loaded += 1;
        }
        self.loads += loaded as u64;
        loaded
    }

    fn resident(&self, material: usize, group: usize, tile: usize) -> bool {
        self.resident.contains_key(&(group, material, tile))
    }

    fn loads(&self) -> u64 {
        self.loads
    }
}
