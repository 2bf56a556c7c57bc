//! For fuzz targets: every parser of what requests carry, with what must hold of its results.

use hyper::{
    HeaderMap,
    header::{self, HeaderValue},
};

use crate::{address, answer, batch, conditional, log, range};

/// Reads bytes as each of the fields, and of something that is `length` bytes long.
///
/// # Panics
/// If a result is not what it may be.
pub fn request(length: u64, bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    if let Ok(all) = batch::wanted(&text) {
        assert!((1..=batch::MAX_RECORDS).contains(&all.len()));
    }
    let address = address::Address::of(&text);
    assert!(text.contains("v1") || !matches!(address, address::Address::In(..)));
    let plain = address::unescaped(&text);
    assert!(text.contains('%') || plain.as_deref() == Some(&*text));
    for field in [text.to_string(), format!("bytes={text}")] {
        if let range::Wanted::Parts(parts) = range::wanted(&field, length) {
            assert!((1..=range::MAX_RANGES).contains(&parts.len()));
            assert!(
                parts
                    .iter()
                    .all(|part| part.start < part.end && part.end <= length)
            );
        }
    }
    let Ok(value) = HeaderValue::from_bytes(bytes) else {
        return;
    };
    let etag = "\"0123abcd\"";
    let headers = |name| HeaderMap::from_iter([(name, value.clone())]);
    let named = text.contains(etag) || text.trim() == "*";
    assert!(!conditional::none_match(&headers(header::IF_NONE_MATCH), etag) || named);
    assert!(!conditional::matches(&headers(header::IF_MATCH), etag) || named);
    assert!(!conditional::range_applies(&headers(header::IF_RANGE), etag) || text.trim() == etag);
    let _ = answer::takes(&headers(header::ACCEPT_ENCODING), "gzip");
    let id = log::request_id(&headers(log::REQUEST_ID));
    assert!(id.to_str().is_ok_and(|id| (1..=64).contains(&id.len())));
}
