//! Which records are asked for together.

use std::{ops::Range, sync::Arc};

use super::super::Ticket;

/// A record that is wanted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Wanted {
    pub(super) ticket: Ticket,
    pub(super) archive: Arc<str>,
    pub(super) range: Range<u64>,
}

/// Bytes between two records that are rather received and dropped than saved by another request. A request and the head
/// of its answer are some 700 bytes, and one of the few connections is taken for a round trip; within 4 KiB there
/// are one or two records, which are likely to be wanted next.
const GAP_BYTES: u64 = 4 << 10;
/// Longest range, unless a single record is longer. What was asked for first must not wait for long behind what
/// was added to it: 256 KiB are a tenth of a second at 20 Mbit/s.
const RANGE_BYTES: u64 = 256 << 10;

/// Takes the records for one range out of `wanted`, which is in the order of importance: the first, and its neighbours
/// in the file. Returns the range and the records, by their places.
pub(super) fn take(wanted: &mut Vec<Wanted>) -> Option<(Range<u64>, Vec<Wanted>)> {
    let first = wanted.first()?;
    let archive = Arc::clone(&first.archive);
    let mut range = first.range.clone();
    let mut neighbours: Vec<Range<u64>> = wanted
        .iter()
        .filter(|other| other.archive == archive)
        .map(|other| other.range.clone())
        .collect();
    neighbours.sort_unstable_by_key(|other| (other.start, other.end));
    let joined = |range: &Range<u64>, other: &Range<u64>| {
        let joined = range.start.min(other.start)..range.end.max(other.end);
        let gap = other
            .start
            .saturating_sub(range.end)
            .max(range.start.saturating_sub(other.end));
        let inside = joined == *range;
        (inside || (gap <= GAP_BYTES && joined.end - joined.start <= RANGE_BYTES)).then_some(joined)
    };
    // Behind it, where what follows in the file lies, and then before it.
    let behind = neighbours.partition_point(|other| other.start < range.start);
    for other in &neighbours[behind..] {
        match joined(&range, other) {
            Some(joined) => range = joined,
            None => break,
        }
    }
    for other in neighbours[..behind].iter().rev() {
        match joined(&range, other) {
            Some(joined) => range = joined,
            None => break,
        }
    }
    let within = |other: &Wanted| {
        other.archive == archive && range.start <= other.range.start && other.range.end <= range.end
    };
    let mut taken: Vec<Wanted> = wanted.extract_if(.., |other| within(other)).collect();
    taken.sort_by_key(|other| (other.range.end, other.range.start));
    Some((range, taken))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wanted(ranges: &[Range<u64>]) -> Vec<Wanted> {
        let wanted = |(ticket, range): (u64, &Range<u64>)| Wanted {
            ticket: Ticket(ticket),
            archive: "a".into(),
            range: range.clone(),
        };
        (0..).zip(ranges).map(wanted).collect()
    }

    fn ranges(ranges: &[Range<u64>]) -> Vec<(u64, u64)> {
        let mut wanted = wanted(ranges);
        std::iter::from_fn(|| take(&mut wanted))
            .map(|(range, _)| (range.start, range.end))
            .collect()
    }

    #[test]
    fn neighbours_travel_together() {
        assert_eq!(ranges(&[100..200, 200..300, 0..100]), [(0, 300)]);
        assert_eq!(
            ranges(&[10_000..10_100, 0..100]),
            [(10_000, 10_100), (0, 100)],
            "too far"
        );
        assert_eq!(ranges(&[0..100, 4196..4200]), [(0, 4200)], "a small gap");
        assert_eq!(ranges(&[0..100, 4197..4200]).len(), 2);
        assert_eq!(ranges(&[5..9, 5..9, 5..9]), [(5, 9)], "the same thrice");
        let long = 0..RANGE_BYTES * 2;
        let next = long.end..long.end + 1;
        assert_eq!(ranges(&[long, next]).len(), 2);
    }

    #[test]
    fn archives_are_apart() {
        let mut both = wanted(&[0..10, 10..20]);
        both[1].archive = "b".into();
        assert_eq!(take(&mut both).unwrap().1.len(), 1);
        assert_eq!(both.len(), 1);
    }

    proptest! {
        #[test]
        fn everything_is_taken_once_and_lies_in_its_range(
            places in proptest::collection::vec((0..400_000u64, 1..20_000u64), 1..64)
        ) {
            let asked: Vec<_> = places.iter().map(|(start, length)| *start..start + length).collect();
            let mut left = wanted(&asked);
            let mut seen = Vec::new();
            while let Some(first) = left.first().cloned() {
                let (range, taken) = take(&mut left).unwrap();
                prop_assert!(taken.contains(&first));
                let longest = taken.iter().map(|one| one.range.end - one.range.start).max().unwrap();
                prop_assert!(range.end - range.start <= RANGE_BYTES.max(longest));
                let mut covered = range.start;
                let mut by_start = taken.clone();
                by_start.sort_by_key(|one| one.range.start);
                for one in &by_start {
                    prop_assert!(one.range.start <= covered + GAP_BYTES && one.range.end <= range.end);
                    covered = covered.max(one.range.end);
                }
                prop_assert_eq!(covered, range.end);
                seen.extend(taken.iter().map(|one| one.ticket));
            }
            seen.sort_unstable();
            prop_assert_eq!(seen, (0..asked.len() as u64).map(Ticket).collect::<Vec<_>>());
        }
    }
}
