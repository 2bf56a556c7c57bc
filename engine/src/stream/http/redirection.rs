//! Where a host sends a GET on to, and whether it goes there (RFC 9110, section 15.4).

use hyper::{StatusCode, Uri, header::HeaderValue};
use url::Url;

/// Most redirections of one GET.
pub(super) const MOST: u64 = 5;

/// Where an answer sends a GET on to. `None` for all other answers, and for places that it must not go to: what was asked
/// for with TLS is never fetched without, and there are no other schemes and no user names.
pub(super) fn target(from: &Uri, status: StatusCode, location: Option<&HeaderValue>) -> Option<Uri> {
    let sends_on = matches!(status.as_u16(), 301 | 302 | 303 | 307 | 308);
    let location = location.filter(|_| sends_on)?.to_str().ok()?;
    let from = Url::parse(&from.to_string()).ok()?;
    let mut to = from.join(location).ok()?;
    to.set_fragment(None);
    let safe = match to.scheme() {
        "https" => true,
        "http" => from.scheme() == "http",
        _ => false,
    };
    let named = !to.username().is_empty() || to.password().is_some();
    (safe && !named).then(|| to.as_str().parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(from: &str, status: u16, to: &'static str) -> Option<String> {
        let (from, to) = (from.parse().unwrap(), HeaderValue::from_static(to));
        let status = StatusCode::from_u16(status).unwrap();
        super::target(&from, status, Some(&to)).map(|uri| uri.to_string())
    }

    #[test]
    fn places_are_resolved_against_the_one_before() {
        let from = "http://host:81/tiles/cloth.bsvtf?old=1";
        for (to, resolved) in [
            ("https://b/x?sig=a%2Fb&n=1#top", "https://b/x?sig=a%2Fb&n=1"),
            ("//b/x", "http://b/x"),
            ("/x", "http://host:81/x"),
            ("wool.bsvtf", "http://host:81/tiles/wool.bsvtf"),
            ("../x", "http://host:81/x"),
            ("?new=2", "http://host:81/tiles/cloth.bsvtf?new=2"),
        ] {
            for status in [301, 302, 303, 307, 308] {
                assert_eq!(target(from, status, to).as_deref(), Some(resolved), "{to}");
            }
        }
    }

    #[test]
    fn what_is_not_followed() {
        assert_eq!(target("https://a/x", 302, "http://a/x"), None, "to less safety");
        assert_eq!(
            target("https://a/x", 302, "https://b/").as_deref(),
            Some("https://b/")
        );
        for to in ["ftp://a/x", "file:///etc/passwd", "http://user@b/", "http://", ""] {
            assert!(
                target("http://a/x", 302, to).is_none_or(|to| to == "http://a/x"),
                "{to}"
            );
        }
        for status in [200, 206, 300, 304, 305, 404] {
            assert_eq!(target("http://a/x", status, "http://b/"), None, "{status}");
        }
        assert_eq!(
            super::target(&"http://a/".parse().unwrap(), StatusCode::FOUND, None),
            None
        );
    }
}
