//! In which order records are asked for.

use engine::residency::{HEAD_BYTES, Item, MaterialId, MaterialInfo, Vote};
use serde::{Deserialize, Serialize};
use tileset::PageId;

use super::schedule::rates;

/// What decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Contender {
    /// `engine::residency`.
    Ours,
    /// All that is seen, coarse to fine: all groups and tiles of a mip before those of the next, columns with the coarsest.
    Breadth,
    /// Exactly the tiles that pixels want now, all groups of each, with their ancestors first; those that were newly
    /// wanted first, then those that most pixels want. What was wanted least recently gives way.
    Demand,
    /// Schwartz, Ruiters, Klein 2013: pages by P = w·v (equations 8 and 9), columns by the same sum over the resident pages
    /// of their group (section 6), one by one; the page of the least cost (equation 10) gives way.
    Paper,
    /// No contender but what none can do: indices cost nothing, and records come in the exact best order for the gains that
    /// `engine::residency` counts by.
    Bound,
}

impl Contender {
    /// Ours first.
    pub const ALL: [Self; 5] = [Self::Ours, Self::Breadth, Self::Demand, Self::Paper, Self::Bound];
    /// What ours is measured against.
    pub const BASELINES: [Self; 3] = [Self::Breadth, Self::Demand, Self::Paper];

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ours => "Eigentile",
            Self::Breadth => "breadth first",
            Self::Demand => "demand, LRU",
            Self::Paper => "order of 2013",
            Self::Bound => "bound",
        }
    }
}

/// A material, what is seen of it, and since when.
pub(super) struct Seen {
    pub(super) id: MaterialId,
    pub(super) info: MaterialInfo,
    pub(super) parents: Vec<Option<usize>>,
    pub(super) depths: Vec<u8>,
    /// Pixels that want the tile itself, and v of the paper, by tile.
    pub(super) own: Vec<u64>,
    pub(super) counts: Vec<u64>,
    /// Tiles with v above zero, coarse to fine.
    pub(super) wanted: Vec<usize>,
    /// Update from which on pixels have wanted the tile itself.
    since: Vec<u64>,
    /// v by the visibility of errors where votes fall, by tile.
    visible: Vec<f64>,
    /// In the best schedule the gain a byte of the block of each page, `[group][tile]`.
    rates: Vec<f64>,
}

impl Seen {
    pub(super) fn new(id: MaterialId, info: MaterialInfo) -> Self {
        let pyramid = info.pyramid;
        let index = |tile| pyramid.tile_index(tile).map(|tile| tile as usize);
        let parents: Vec<Option<usize>> = pyramid
            .tiles()
            .map(|tile| pyramid.parent(tile).and_then(index))
            .collect();
        let mut depths: Vec<u8> = Vec::with_capacity(parents.len());
        for parent in &parents {
            depths.push(parent.map_or(0, |parent| depths[parent] + 1));
        }
        let tiles = parents.len();
        Self {
            id,
            info,
            parents,
            depths,
            own: vec![0; tiles],
            counts: vec![0; tiles],
            wanted: Vec::new(),
            since: vec![0; tiles],
            visible: vec![0.0; tiles],
            rates: Vec::new(),
        }
    }

    /// Replaces the votes, of which those for other materials are ignored.
    pub(super) fn set_votes(&mut self, votes: &[Vote], now: u64) {
        let before = std::mem::replace(&mut self.own, vec![0; self.parents.len()]);
        for vote in votes.iter().filter(|vote| vote.material == self.id) {
            if let Some(own) = self.own.get_mut(vote.tile as usize) {
                *own += u64::from(vote.pixels);
            }
        }
        for (since, (&own, &before)) in self.since.iter_mut().zip(self.own.iter().zip(&before)) {
            if own > 0 && before == 0 {
                *since = now;
            }
        }
        self.counts.clone_from(&self.own);
        let visibility = self.info.visibility.iter().copied().chain(std::iter::repeat(1.0));
        let visible = self.own.iter().zip(visibility);
        self.visible = visible
            .map(|(&own, visibility)| own as f64 * f64::from(visibility))
            .collect();
        for tile in (0..self.parents.len()).rev() {
            if let Some(parent) = self.parents[tile] {
                self.counts[parent] += self.counts[tile];
                self.visible[parent] += self.visible[tile];
            }
        }
        self.wanted = (0..self.counts.len())
            .filter(|&tile| self.counts[tile] > 0)
            .collect();
    }

    /// Works out the best schedule for the present votes: of each group a tree of its column, its root, and its other pages.
    pub(super) fn schedule(&mut self) {
        self.rates = vec![0.0; usize::from(self.info.groups) * self.tiles()];
        let mut places = vec![0; self.tiles()];
        for (place, &tile) in (1..).zip(&self.wanted) {
            places[tile] = place;
        }
        for group in 0..self.info.groups {
            let cost = |item| match self.bytes(item) {
                // What is not stored is not sent either.
                0 => f64::MIN_POSITIVE,
                bytes => (bytes + HEAD_BYTES) as f64,
            };
            let (mut gains, mut parents) = (vec![0.0], vec![None]);
            let mut bytes = vec![cost(Item::Column(self.id, group))];
            for &tile in &self.wanted {
                gains.push(self.weight(group, tile) * self.visible[tile]);
                bytes.push(self.page(group, tile).map_or(f64::MIN_POSITIVE, cost));
                parents.push(Some(self.parents[tile].map_or(0, |parent| places[parent])));
            }
            let rates = rates(&gains, &bytes, &parents);
            let first = usize::from(group) * self.tiles();
            for (&tile, rate) in self.wanted.iter().zip(&rates[1..]) {
                self.rates[first + tile] = *rate;
            }
        }
    }

    pub(super) fn tiles(&self) -> usize {
        self.parents.len()
    }

    pub(super) fn page(&self, group: u16, tile: usize) -> Option<Item> {
        let tile = self.info.pyramid.tile_at(tile as u32)?;
        Some(Item::Page(self.id, PageId { group, tile }))
    }

    pub(super) fn tile(&self, page: PageId) -> Option<usize> {
        self.info.pyramid.tile_index(page.tile).map(|tile| tile as usize)
    }

    /// w of equation 8; a weight that is no number counts as none.
    pub(super) fn weight(&self, group: u16, tile: usize) -> f64 {
        let at = usize::from(group) * self.tiles() + tile;
        let weight = self.info.weights.get(at).copied().map_or(0.0, f64::from);
        if weight.is_finite() { weight.max(0.0) } else { 0.0 }
    }

    /// P of equation 9.
    pub(super) fn priority(&self, group: u16, tile: usize) -> f64 {
        self.weight(group, tile) * self.counts[tile] as f64
    }

    /// Bytes of a record.
    pub(super) fn bytes(&self, item: Item) -> u64 {
        let bytes = match item {
            Item::Page(_, page) => self.tile(page).and_then(|tile| {
                let at = usize::from(page.group) * self.tiles() + tile;
                self.info.page_bytes.get(at)
            }),
            Item::Column(_, group) => self.info.column_bytes.get(usize::from(group)),
        };
        bytes.copied().unwrap_or(0).into()
    }
}

/// Smaller comes first.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub(super) struct Key(f64, u32, u32);

/// The order of what is seen at one time.
pub(super) struct Order {
    contender: Contender,
    /// Of each tile of each material, the place of the first of the tiles below it in the order of demand.
    demand: Vec<Vec<u32>>,
}

impl Order {
    pub(super) fn new(contender: Contender, seen: &[Seen]) -> Self {
        let demand = match contender {
            Contender::Demand => demand(seen),
            _ => Vec::new(),
        };
        Self { contender, demand }
    }

    pub(super) fn page(&self, seen: &Seen, group: u16, tile: usize) -> Key {
        let depth = u32::from(seen.depths[tile]);
        match self.contender {
            Contender::Demand => {
                let place = self.demand[usize::from(seen.id.0)][tile];
                Key(f64::from(place), depth, 2 * u32::from(group) + 1)
            }
            Contender::Paper => Key(-seen.priority(group, tile), 1, 0),
            Contender::Bound => Key(-seen.rates[usize::from(group) * seen.tiles() + tile], 1, depth),
            _ => Key(f64::from(depth), 2 * u32::from(group) + 1, 0),
        }
    }

    /// `resident`: the sum of P over the resident pages of the group.
    pub(super) fn column(&self, seen: &Seen, group: u16, resident: f64) -> Key {
        match self.contender {
            Contender::Demand => {
                let place = self.demand[usize::from(seen.id.0)][0];
                Key(f64::from(place), 0, 2 * u32::from(group))
            }
            Contender::Paper => Key(-resident, 0, 0),
            // With the root, which is right behind it.
            Contender::Bound => Key(-seen.rates[usize::from(group) * seen.tiles()], 0, 0),
            _ => Key(0.0, 2 * u32::from(group), 0),
        }
    }
}

fn demand(seen: &[Seen]) -> Vec<Vec<u32>> {
    let mut leaves: Vec<_> = seen
        .iter()
        .enumerate()
        .flat_map(|(material, seen)| {
            let leaves = seen.wanted.iter().filter(|&&tile| seen.own[tile] > 0);
            leaves.map(move |&tile| {
                let newest = std::cmp::Reverse((seen.since[tile], seen.own[tile]));
                (newest, material, tile)
            })
        })
        .collect();
    leaves.sort_unstable();
    let mut places: Vec<Vec<u32>> = seen.iter().map(|seen| vec![u32::MAX; seen.tiles()]).collect();
    for (place, (_, material, tile)) in (0..).zip(leaves) {
        let mut at = Some(tile);
        while let Some(tile) = at {
            let first = &mut places[material][tile];
            *first = (*first).min(place);
            at = seen[material].parents[tile];
        }
    }
    places
}
