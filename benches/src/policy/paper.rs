//! The paper's plain formulas: Schwartz, Ruiters, Klein 2013, sections 5.1 and 5.2, with w, v and c by equations 8 to 10.
//!
//! `add` puts the tile of highest P = w·v whose parent is in the cache into a free place, or a root; ancestors that their
//! children then cover go. `swap` takes two tiles out and puts their common ancestor in. What the paper leaves open is read
//! in its favour: where the ancestor is there already, one tile may go alone; the last tile of a group may go for all that it
//! shows; an ancestor that a swap brings back is loaded like any tile, and its own ancestors are at hand (its host cache).

use engine::residency::{MaterialInfo, Vote};

use super::{
    run::Replay,
    view::{Forest, Tree, View},
};

pub(super) struct Paper {
    forest: Forest,
    slots: usize,
    /// By group of each material, flat; by tile.
    groups: Vec<Group>,
    used: usize,
    loads: u64,
}

struct Group {
    material: usize,
    group: usize,
    resident: Vec<bool>,
    /// The tile of highest P.
    add: Option<(f64, usize)>,
    /// The cheapest swap.
    swap: Option<(f64, Swap)>,
}

/// Tiles that go, and the ancestor that comes.
#[derive(Clone, Copy)]
struct Swap {
    out: [Option<usize>; 2],
    back: Option<usize>,
}

impl Paper {
    pub(super) fn new(materials: &[MaterialInfo], slots: usize) -> Self {
        let forest = Forest::new(materials);
        let groups = forest.trees.iter().enumerate().flat_map(|(material, tree)| {
            (0..tree.groups).map(move |group| Group {
                material,
                group,
                resident: vec![false; tree.tiles()],
                add: None,
                swap: None,
            })
        });
        Self {
            groups: groups.collect(),
            forest,
            slots,
            used: 0,
            loads: 0,
        }
    }

    fn add(&mut self, at: usize, tile: usize) {
        let group = &mut self.groups[at];
        let tree = &self.forest.trees[group.material];
        group.resident[tile] = true;
        self.used += 1;
        let mut above = tree.parents[tile];
        while let Some(ancestor) = above {
            if group.resident[ancestor] && covered(tree, &group.resident, ancestor) {
                group.resident[ancestor] = false;
                self.used -= 1;
            }
            above = tree.parents[ancestor];
        }
        self.loads += 1;
    }

    /// Returns whether a tile had to be loaded for it.
    fn swap(&mut self, at: usize, swap: Swap) -> bool {
        let group = &mut self.groups[at];
        for tile in swap.out.into_iter().flatten() {
            group.resident[tile] = false;
            self.used -= 1;
        }
        if let Some(back) = swap.back {
            group.resident[back] = true;
            self.used += 1;
            self.loads += 1;
        }
        swap.back.is_some()
    }
}

/// Whether what lies below a tile covers it.
fn covered(tree: &Tree, resident: &[bool], tile: usize) -> bool {
    let children = &tree.children[tile];
    !children.is_empty()
        && children
            .iter()
            .all(|&child| resident[child] || covered(tree, resident, child))
}

impl Group {
    fn find(&mut self, forest: &Forest, view: &View) {
        let tree = &forest.trees[self.material];
        self.add = self.best_add(tree, view);
        self.swap = self.best_swap(tree, view);
    }

    fn best_add(&self, tree: &Tree, view: &View) -> Option<(f64, usize)> {
        // Below tiles that are resident or covered; the root if nothing of the group is there.
        let addable = |tile: usize| match tree.parents[tile] {
            None => !self.resident.contains(&true),
            Some(parent) => self.resident[parent] && !covered(tree, &self.resident, tile),
        };
        let tiles = view
            .wanted(self.material)
            .iter()
            .filter(|&&tile| !self.resident[tile] && addable(tile));
        let priorities = tiles.map(|&tile| {
            (
                tree.weight(self.group, tile) * view.count(self.material, tile),
                tile,
            )
        });
        priorities
            .filter(|add| add.0 > 0.0)
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
    }

    /// Equation 10: the weights of all levels from the ancestor's on, times the votes of the tile. `None` stands for the
    /// level above the root.
    fn cost(&self, tree: &Tree, view: &View, tile: usize, ancestor: Option<usize>) -> f64 {
        let mut sum = 0.0;
        let mut at = Some(tile);
        while let Some(level) = at {
            sum += tree.weight(self.group, level);
            if at == ancestor {
                break;
            }
            at = tree.parents[level];
        }
        sum * view.count(self.material, tile)
    }

    fn best_swap(&self, tree: &Tree, view: &View) -> Option<(f64, Swap)> {
        let mut best: Option<(f64, Swap)> = None;
        let mut offer = |cost: f64, out: [Option<usize>; 2], back: Option<usize>| {
            if best.is_none_or(|best| cost < best.0) {
                best = Some((cost, Swap { out, back }));
            }
        };
        let resident: Vec<usize> = (0..tree.tiles()).filter(|&tile| self.resident[tile]).collect();
        if let [last] = resident[..] {
            offer(self.cost(tree, view, last, None), [Some(last), None], None);
            return best;
        }
        // The two cheapest tiles below each ancestor that is not there; coarser ones cost more levels.
        let mut pairs: Vec<[Option<(f64, usize)>; 2]> = vec![[None; 2]; tree.tiles()];
        let mut inner = vec![false; tree.tiles()];
        for &tile in resident.iter().rev() {
            let leaf = !inner[tile];
            let mut above = tree.parents[tile];
            let mut stopped = !leaf;
            while let Some(ancestor) = above {
                inner[ancestor] = true;
                if !stopped {
                    let cost = self.cost(tree, view, tile, Some(ancestor));
                    if self.resident[ancestor] {
                        offer(
                            cost - tree.weight(self.group, ancestor) * view.count(self.material, tile),
                            [Some(tile), None],
                            None,
                        );
                        stopped = true;
                    } else {
                        let pair = &mut pairs[ancestor];
                        if pair[0].is_none_or(|first| cost < first.0) {
                            *pair = [Some((cost, tile)), pair[0]];
                        } else if pair[1].is_none_or(|second| cost < second.0) {
                            pair[1] = Some((cost, tile));
                        }
                    }
                }
                above = tree.parents[ancestor];
            }
        }
        for (ancestor, pair) in pairs.iter().enumerate() {
            if let [Some(first), Some(second)] = pair {
                offer(
                    first.0 + second.0,
                    [Some(first.1), Some(second.1)],
                    Some(ancestor),
                );
            }
        }
        best
    }
}

impl Replay for Paper {
    fn frame(&mut self, votes: &[Vote], loads: usize) -> usize {
        let view = View::new(&self.forest, votes);
        for group in &mut self.groups {
            group.find(&self.forest, &view);
        }
        let mut loaded = 0;
        while loaded < loads {
            let adds = self
                .groups
                .iter()
                .enumerate()
                .filter_map(|(at, group)| group.add.map(|add| (add.0, at, add.1)));
            let Some((priority, at, tile)) = adds.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
            else {
                break;
            };
            if self.used >= self.slots {
                let swaps = self
                    .groups
                    .iter()
                    .enumerate()
                    .filter_map(|(at, group)| group.swap.map(|swap| (swap.0, at, swap.1)));
                let cheapest = swaps.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let Some((_, from, swap)) = cheapest.filter(|cheapest| cheapest.0 < priority) else {
                    break;
                };
                loaded += usize::from(self.swap(from, swap));
                self.groups[from].find(&self.forest, &view);
                // What was to be added may have lost its parent.
                continue;
            }
            self.add(at, tile);
            loaded += 1;
            self.groups[at].find(&self.forest, &view);
        }
        loaded
    }

    fn resident(&self, material: usize, group: usize, tile: usize) -> bool {
        let before: usize = self.forest.trees[..material].iter().map(|tree| tree.groups).sum();
        let (tree, resident) = (
            &self.forest.trees[material],
            &self.groups[before + group].resident,
        );
        resident[tile] || covered(tree, resident, tile)
    }

    fn loads(&self) -> u64 {
        self.loads
    }
}
