//! The `Range` field (RFC 9110, section 14).

use std::ops::Range;

/// What a `Range` field asks for.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// All: no field, or a unit that is not bytes, which the standard says to ignore.
    Whole,
    /// One range that lies inside.
    Part(Range<u64>),
    /// Nothing that could be sent, and why.
    Refused(&'static str),
}

/// What `field` asks of something that is `length` bytes long.
///
/// Several ranges are refused: the records of an archive have addresses of their own, and one range a request
/// keeps the work of a request bounded.
pub(crate) fn wanted(field: &str, length: u64) -> Wanted {
    let Some((unit, ranges)) = field.split_once('=') else {
        return Wanted::Refused("no byte range");
    };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return Wanted::Whole;
    }
    if ranges.contains(',') {
        return Wanted::Refused("several ranges: ask for one at a time");
    }
    let Some((first, last)) = ranges.trim().split_once('-') else {
        return Wanted::Refused("no byte range");
    };
    let range = match (first.trim(), last.trim()) {
        ("", suffix) => position(suffix).map(|suffix| length.saturating_sub(suffix)..length),
        (first, "") => position(first).map(|first| first..length),
        (first, last) => match (position(first), position(last)) {
            (Some(first), Some(last)) if first <= last => Some(first..length.min(last.saturating_add(1))),
            _ => None,
        },
    };
    match range {
        None => Wanted::Refused("no byte range"),
        Some(range) if range.is_empty() => Wanted::Refused("a range with nothing in it"),
        Some(range) => Wanted::Part(range),
    }
}

/// Digits only: no sign. What is too large for the type is beyond the end of everything.
fn position(digits: &str) -> Option<u64> {
    let valid = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    valid.then(|| digits.parse().unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn fields() {
        for (field, expected) in [
            ("bytes=0-9", Some(0..10)),
            ("bytes=5-5", Some(5..6)),
            ("Bytes = 0-", Some(0..100)),
            ("bytes=90-200", Some(90..100)),
            ("bytes=90-99999999999999999999999", Some(90..100)),
            ("bytes=-10", Some(90..100)),
            ("bytes=-1000", Some(0..100)),
            ("bytes=100-", None),
            ("bytes=99999999999999999999999-", None),
            ("bytes=-0", None),
            ("bytes=9-5", None),
            ("bytes=+1-5", None),
            ("bytes=a-b", None),
            ("bytes=-", None),
            ("bytes=", None),
            ("bytes", None),
            ("bytes=0-1,5-6", None),
        ] {
            match (wanted(field, 100), expected) {
                (Wanted::Part(part), Some(expected)) => assert_eq!(part, expected, "{field}"),
                (Wanted::Refused(_), None) => {}
                (other, _) => panic!("{field}: {other:?}"),
            }
        }
        assert_eq!(wanted("pages=0-1", 100), Wanted::Whole);
    }

    proptest! {
        #[test]
        fn parts_lie_inside_and_are_not_empty(field in "(bytes=)?[0-9,-]{0,24}", length: u64) {
            if let Wanted::Part(part) = wanted(&field, length) {
                prop_assert!(part.start < part.end && part.end <= length);
            }
        }

        #[test]
        fn what_is_asked_for_is_what_there_is(first in 0..1000u64, extra in 0..1000u64, length in 1..2000u64) {
            let last = first + extra;
            let expected: Vec<u64> = (0..length).filter(|at| (first..=last).contains(at)).collect();
            match wanted(&format!("bytes={first}-{last}"), length) {
                Wanted::Part(part) => prop_assert_eq!(part.collect::<Vec<_>>(), expected),
                _ => prop_assert!(expected.is_empty()),
            }
        }
    }
}
