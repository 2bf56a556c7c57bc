//! A target error instead of budgets: caches grow until what is predicted is small enough.

use engine::frame::{Budgets, FrameStats};

/// Caches begin with so many bytes of pages, and half of that of columns, when a target is set.
const FIRST_BYTES: u64 = 8 << 20;
/// Caches grow by a half at a time: each step copies what is resident.
const GROWTH: (u64, u64) = (3, 2);
/// Of the target, what components that are left out may take.
const LEFT_OUT: f64 = 0.25;

/// An error that may be seen, and the most memory that may be taken for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Root mean square reflectance against full residency; that of a white surface is 1.
    pub target_rms: f64,
    /// Most bytes of both caches together.
    pub most_bytes: u64,
}

impl Quality {
    /// The budgets to begin with; all but the caches as they are.
    pub fn first(&self, budgets: Budgets) -> Budgets {
        let pages = FIRST_BYTES.min(self.most_bytes / 3 * 2).max(1);
        Budgets {
            page_cache_bytes: pages,
            column_cache_bytes: (pages / 2).max(1),
            ..budgets
        }
    }

    /// What component groups that are left out may cost: [`engine::frame::Options::component_error`].
    pub fn component_error(&self) -> f64 {
        self.target_rms.max(0.0) * LEFT_OUT
    }

    /// Larger budgets, if the picture has settled and is not good enough, and memory is left.
    pub fn next(&self, budgets: Budgets, stats: &FrameStats) -> Option<Budgets> {
        if !stats.settled || stats.predicted_rms <= self.target_rms {
            return None;
        }
        let sum = budgets
            .page_cache_bytes
            .saturating_add(budgets.column_cache_bytes);
        if sum >= self.most_bytes {
            return None;
        }
        let grown = (sum.saturating_mul(GROWTH.0) / GROWTH.1)
            .max(sum + 3)
            .min(self.most_bytes);
        Some(Budgets {
            page_cache_bytes: grown - grown / 3,
            column_cache_bytes: grown / 3,
            ..budgets
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn caches_grow_until_it_is_good_enough_and_never_beyond_the_limit() {
        let quality = Quality {
            target_rms: 0.01,
            most_bytes: 100 << 20,
        };
        let mut budgets = quality.first(Budgets::default());
        let mut stats = FrameStats {
            settled: true,
            predicted_rms: 0.2,
            ..FrameStats::default()
        };
        let mut steps = 0;
        while let Some(next) = quality.next(budgets, &stats) {
            let bytes = |budgets: Budgets| budgets.page_cache_bytes + budgets.column_cache_bytes;
            assert!(bytes(next) > bytes(budgets) && bytes(next) <= quality.most_bytes);
            (budgets, steps) = (next, steps + 1);
            stats.predicted_rms *= 0.5;
        }
        assert!((3..10).contains(&steps), "{steps}");
        assert!(stats.predicted_rms <= 0.01);
        stats.predicted_rms = 1.0;
        stats.settled = false;
        assert_eq!(quality.next(budgets, &stats), None);
        stats.settled = true;
        while let Some(next) = quality.next(budgets, &stats) {
            budgets = next;
        }
        assert_eq!(
            budgets.page_cache_bytes + budgets.column_cache_bytes,
            quality.most_bytes
        );
    }
}
