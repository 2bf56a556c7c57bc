//! Tiles of one material that votes want.

pub(super) const NONE: u32 = u32::MAX;

/// Votes of one class, and what follows from them for the tiles: the counts of equation 9.
///
/// A tile is wanted if it or a descendant has votes. What is kept for wanted tiles is in the order of their indices,
/// root first.
#[derive(Default)]
pub(super) struct Wanted {
    /// Votes as they came: tile and pixels, by tile, each tile once.
    votes: Vec<(u32, u64)>,
    /// v, for every tile.
    counts: Vec<u64>,
    /// For each tile its place among the wanted ones.
    places: Vec<u32>,
    tiles: Vec<u32>,
    /// For each wanted tile the place of its parent.
    parents: Vec<u32>,
    /// For each wanted tile v.
    pixels: Vec<f64>,
    /// The same, each pixel counted by the visibility of errors where its vote falls.
    visible: Vec<f64>,
}

impl Wanted {
    pub(super) fn is_empty(&self) -> bool {
        self.tiles.is_empty()
    }

    /// Wanted tiles.
    pub(super) fn tiles(&self) -> &[u32] {
        &self.tiles
    }

    pub(super) fn parents(&self) -> &[u32] {
        &self.parents
    }

    /// Whether a tile is wanted.
    pub(super) fn has_tile(&self, tile: u32) -> bool {
        self.places.get(tile as usize).is_some_and(|&place| place != NONE)
    }

    /// Of values of the wanted tiles that of one tile; zero if it is none of them.
    pub(super) fn pick(&self, values: &[f64], tile: u32) -> f64 {
        let place = self.places.get(tile as usize);
        // There are never as many values as NONE.
        place
            .and_then(|&place| values.get(place as usize))
            .copied()
            .unwrap_or(0.0)
    }

    /// w·v of each wanted tile.
    pub(super) fn errors<'a>(&'a self, weights: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        let wanted = self.tiles.iter().zip(&self.pixels);
        wanted.map(|(&tile, pixels)| f64::from(weights[tile as usize]) * pixels)
    }

    /// The same by visibility: what a page is worth by itself.
    pub(super) fn worths<'a>(&'a self, weights: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        let wanted = self.tiles.iter().zip(&self.visible);
        wanted.map(|(&tile, visible)| f64::from(weights[tile as usize]) * visible)
    }

    /// Sums over the wanted tiles of what their pages are worth, and of w·v, of each group; weights are `[tile][group]`.
    pub(super) fn sum(&self, weights: &[f32], sums: &mut [[f64; 2]]) {
        sums.fill([0.0; 2]);
        for ((&tile, pixels), visible) in self.tiles.iter().zip(&self.pixels).zip(&self.visible) {
            let weights = &weights[tile as usize * sums.len()..][..sums.len()];
            for ([worth, error], weight) in sums.iter_mut().zip(weights) {
                *worth += f64::from(*weight) * visible;
                *error += f64::from(*weight) * pixels;
            }
        }
    }

    /// Whether these are the votes already.
    pub(super) fn has(&self, votes: &[(u32, u64)]) -> bool {
        self.votes == votes
    }

    /// Replaces the votes, given by tile and each tile once; what changes are the ways from the tiles whose votes
    /// differ up to the root. `parents` and `visibility` are those of all tiles. Tells `left` which tiles are wanted no more.
    pub(super) fn set(
        &mut self,
        votes: &mut Vec<(u32, u64)>,
        parents: &[u32],
        visibility: &[f32],
        left: impl FnMut(u32),
    ) {
        self.counts.resize(parents.len(), 0);
        self.places.resize(parents.len(), NONE);
        let mut touched = Vec::new();
        let (mut old, mut new) = (self.votes.iter().peekable(), votes.iter().peekable());
        loop {
            let tile = match (old.peek(), new.peek()) {
                (None, None) => break,
                (old, new) => [old, new]
                    .into_iter()
                    .flatten()
                    .map(|vote| vote.0)
                    .min()
                    .unwrap_or(0),
            };
            let less = old.next_if(|vote| vote.0 == tile).map_or(0, |vote| vote.1);
            let more = new.next_if(|vote| vote.0 == tile).map_or(0, |vote| vote.1);
            let mut at = if less == more { NONE } else { tile };
            while at != NONE {
                let count = &mut self.counts[at as usize];
                if *count == 0 {
                    touched.push(at);
                }
                *count = count.wrapping_sub(less).wrapping_add(more);
                at = parents[at as usize];
            }
        }
        std::mem::swap(&mut self.votes, votes);
        self.list(touched, parents, left);
        self.weigh(visibility);
    }

    /// Sums up by visibility, children before their parents.
    fn weigh(&mut self, visibility: &[f32]) {
        self.visible.clear();
        let mut votes = self.votes.iter().peekable();
        self.visible.extend(self.tiles.iter().map(|&tile| {
            let own = votes.next_if(|vote| vote.0 == tile).map_or(0, |vote| vote.1);
            own as f64 * f64::from(visibility[tile as usize])
        }));
        for place in (1..self.tiles.len()).rev() {
            self.visible[self.parents[place] as usize] += self.visible[place];
        }
    }

    fn list(&mut self, touched: Vec<u32>, parents: &[u32], mut left: impl FnMut(u32)) {
        let before = self.tiles.len();
        let (counts, places) = (&self.counts, &mut self.places);
        self.tiles.retain(|&tile| {
            let stays = counts[tile as usize] > 0;
            if !stays {
                places[tile as usize] = NONE;
                left(tile);
            }
            stays
        });
        let stayed = self.tiles.len();
        let places = &self.places;
        let new = touched
            .into_iter()
            .filter(|&tile| places[tile as usize] == NONE && counts[tile as usize] > 0);
        self.tiles.extend(new);
        if stayed < before || stayed < self.tiles.len() {
            self.tiles.sort_unstable();
            self.tiles.dedup();
            for (place, &tile) in (0..).zip(&self.tiles) {
                self.places[tile as usize] = place;
            }
            self.parents.clear();
            let parent = |&tile: &u32| match parents[tile as usize] {
                NONE => NONE,
                parent => self.places[parent as usize],
            };
            self.parents.extend(self.tiles.iter().map(parent));
        }
        self.pixels.clear();
        self.pixels
            .extend(self.tiles.iter().map(|&tile| self.counts[tile as usize] as f64));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Tile t has the tiles 2t + 1 and 2t + 2 below it.
    fn parents() -> Vec<u32> {
        (0..31u32)
            .map(|tile| if tile == 0 { NONE } else { (tile - 1) / 2 })
            .collect()
    }

    fn votes() -> impl Strategy<Value = Vec<(u32, u64)>> {
        prop::collection::btree_map(0u32..31, 1u64..9, 0..10).prop_map(|votes| votes.into_iter().collect())
    }

    proptest! {
        #[test]
        fn changed_votes_give_what_new_ones_give(trace in prop::collection::vec(votes(), 1..8)) {
            let parents = parents();
            let visibility: Vec<f32> = (0..31u8).map(|tile| f32::from(tile % 5 + 1)).collect();
            let mut wanted = Wanted::default();
            for votes in trace {
                let before: Vec<u32> = wanted.tiles().to_vec();
                let mut left = Vec::new();
                wanted.set(&mut votes.clone(), &parents, &visibility, |tile| left.push(tile));
                let mut fresh = Wanted::default();
                fresh.set(&mut votes.clone(), &parents, &visibility, |_| {});
                prop_assert_eq!(&wanted.tiles, &fresh.tiles);
                prop_assert_eq!(&wanted.parents, &fresh.parents);
                prop_assert_eq!(&wanted.pixels, &fresh.pixels);
                prop_assert_eq!(&wanted.places, &fresh.places);
                let gone = before.into_iter().filter(|tile| !fresh.tiles.contains(tile));
                prop_assert_eq!(left, gone.collect::<Vec<_>>());
                for ((&tile, &pixels), &visible) in wanted.tiles.iter().zip(&wanted.pixels).zip(&wanted.visible) {
                    let below = votes.iter().filter(|vote| {
                        let mut at = vote.0;
                        while at != tile && at != 0 {
                            at = parents[at as usize];
                        }
                        at == tile
                    });
                    let below: Vec<_> = below.collect();
                    prop_assert_eq!(below.iter().map(|vote| vote.1).sum::<u64>() as f64, pixels);
                    // Whole numbers, so the sum is exact in any order.
                    let weighed = below.iter().map(|vote| vote.1 as f64 * f64::from(visibility[vote.0 as usize]));
                    prop_assert_eq!(weighed.sum::<f64>(), visible);
                }
            }
        }
    }
}
