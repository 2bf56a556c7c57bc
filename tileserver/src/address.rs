//! What a request's path stands for. Nothing is allocated, and no path of the system is made of it.

use std::borrow::Cow;

use crate::metrics::Route;

/// More segments than any address has.
const MAX_SEGMENTS: usize = 10;

/// What is asked for. Segments are as the client has sent them, with escapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Address<'a> {
    Health,
    Ready,
    Metrics,
    /// In the collection at a place.
    In(&'a str, Content<'a>),
    Elsewhere,
}

/// What is asked for of a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content<'a> {
    Catalogue,
    /// `NAME` is the manifest, `NAME.bsvtf` the archive.
    ManifestOrArchive(&'a str),
    /// Of the archive with this name, whatever its content is now.
    Index(&'a str),
    /// A file beside the archives, with the hash of its content or without.
    Beside(Option<&'a str>, &'a str),
    /// Something of the archive with this name and content.
    Of(&'a str, &'a str, Record<'a>),
}

/// What is asked for of an archive; numbers as they stand in the address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Record<'a> {
    Index,
    /// Group, mip, x, y.
    Page([&'a str; 4]),
    Column(&'a str),
    Batch(&'a str),
}

impl<'a> Address<'a> {
    pub(crate) fn of(path: &'a str) -> Self {
        let Some(rest) = path.strip_prefix('/') else {
            return Self::Elsewhere;
        };
        let (mut segments, mut count) = ([""; MAX_SEGMENTS], 0);
        for segment in rest.split('/') {
            let Some(place) = segments.get_mut(count) else {
                return Self::Elsewhere;
            };
            (*place, count) = (segment, count + 1);
        }
        match &segments[..count] {
            ["health"] => Self::Health,
            ["ready"] => Self::Ready,
            ["metrics"] => Self::Metrics,
            ["v1", rest @ ..] => Content::of(rest).map_or(Self::Elsewhere, |content| Self::In("", content)),
            [place, "v1", rest @ ..] if !place.is_empty() => {
                Content::of(rest).map_or(Self::Elsewhere, |content| Self::In(place, content))
            }
            _ => Self::Elsewhere,
        }
    }

    /// As what it is counted.
    pub(crate) fn route(&self) -> Route {
        match self {
            Self::Health | Self::Ready | Self::Metrics => Route::Status,
            Self::In(_, Content::Catalogue) => Route::Catalogue,
            Self::In(_, Content::ManifestOrArchive(file)) if file.ends_with(".bsvtf") => Route::Archive,
            Self::In(_, Content::ManifestOrArchive(_)) => Route::Manifest,
            Self::In(_, Content::Beside(..)) => Route::File,
            Self::In(_, Content::Index(_) | Content::Of(_, _, Record::Index)) => Route::Index,
            Self::In(_, Content::Of(_, _, Record::Page(_))) => Route::Page,
            Self::In(_, Content::Of(_, _, Record::Column(_))) => Route::Column,
            Self::In(_, Content::Of(_, _, Record::Batch(_))) => Route::Batch,
            Self::Elsewhere => Route::Other,
        }
    }
}

impl<'a> Content<'a> {
    /// By the segments behind `v1`. No file beside archives is named `index`, so `files` may be an archive's name, too.
    fn of(segments: &[&'a str]) -> Option<Self> {
        if let [] | [""] = segments {
            return Some(Self::Catalogue);
        }
        if segments.iter().any(|segment| segment.is_empty()) {
            return None;
        }
        Some(match *segments {
            [file] => Self::ManifestOrArchive(file),
            [name, "index"] => Self::Index(name),
            [name, id, "index"] => Self::Of(name, id, Record::Index),
            ["files", file] => Self::Beside(None, file),
            ["files", hash, file] => Self::Beside(Some(hash), file),
            [name, id, "page", group, mip, x, y] => Self::Of(name, id, Record::Page([group, mip, x, y])),
            [name, id, "column", group] => Self::Of(name, id, Record::Column(group)),
            [name, id, "batch", records] => Self::Of(name, id, Record::Batch(records)),
            _ => return None,
        })
    }
}

/// A path or a segment of one without escapes; `None` if it is no UTF-8.
pub(crate) fn unescaped(text: &str) -> Option<Cow<'_, str>> {
    if !text.contains('%') {
        return Some(text.into());
    }
    let (mut bytes, mut rest) = (Vec::with_capacity(text.len()), text.as_bytes());
    while let [first, tail @ ..] = rest {
        let digits = tail.get(..2).filter(|_| *first == b'%');
        let digit = |byte: u8| char::from(byte).to_digit(16);
        let byte = digits.and_then(|digits| Some(digit(digits[0])? << 4 | digit(digits[1])?));
        bytes.push(byte.map_or(*first, |byte| byte as u8));
        rest = if byte.is_some() { &tail[2..] } else { tail };
    }
    String::from_utf8(bytes).ok().map(Cow::Owned)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn addresses() {
        let of = |record| Address::In("", Content::Of("a", "b", record));
        for (path, address, route) in [
            ("/health", Address::Health, Route::Status),
            ("/v1", Address::In("", Content::Catalogue), Route::Catalogue),
            ("/v1/", Address::In("", Content::Catalogue), Route::Catalogue),
            (
                "/museum/v1",
                Address::In("museum", Content::Catalogue),
                Route::Catalogue,
            ),
            (
                "/v1/cloth",
                Address::In("", Content::ManifestOrArchive("cloth")),
                Route::Manifest,
            ),
            (
                "/v1/c%20.bsvtf",
                Address::In("", Content::ManifestOrArchive("c%20.bsvtf")),
                Route::Archive,
            ),
            ("/v1/a/index", Address::In("", Content::Index("a")), Route::Index),
            ("/v1/a/b/index", of(Record::Index), Route::Index),
            (
                "/v1/a/b/page/0/1/2/3",
                of(Record::Page(["0", "1", "2", "3"])),
                Route::Page,
            ),
            ("/v1/a/b/column/7", of(Record::Column("7")), Route::Column),
            ("/v1/a/b/batch/c0,c1", of(Record::Batch("c0,c1")), Route::Batch),
            (
                "/v1/files/a.png",
                Address::In("", Content::Beside(None, "a.png")),
                Route::File,
            ),
            (
                "/v1/files/b/a.png",
                Address::In("", Content::Beside(Some("b"), "a.png")),
                Route::File,
            ),
            (
                "/v1/files",
                Address::In("", Content::ManifestOrArchive("files")),
                Route::Manifest,
            ),
            ("/v1/v1/v1", Address::Elsewhere, Route::Other),
            ("/", Address::Elsewhere, Route::Other),
            ("", Address::Elsewhere, Route::Other),
            ("*", Address::Elsewhere, Route::Other),
            ("//v1/", Address::Elsewhere, Route::Other),
            ("/v1//", Address::Elsewhere, Route::Other),
            ("/v1/cloth/", Address::Elsewhere, Route::Other),
            ("/v1/a//index", Address::Elsewhere, Route::Other),
            ("/v1/a/b/page/0/1/2", Address::Elsewhere, Route::Other),
            ("/v1/a/b/page/0/1/2/3/4", Address::Elsewhere, Route::Other),
            ("/x/v1/a/b/page/0/1/2/3/4/5/6/7", Address::Elsewhere, Route::Other),
        ] {
            assert_eq!(
                (Address::of(path), Address::of(path).route()),
                (address, route),
                "{path}"
            );
        }
    }

    #[test]
    fn escapes() {
        for (escaped, plain) in [
            ("cloth", Some("cloth")),
            ("wool%202", Some("wool 2")),
            ("gr%C3%B6%c3%9fe", Some("größe")),
            ("100%", Some("100%")),
            ("%4", Some("%4")),
            ("%zz%2f", Some("%zz/")),
            ("%+1", Some("%+1")),
            ("%ff", None),
        ] {
            assert_eq!(unescaped(escaped).as_deref(), plain, "{escaped}");
        }
    }

    proptest! {
        #[test]
        fn what_is_escaped_comes_back(text: String) {
            let escaped: String = text.bytes().map(|byte| format!("%{byte:02x}")).collect();
            prop_assert_eq!(unescaped(&escaped).unwrap(), text);
        }
    }
}
