//! Names in addresses.

/// A name as one segment of a path: everything but unreserved characters is escaped (RFC 3986, section 2.3).
/// Names of dots alone would still be walked as a path by proxies, so their dots are escaped as well.
pub(super) fn escape(name: &str) -> String {
    let dots = name.bytes().all(|byte| byte == b'.');
    let mut escaped = String::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' | b'~' => escaped.push(byte.into()),
            b'.' if !dots => escaped.push('.'),
            _ => escaped.push_str(&format!("%{byte:02X}")),
        }
    }
    escaped
}
