//! What follows from the votes of one frame.

use engine::residency::{MaterialInfo, Vote};

/// Materials with their trees of tiles.
pub(super) struct Forest {
    pub(super) trees: Vec<Tree>,
}

/// A material: its tiles by index, coarse to fine.
pub(super) struct Tree {
    pub(super) groups: usize,
    pub(super) parents: Vec<Option<usize>>,
    pub(super) children: Vec<Vec<usize>>,
    weights: Vec<f32>,
}

impl Tree {
    pub(super) fn tiles(&self) -> usize {
        self.parents.len()
    }

    pub(super) fn weight(&self, group: usize, tile: usize) -> f64 {
        f64::from(self.weights[group * self.tiles() + tile])
    }
}

impl Forest {
    pub(super) fn new(materials: &[MaterialInfo]) -> Self {
        let tree = |info: &MaterialInfo| {
            let pyramid = &info.pyramid;
            let index = |tile| pyramid.tile_index(tile).map(|tile| tile as usize);
            Tree {
                groups: info.groups.into(),
                parents: pyramid
                    .tiles()
                    .map(|tile| pyramid.parent(tile).and_then(index))
                    .collect(),
                children: pyramid
                    .tiles()
                    .map(|tile| pyramid.children(tile).filter_map(index).collect())
                    .collect(),
                weights: info.weights.clone(),
            }
        };
        Self {
            trees: materials.iter().map(tree).collect(),
        }
    }
}

/// Votes of a frame by tile.
pub(super) struct View {
    /// Pixels that want the tile itself, `[material][tile]`.
    own: Vec<Vec<f64>>,
    /// v of the paper, `[material][tile]`.
    counts: Vec<Vec<f64>>,
    /// Tiles with v above zero by material, coarse to fine.
    wanted: Vec<Vec<usize>>,
    pixels: f64,
}

impl View {
    pub(super) fn new(forest: &Forest, votes: &[Vote]) -> Self {
        let mut own: Vec<Vec<f64>> = forest.trees.iter().map(|tree| vec![0.0; tree.tiles()]).collect();
        for vote in votes {
            let tiles = own.get_mut(usize::from(vote.material.0));
            if let Some(pixels) = tiles.and_then(|tiles| tiles.get_mut(vote.tile as usize)) {
                *pixels += f64::from(vote.pixels);
            }
        }
        let mut counts = own.clone();
        for (tree, counts) in forest.trees.iter().zip(&mut counts) {
            for tile in (0..tree.tiles()).rev() {
                if let Some(parent) = tree.parents[tile] {
                    counts[parent] += counts[tile];
                }
            }
        }
        let wanted = counts
            .iter()
            .map(|counts| (0..counts.len()).filter(|&tile| counts[tile] > 0.0).collect());
        Self {
            pixels: own.iter().flatten().sum(),
            wanted: wanted.collect(),
            own,
            counts,
        }
    }

    pub(super) fn count(&self, material: usize, tile: usize) -> f64 {
        self.counts[material][tile]
    }

    pub(super) fn wanted(&self, material: usize) -> &[usize] {
        &self.wanted[material]
    }

    /// Pages with votes, in all groups.
    pub(super) fn pages(&self, forest: &Forest) -> usize {
        forest
            .trees
            .iter()
            .zip(&self.wanted)
            .map(|(tree, wanted)| tree.groups * wanted.len())
            .sum()
    }

    pub(super) fn pixels(&self) -> f64 {
        self.pixels
    }

    /// Mean squared error of reflectance over the pixels: each shows the finest resident page on the way from the one
    /// it wants to the root, and misses the weights below it.
    pub(super) fn mse(&self, forest: &Forest, resident: impl Fn(usize, usize, usize) -> bool) -> f64 {
        let mut sum = 0.0;
        let mut missing = Vec::new();
        for (material, tree) in forest.trees.iter().enumerate() {
            missing.resize(tree.tiles(), 0.0);
            for group in 0..tree.groups {
                for &tile in &self.wanted[material] {
                    let above = tree.parents[tile].map_or(0.0, |parent| missing[parent]);
                    let there = resident(material, group, tile);
                    missing[tile] = if there {
                        0.0
                    } else {
                        above + tree.weight(group, tile)
                    };
                    sum += self.own[material][tile] * missing[tile];
                }
            }
        }
        sum / self.pixels.max(1.0)
    }
}
