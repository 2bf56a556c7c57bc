//! The order in which items deserve their places.

use std::cmp::{Ordering, Reverse};

use super::SWAP_MARGIN;

/// What an item is worth, and everything that breaks ties, so that the order is total and the same
/// everywhere.
///
/// A parent always ranks above its children: its values are not smaller, it was wanted whenever they were, and
/// its tile's index is smaller. So the lowest rank of a cache is a leaf, and no search for leaves is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rank {
    /// Root or column of a visible material's first group, while there are slots enough.
    pub pinned: bool,
    /// Squared error over all pixels; not negative, finite.
    pub value: f64,
    /// The same by the votes ahead, where `value` is zero; zero elsewhere.
    pub ahead: f64,
    /// Update at which the tile has lost its votes; [`u64::MAX`] while it has some.
    pub last_wanted: u64,
    /// Index of the tile; 0 for columns.
    pub tile: Reverse<u32>,
    /// Component group.
    pub group: Reverse<u16>,
    /// Material.
    pub material: Reverse<u16>,
}

impl Rank {
    /// Whether the votes of the present want it.
    pub(super) fn is_present(&self) -> bool {
        self.value > 0.0
    }

    /// Whether any votes want it.
    pub(super) fn is_wanted(&self) -> bool {
        self.value > 0.0 || self.ahead > 0.0
    }

    /// Whether it is worth more, strictly.
    pub(super) fn exceeds(&self, other: &Rank) -> bool {
        (self.pinned, self.value, self.ahead) > (other.pinned, other.value, other.ahead)
    }

    /// Whether it is worth so much more that asking for it pays.
    pub(super) fn exceeds_by_margin(&self, other: &Rank) -> bool {
        match self.pinned.cmp(&other.pinned) {
            Ordering::Equal if self.is_present() || other.is_present() => {
                self.value > other.value * (1.0 + SWAP_MARGIN)
            }
            Ordering::Equal => self.ahead > other.ahead * (1.0 + SWAP_MARGIN),
            order => order.is_gt(),
        }
    }
}

impl Eq for Rank {}

impl Ord for Rank {
    fn cmp(&self, other: &Self) -> Ordering {
        self.pinned
            .cmp(&other.pinned)
            .then_with(|| self.value.total_cmp(&other.value))
            .then_with(|| self.ahead.total_cmp(&other.ahead))
            .then_with(|| self.last_wanted.cmp(&other.last_wanted))
            .then_with(|| self.tile.cmp(&other.tile))
            .then_with(|| self.group.cmp(&other.group))
            .then_with(|| self.material.cmp(&other.material))
    }
}

impl PartialOrd for Rank {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The `count` highest of all that is pushed, found in linear time.
pub(super) struct Highest<T> {
    count: usize,
    kept: Vec<T>,
    /// Nothing at or below this can be among them any more.
    floor: Option<T>,
}

impl<T: Ord + Copy> Highest<T> {
    pub(super) fn new(count: usize) -> Self {
        Self {
            count,
            kept: Vec::new(),
            floor: None,
        }
    }

    pub(super) fn push(&mut self, item: T) {
        if self.count == 0 || self.floor.is_some_and(|floor| item <= floor) {
            return;
        }
        self.kept.push(item);
        if self.kept.len() >= self.count.saturating_mul(2).max(64) {
            self.cut();
        }
    }

    fn cut(&mut self) {
        if self.kept.len() > self.count {
            let (_, lowest, _) = self.kept.select_nth_unstable_by(self.count - 1, |a, b| b.cmp(a));
            self.floor = Some(*lowest);
            self.kept.truncate(self.count);
        }
    }

    /// They, in no particular order.
    pub(super) fn into_vec(mut self) -> Vec<T> {
        if self.count > 0 {
            self.cut();
        }
        self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highest_are_what_sorting_finds() {
        for (count, len) in [(0, 10), (1, 1000), (7, 5), (64, 1000), (100, 5000)] {
            let numbers: Vec<u64> = (0..len).map(|i| i * 7919 % 10007).collect();
            let mut highest = Highest::new(count);
            numbers.iter().for_each(|&number| highest.push(number));
            let mut found = highest.into_vec();
            found.sort_unstable_by(|a, b| b.cmp(a));
            let mut sorted = numbers;
            sorted.sort_unstable_by(|a, b| b.cmp(a));
            sorted.truncate(count);
            assert_eq!(found, sorted);
        }
    }

    #[test]
    fn votes_ahead_count_only_where_the_present_has_none() {
        let rank = |value, ahead| Rank {
            pinned: false,
            value,
            ahead,
            last_wanted: 0,
            tile: Reverse(0),
            group: Reverse(0),
            material: Reverse(0),
        };
        assert!(rank(1.0, 0.0) > rank(0.0, 9.0) && rank(1.0, 0.0).exceeds_by_margin(&rank(0.0, 9.0)));
        assert!(!rank(0.0, 9.0).exceeds(&rank(1.0, 0.0)));
        assert!(rank(0.0, 1.0).exceeds_by_margin(&rank(0.0, 0.0)));
        assert!(rank(0.0, 1.001).exceeds(&rank(0.0, 1.0)));
        assert!(!rank(0.0, 1.001).exceeds_by_margin(&rank(0.0, 1.0)));
    }

    #[test]
    fn pins_come_before_values() {
        let rank = |pinned, value| Rank {
            pinned,
            value,
            ahead: 0.0,
            last_wanted: 0,
            tile: Reverse(0),
            group: Reverse(0),
            material: Reverse(0),
        };
        assert!(rank(true, 1.0).exceeds_by_margin(&rank(false, 2.0)));
        assert!(!rank(false, 2.0).exceeds(&rank(true, 1.0)));
        assert!(rank(false, 1.001).exceeds(&rank(false, 1.0)));
        assert!(!rank(false, 1.001).exceeds_by_margin(&rank(false, 1.0)));
        assert!(!rank(false, 0.0).exceeds_by_margin(&rank(false, 0.0)));
    }
}
