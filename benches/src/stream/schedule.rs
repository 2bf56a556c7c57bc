//! The exact best order of records that depend on each other: most gain a byte, with any number of bytes that ends between two blocks.
//!
//! Source: Horn: Single-Machine Job Sequencing with Treelike Precedence Ordering and Linear Delay Penalties, 1972.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Records that are best sent one right after the other, the first of them before all that depends on it.
struct Block {
    gain: f64,
    bytes: f64,
    records: Vec<usize>,
}

impl Block {
    fn rate(&self) -> f64 {
        self.gain / self.bytes
    }
}

impl Ord for Block {
    fn cmp(&self, other: &Self) -> Ordering {
        self.rate().total_cmp(&other.rate())
    }
}

impl PartialOrd for Block {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Block {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Block {}

/// Gain a byte of the block that each record belongs to: who sends records by falling rate, and none before its parent, sends them in
/// the best order. Parents come before their children; bytes are above zero.
pub(super) fn rates(gains: &[f64], bytes: &[f64], parents: &[Option<usize>]) -> Vec<f64> {
    let mut below: Vec<BinaryHeap<Block>> = gains.iter().map(|_| BinaryHeap::new()).collect();
    let mut rates = vec![0.0; gains.len()];
    for record in (0..gains.len()).rev() {
        let mut rest = std::mem::take(&mut below[record]);
        let mut block = Block {
            gain: gains[record],
            bytes: bytes[record],
            records: vec![record],
        };
        while rest.peek().is_some_and(|best| best.rate() > block.rate()) {
            let best = rest.pop().unwrap_or_else(|| unreachable!("it was there"));
            block.gain += best.gain;
            block.bytes += best.bytes;
            block.records.extend(best.records);
        }
        rest.push(block);
        match parents[record] {
            Some(parent) => below[parent].append(&mut rest),
            None => {
                for block in rest {
                    for &record in &block.records {
                        rates[record] = block.rate();
                    }
                }
            }
        }
    }
    rates
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_beneath_counts_for_its_parents() {
        // 0 ─ 1 ─ 2, and 3 below 0.
        let parents = [None, Some(0), Some(1), Some(0)];
        let found = rates(&[1.0, 0.0, 8.0, 3.0], &[1.0, 1.0, 3.0, 2.0], &parents);
        // 1 and 2 are a block of 8 for 4, which 0 takes in: 9 for 5. 3 has 3 for 2.
        assert_eq!(found, [9.0 / 5.0, 9.0 / 5.0, 9.0 / 5.0, 1.5]);
    }

    #[test]
    fn falling_rates_are_kept() {
        let found = rates(&[8.0, 2.0, 1.0], &[2.0, 1.0, 1.0], &[None, Some(0), Some(1)]);
        assert_eq!(found, [4.0, 2.0, 1.0]);
    }
}
