//! Conditional requests: what a client has already is not sent again (RFC 9110, section 13).

use hyper::{HeaderMap, header};

/// Whether `If-None-Match` names `etag` (strong, in quotes), so that the answer is 304. Weak comparison; fields
/// may come several times, and hold lists or `*`.
pub(crate) fn none_match(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get_all(header::IF_NONE_MATCH)
        .iter()
        .any(|value| list_has(value.as_bytes(), etag.as_bytes(), true))
}

/// Whether `If-Match` lets the request through: there is none, or it names `etag` strongly, or `*`.
pub(crate) fn matches(headers: &HeaderMap, etag: &str) -> bool {
    let mut fields = headers.get_all(header::IF_MATCH).iter().peekable();
    fields.peek().is_none() || fields.any(|value| list_has(value.as_bytes(), etag.as_bytes(), false))
}

/// Walks a list of ETags; weak ones count if `weak`. Commas may stand inside the quotes of an ETag, so it cannot be split at them.
fn list_has(list: &[u8], etag: &[u8], weak: bool) -> bool {
    if list.trim_ascii() == b"*" {
        return true;
    }
    let mut rest = list;
    loop {
        while let [b' ' | b'\t' | b',', tail @ ..] = rest {
            rest = tail;
        }
        let strong = rest.strip_prefix(b"W/").is_none();
        rest = rest.strip_prefix(b"W/").unwrap_or(rest);
        let [b'"', inner @ ..] = rest else { return false };
        let Some(end) = inner.iter().position(|&byte| byte == b'"') else {
            return false;
        };
        if &rest[..end + 2] == etag && (strong || weak) {
            return true;
        }
        rest = &inner[end + 1..];
    }
}

/// Whether a `Range` applies to what there is now: no `If-Range`, or one that names `etag` strongly. Dates never
/// match, because none are sent.
pub(crate) fn range_applies(headers: &HeaderMap, etag: &str) -> bool {
    headers
        .get(header::IF_RANGE)
        .is_none_or(|value| value.as_bytes().trim_ascii() == etag.as_bytes())
}

#[cfg(test)]
mod tests {
    use hyper::header::HeaderValue;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn lists_of_etags() {
        for (list, expected) in [
            ("\"a\"", true),
            ("W/\"a\"", true),
            ("*", true),
            (" * ", true),
            ("\"b\", \"a\"", true),
            ("\"b\",W/\"a\" ,\"c\"", true),
            ("\"x,y\" , \"a\"", true),
            (", ,\"a\"", true),
            ("\"b\"", false),
            ("\"x, \"a\"", false), // The quotes pair differently.
            ("a", false),
            ("\"a", false),
            ("\"\"", false),
            ("\"b\" *", false),
            ("", false),
        ] {
            assert_eq!(list_has(list.as_bytes(), b"\"a\"", true), expected, "{list}");
        }
    }

    #[test]
    fn several_fields() {
        let mut headers = HeaderMap::new();
        assert!(!none_match(&headers, "\"a\""));
        headers.append(header::IF_NONE_MATCH, HeaderValue::from_static("\"b\""));
        assert!(!none_match(&headers, "\"a\""));
        headers.append(header::IF_NONE_MATCH, HeaderValue::from_static("\"a\""));
        assert!(none_match(&headers, "\"a\""));
    }

    #[test]
    fn conditions_of_those_who_read_on() {
        let with =
            |value: &'static str| HeaderMap::from_iter([(header::IF_MATCH, HeaderValue::from_static(value))]);
        for (value, expected) in [
            ("\"a\"", true),
            ("\"b\", \"a\"", true),
            ("*", true),
            ("\"b\"", false),
            ("W/\"a\"", false),
            ("\"b\", W/\"a\"", false),
            ("W/\"b\", \"a\"", true),
            ("", false),
        ] {
            assert_eq!(matches(&with(value), "\"a\""), expected, "{value}");
        }
        assert!(matches(&HeaderMap::new(), "\"a\""));
    }

    #[test]
    fn ranges_need_a_strong_match() {
        let with =
            |value: &'static str| HeaderMap::from_iter([(header::IF_RANGE, HeaderValue::from_static(value))]);
        assert!(range_applies(&HeaderMap::new(), "\"a\""));
        assert!(range_applies(&with("\"a\""), "\"a\""));
        for other in ["W/\"a\"", "\"b\"", "*", "Sun, 06 Nov 1994 08:49:37 GMT"] {
            assert!(!range_applies(&with(other), "\"a\""), "{other}");
        }
    }

    proptest! {
        #[test]
        fn any_list_is_walked_to_its_end(list: Vec<u8>) {
            list_has(&list, b"\"a\"", true);
        }

        #[test]
        fn what_is_listed_is_found(others in proptest::collection::vec("(W/)?\"[!#-~]{0,4}\"", 0..5)) {
            let mut list = others.join(", ");
            list.push_str(", W/\"wanted\"");
            prop_assert!(list_has(list.as_bytes(), b"\"wanted\"", true));
            prop_assert!(!list_has(list.as_bytes(), b"\"wanted\"", false));
        }
    }
}
