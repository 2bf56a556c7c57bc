//! Which version of a file an answer is about, and which bytes of it (RFC 9110, sections 8.8, 13.1.5, 14.4).

use std::ops::Range;

use super::{super::transport::Head, trouble::Trouble};

/// What tells one version of a file from another, as far as the host says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Version {
    etag: Option<String>,
    modified: Option<String>,
    /// Bytes of the file.
    pub(super) total: Option<u64>,
}

impl Version {
    /// The version that a 206 is a part of, or a 200 the whole.
    pub(super) fn of(head: &Head) -> Self {
        let text = |name| head.field(name).map(str::to_owned);
        let total = match head.status {
            206 => ContentRange::of(head).ok().and_then(|range| range.total),
            _ => head
                .field("content-length")
                .and_then(|length| length.parse().ok()),
        };
        Self {
            etag: text("etag"),
            modified: text("last-modified"),
            total,
        }
    }

    /// What `If-Range` takes: a strong ETag, else a date. Weak ETags are not allowed there.
    pub(super) fn validator(&self) -> Option<String> {
        let strong = self.etag.as_ref().filter(|etag| etag.starts_with('"'));
        match (&self.etag, strong) {
            (_, Some(strong)) => Some(strong.clone()),
            (Some(_weak), None) => None,
            (None, None) => self.modified.clone(),
        }
    }

    /// Whether an answer may be of the same version; what only one of both says is no difference.
    pub(super) fn check(&self, now: &Self) -> Result<(), Trouble> {
        fn differ<T: PartialEq>(a: &Option<T>, b: &Option<T>) -> bool {
            matches!((a, b), (Some(a), Some(b)) if a != b)
        }
        let change = |what: &str, before: &dyn std::fmt::Debug, after: &dyn std::fmt::Debug| {
            Err(Trouble::Changed(format!("{what} {before:?}, now {after:?}")))
        };
        if differ(&self.etag, &now.etag) {
            return change("ETag", &self.etag, &now.etag);
        }
        if differ(&self.modified, &now.modified) {
            return change("last modified", &self.modified, &now.modified);
        }
        if differ(&self.total, &now.total) {
            return change("bytes", &self.total, &now.total);
        }
        Ok(())
    }
}

/// `Content-Range: bytes FIRST-LAST/TOTAL`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ContentRange {
    pub(super) range: Range<u64>,
    pub(super) total: Option<u64>,
}

impl ContentRange {
    /// The range of a 206.
    pub(super) fn of(head: &Head) -> Result<Self, Trouble> {
        let Some(text) = head.field("content-range") else {
            let kind = head.field("content-type").unwrap_or("none");
            return Err(Trouble::Lasting(format!(
                "the host answers 206 without Content-Range (Content-Type {kind}): it is no host for ranges"
            )));
        };
        Self::parse(text).ok_or_else(|| {
            Trouble::Lasting(format!(
                "Content-Range {text:?} is none: \"bytes FIRST-LAST/TOTAL\" is expected"
            ))
        })
    }

    fn parse(text: &str) -> Option<Self> {
        let number = |text: &str| -> Option<u64> {
            let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
            digits.then(|| text.parse().ok())?
        };
        let (unit, rest) = text.split_once(' ')?;
        let (range, total) = rest.trim().split_once('/')?;
        let (first, last) = range.split_once('-')?;
        let range = number(first)?..number(last)?.checked_add(1)?;
        let total = match total {
            "*" => None,
            total => Some(number(total)?),
        };
        let sound = range.start < range.end && total.is_none_or(|total| range.end <= total);
        (unit.eq_ignore_ascii_case("bytes") && sound).then_some(Self { range, total })
    }

    /// Whether this is what was asked for, or the part of it that the file has.
    pub(super) fn check(&self, asked: &Range<u64>) -> Result<(), Trouble> {
        let Range { start, end } = self.range;
        let to_the_end = self.total == Some(end) && end < asked.end;
        if start != asked.start || (end != asked.end && !to_the_end) {
            return Err(Trouble::Lasting(format!(
                "the host answers with bytes {start}-{} where {}-{} were asked for",
                end - 1,
                asked.start,
                asked.end - 1
            )));
        }
        Ok(())
    }
}

/// A transformed body has other bytes: records could not be found in it.
pub(super) fn check_encoding(head: &Head) -> Result<(), Trouble> {
    match head.field("content-encoding") {
        None | Some("" | "identity") => Ok(()),
        Some(encoding) => Err(Trouble::Lasting(format!(
            "the host sends it with Content-Encoding {encoding}: switch compression off for .bsvtf files, which are \
             compressed"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn head(status: u16, fields: &[(&str, &str)]) -> Head {
        let fields = fields
            .iter()
            .map(|(name, value)| ((*name).into(), (*value).into()))
            .collect();
        Head {
            status,
            fields,
            wire_bytes: 0,
        }
    }

    #[test]
    fn content_ranges() {
        let parsed = ContentRange::parse("bytes 5-9/100").unwrap();
        assert_eq!((parsed.range.clone(), parsed.total), (5..10, Some(100)));
        assert_eq!(ContentRange::parse("bytes 0-0/*").unwrap().total, None);
        for bad in [
            "",
            "bytes",
            "bytes */100",
            "bytes 5-4/100",
            "bytes 0-100/100",
            "bytes 0-9/",
            "items 0-9/10",
            "bytes 0-18446744073709551615/*",
            "bytes +0-9/10",
            "bytes 0-99999999999999999999/*",
        ] {
            assert_eq!(ContentRange::parse(bad), None, "{bad}");
        }
        assert!(parsed.check(&(5..10)).is_ok());
        assert!(parsed.check(&(5..11)).is_err(), "shorter, though there is more");
        assert!(parsed.check(&(4..10)).is_err());
        assert!(parsed.check(&(5..9)).is_err());
        let last = ContentRange::parse("bytes 90-99/100").unwrap();
        assert!(last.check(&(90..200)).is_ok(), "the file ends there");
        assert!(ContentRange::of(&head(206, &[])).is_err());
    }

    proptest! {
        #[test]
        fn any_content_range_is_refused_or_sound(text in "(bytes )?[0-9]{0,21}[-*]?[0-9]{0,21}/?[0-9*]{0,21}|.{0,40}") {
            if let Some(ContentRange { range, total }) = ContentRange::parse(&text) {
                prop_assert!(range.start < range.end && total.is_none_or(|total| range.end <= total));
                let total = total.map_or("*".to_owned(), |total| total.to_string());
                let written = format!("bytes {}-{}/{total}", range.start, range.end - 1);
                prop_assert_eq!(ContentRange::parse(&written), ContentRange::parse(&text));
            }
        }
    }

    #[test]
    fn versions() {
        let strong = Version::of(&head(200, &[("etag", "\"a\""), ("content-length", "7")]));
        assert_eq!(strong.validator().unwrap(), "\"a\"");
        assert_eq!(strong.total, Some(7));
        let date = Version::of(&head(200, &[("last-modified", "Sun, 22 Nov 2026 00:00:00 GMT")]));
        assert!(date.validator().unwrap().starts_with("Sun"));
        let weak = Version::of(&head(
            206,
            &[("etag", "W/\"a\""), ("content-range", "bytes 0-1/8")],
        ));
        assert_eq!((weak.validator(), weak.total), (None, Some(8)));
        assert!(strong.check(&strong).is_ok());
        assert!(strong.check(&date).is_ok(), "nothing that both say differs");
        assert!(matches!(strong.check(&weak), Err(Trouble::Changed(_))));
        let longer = Version::of(&head(200, &[("content-length", "8")]));
        assert!(matches!(strong.check(&longer), Err(Trouble::Changed(_))));
    }
}
