//! Values of pages that never grow from a page to its children.
//!
//! The value of a page is the largest mean of w·v over the connected sets of wanted pages that have it at the
//! top, or its parent's where the parent takes it into its own set. These sets are the blocks of the
//! classical order of jobs under tree-like precedence (Horn: Single-Machine Job Sequencing with Treelike
//! Precedence Ordering and Linear Delay Penalties, 1972): taking whole blocks by descending mean removes the
//! most error with any number of pages that ends at a block.

const NONE: u32 = u32::MAX;

/// Working memory, kept between calls.
///
/// Each block keeps the blocks below it in a pairing heap, largest mean on top (Fredman, Sedgewick, Sleator,
/// Tarjan 1986): all of it takes O(n log n) for any tree.
#[derive(Default)]
pub(super) struct Blocks {
    sum: Vec<f64>,
    count: Vec<u32>,
    mean: Vec<f64>,
    /// Taken into the block of the parent.
    taken: Vec<bool>,
    /// Top of the heap of blocks below.
    below: Vec<u32>,
    /// First child and next sibling within a heap.
    child: Vec<u32>,
    sibling: Vec<u32>,
    pairs: Vec<u32>,
}

impl Blocks {
    /// From each page's own w·v to its value; parents come before their children, the root is page 0.
    pub(super) fn share(&mut self, values: &mut [f64], parents: &[u32]) {
        let parent = |page: usize| parents[page] as usize;
        if (1..values.len()).all(|page| values[page] <= values[parent(page)]) {
            return;
        }
        self.reset(values);
        for page in (0..values.len()).rev() {
            while self.below[page] != NONE && self.mean[self.below[page] as usize] > self.mean[page] {
                self.take(page);
            }
            if page > 0 {
                self.below[parent(page)] = self.meld(self.below[parent(page)], page as u32);
            }
        }
        values[0] = self.mean[0];
        for page in 1..values.len() {
            let above = values[parent(page)];
            // The minimum only guards against rounding of the means.
            values[page] = if self.taken[page] {
                above
            } else {
                self.mean[page].min(above)
            };
        }
    }

    fn reset(&mut self, own: &[f64]) {
        let pages = own.len();
        self.sum.clear();
        self.sum.extend_from_slice(own);
        self.mean.clear();
        self.mean.extend_from_slice(own);
        self.count.clear();
        self.count.resize(pages, 1);
        self.taken.clear();
        self.taken.resize(pages, false);
        for links in [&mut self.below, &mut self.child, &mut self.sibling] {
            links.clear();
            links.resize(pages, NONE);
        }
    }

    /// Takes the best block below into the block of `page`.
    fn take(&mut self, page: usize) {
        let best = self.below[page] as usize;
        let rest = self.without_top(best);
        self.below[page] = self.meld(rest, self.below[best]);
        self.taken[best] = true;
        self.sum[page] += self.sum[best];
        self.count[page] += self.count[best];
        self.mean[page] = self.sum[page] / f64::from(self.count[page]);
    }

    fn meld(&mut self, a: u32, b: u32) -> u32 {
        if a == NONE || b == NONE {
            return a.min(b);
        }
        let (top, under) = if self.mean[a as usize] >= self.mean[b as usize] {
            (a, b)
        } else {
            (b, a)
        };
        self.sibling[under as usize] = self.child[top as usize];
        self.child[top as usize] = under;
        top
    }

    fn without_top(&mut self, top: usize) -> u32 {
        let mut pairs = std::mem::take(&mut self.pairs);
        let mut next = std::mem::replace(&mut self.child[top], NONE);
        while next != NONE {
            let first = next;
            let second = std::mem::replace(&mut self.sibling[first as usize], NONE);
            next = NONE;
            if second != NONE {
                next = std::mem::replace(&mut self.sibling[second as usize], NONE);
            }
            pairs.push(self.meld(first, second));
        }
        let rest = pairs
            .drain(..)
            .rev()
            .fold(NONE, |rest, pair| self.meld(rest, pair));
        self.pairs = pairs;
        rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(own: &[f64], parents: &[u32]) -> Vec<f64> {
        let mut values = own.to_vec();
        Blocks::default().share(&mut values, parents);
        values
    }

    #[test]
    fn falling_values_are_kept() {
        assert_eq!(values(&[4.0, 3.0, 1.0], &[NONE, 0, 1]), [4.0, 3.0, 1.0]);
    }

    #[test]
    fn a_page_shares_what_lies_beneath() {
        assert_eq!(values(&[0.0, 6.0, 6.0], &[NONE, 0, 1]), [4.0, 4.0, 4.0]);
        assert_eq!(
            values(&[9.0, 0.0, 6.0, 1.0], &[NONE, 0, 1, 1]),
            [9.0, 3.0, 3.0, 1.0]
        );
        assert_eq!(values(&[9.0, 0.0, 0.0], &[NONE, 0, 1]), [9.0, 0.0, 0.0]);
    }

    proptest::proptest! {
        /// The definition, by trying all connected sets with the root at the top.
        #[test]
        fn the_root_has_the_largest_mean_of_all_sets(
            own in proptest::collection::vec(0u32..10, 1..11),
            links in proptest::collection::vec(0usize..1000, 11),
        ) {
            let pages = own.len();
            let own: Vec<f64> = own.into_iter().map(f64::from).collect();
            let parents: Vec<u32> =
                (0..pages).map(|page| if page == 0 { NONE } else { (links[page] % page) as u32 }).collect();
            let mut best = 0.0f64;
            for set in (1u32..1 << pages).step_by(2) {
                let members: Vec<usize> = (0..pages).filter(|page| set >> page & 1 == 1).collect();
                if members[1..].iter().all(|&page| set >> parents[page] & 1 == 1) {
                    best = best.max(members.iter().map(|&page| own[page]).sum::<f64>() / members.len() as f64);
                }
            }
            let found = values(&own, &parents);
            let sum = |values: &[f64]| values.iter().sum::<f64>();
            proptest::prop_assert!((sum(&found) - sum(&own)).abs() < 1e-9, "values share, they add nothing");
            for page in 1..pages {
                proptest::prop_assert!(found[page] <= found[parents[page] as usize]);
            }
            proptest::prop_assert!((found[0] - best).abs() < 1e-9);
        }
    }
}
