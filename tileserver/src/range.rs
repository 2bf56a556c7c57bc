//! The `Range` field (RFC 9110, section 14).

use std::ops::Range;

/// Most ranges of one request; a client that needs more asks again.
pub(crate) const MAX_RANGES: usize = 64;

/// What a `Range` field asks for.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// All: no field, a unit that is not bytes, which the standard says to ignore, or ranges that are together
    /// longer than all.
    Whole,
    /// One or several ranges that lie inside and are not empty, in the order asked.
    Parts(Vec<Range<u64>>),
    /// Nothing that could be sent, and why.
    Refused(&'static str),
}

/// What `field` asks of something that is `length` bytes long.
///
/// Of several ranges those that lie outside are left out, as the standard has it.
pub(crate) fn wanted(field: &str, length: u64) -> Wanted {
    let Some((unit, ranges)) = field.split_once('=') else {
        return Wanted::Refused("no byte range");
    };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return Wanted::Whole;
    }
    let mut parts = Vec::new();
    for (at, range) in ranges.split(',').enumerate() {
        if at == MAX_RANGES {
            return Wanted::Refused("more than 64 ranges: ask for fewer at a time");
        }
        match one(range, length) {
            None => return Wanted::Refused("no byte range"),
            Some(range) if range.is_empty() => {}
            Some(range) => parts.push(range),
        }
    }
    let total = parts
        .iter()
        .fold(0u64, |sum, part| sum.saturating_add(part.end - part.start));
    match parts.len() {
        0 => Wanted::Refused("a range with nothing in it"),
        1 => Wanted::Parts(parts),
        // Ranges that overlap must not make more of an archive than there is (RFC 9110, section 14.2).
        _ if total > length => Wanted::Whole,
        _ => Wanted::Parts(parts),
    }
}

/// One range, empty if it lies outside; `None` if it is none.
fn one(range: &str, length: u64) -> Option<Range<u64>> {
    let (first, last) = range.trim().split_once('-')?;
    match (first.trim(), last.trim()) {
        ("", suffix) => position(suffix).map(|suffix| length.saturating_sub(suffix)..length),
        (first, "") => position(first).map(|first| first..length),
        (first, last) => match (position(first), position(last)) {
            (Some(first), Some(last)) if first <= last => Some(first..length.min(last.saturating_add(1))),
            _ => None,
        },
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
            ("bytes=0-1,", None),
        ] {
            match (wanted(field, 100), expected) {
                (Wanted::Parts(parts), Some(expected)) => assert_eq!(parts, [expected], "{field}"),
                (Wanted::Refused(_), None) => {}
                (other, _) => panic!("{field}: {other:?}"),
            }
        }
        assert_eq!(wanted("pages=0-1", 100), Wanted::Whole);
    }

    #[test]
    fn several() {
        let parts = |field| match wanted(field, 100) {
            Wanted::Parts(parts) => parts,
            other => panic!("{field}: {other:?}"),
        };
        assert_eq!(parts("bytes=5-6, 0-1"), [5..7, 0..2]);
        assert_eq!(parts("bytes=0-1,200-,-1"), [0..2, 99..100]);
        assert_eq!(wanted("bytes=0-,0-", 100), Wanted::Whole);
        assert!(matches!(wanted("bytes=0-1,x", 100), Wanted::Refused(_)));
        assert!(matches!(wanted("bytes=200-,300-", 100), Wanted::Refused(_)));
        let many = |count: usize| format!("bytes={}0-0", "1-1,".repeat(count - 1));
        assert!(matches!(wanted(&many(64), 100), Wanted::Parts(parts) if parts.len() == 64));
        assert!(matches!(wanted(&many(65), 100), Wanted::Refused(_)));
    }

    proptest! {
        #[test]
        fn parts_lie_inside_and_are_not_empty(field in "(bytes=)?[0-9,-]{0,24}", length: u64) {
            if let Wanted::Parts(parts) = wanted(&field, length) {
                prop_assert!(!parts.is_empty() && parts.iter().all(|part| part.start < part.end && part.end <= length));
                let total: u128 = parts.iter().map(|part| u128::from(part.end - part.start)).sum();
                prop_assert!(total <= u128::from(length));
            }
        }

        #[test]
        fn what_is_asked_for_is_what_there_is(first in 0..1000u64, extra in 0..1000u64, length in 1..2000u64) {
            let last = first + extra;
            let expected: Vec<u64> = (0..length).filter(|at| (first..=last).contains(at)).collect();
            match wanted(&format!("bytes={first}-{last}"), length) {
                Wanted::Parts(mut parts) => prop_assert_eq!(parts.remove(0).collect::<Vec<_>>(), expected),
                _ => prop_assert!(expected.is_empty()),
            }
        }
    }
}
