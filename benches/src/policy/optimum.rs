//! The least error that any set of pages has.

use engine::residency::{MaterialInfo, Vote};

use super::view::{Forest, View};

/// The least mean squared error of reflectance that a closed set of 0, 1, … `pages` pages has for static votes, with all
/// columns. Exact: a knapsack in each group's tree, then one over all groups, in O(wanted pages · `pages`).
pub fn optimum(materials: &[MaterialInfo], votes: &[Vote], pages: usize) -> Vec<f64> {
    let forest = Forest::new(materials);
    let view = View::new(&forest, votes);
    best(&forest, &view, pages)
}

/// As [`optimum`].
pub(super) fn best(forest: &Forest, view: &View, pages: usize) -> Vec<f64> {
    let mut all = vec![0.0];
    let mut whole = 0.0;
    for (material, tree) in forest.trees.iter().enumerate() {
        for group in 0..tree.groups {
            // From the finest tiles up: the most that a set with this page at its top gains, by its number of pages.
            let mut gains: Vec<Vec<f64>> = vec![Vec::new(); tree.tiles()];
            for &tile in view.wanted(material).iter().rev() {
                let gain = tree.weight(group, tile) * view.count(material, tile);
                whole += gain;
                let mut below = vec![0.0];
                for &child in &tree.children[tile] {
                    below = join(&below, &std::mem::take(&mut gains[child]), pages);
                }
                gains[tile] = std::iter::once(0.0)
                    .chain(below.into_iter().map(|sum| sum + gain))
                    .collect();
            }
            all = join(&all, &gains.into_iter().next().unwrap_or_default(), pages);
        }
    }
    let last = all.last().copied().unwrap_or(0.0);
    all.resize(pages + 1, last);
    all.into_iter()
        .map(|gain| (whole - gain).max(0.0) / view.pixels().max(1.0))
        .collect()
}

/// The best split of each number of pages between two sets of trees.
fn join(a: &[f64], b: &[f64], pages: usize) -> Vec<f64> {
    if b.len() <= 1 {
        return a.to_vec();
    }
    let mut best = vec![f64::NEG_INFINITY; (a.len() + b.len() - 1).min(pages + 1)];
    for (second, more) in b.iter().enumerate().take(best.len()) {
        for (best, first) in best[second..].iter_mut().zip(a) {
            *best = f64::max(*best, first + more);
        }
    }
    best
}
