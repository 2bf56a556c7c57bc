//! Counts and lists of names in messages.

/// Names in a message at most.
pub(super) const MAX_NAMES: usize = 8;

/// `1 image`, `2 images`.
pub(super) fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// The first few names.
pub(super) fn list(names: &[impl AsRef<str>]) -> String {
    list_of(names.len(), names)
}

/// The first few names of so many.
pub(super) fn list_of(all: usize, names: &[impl AsRef<str>]) -> String {
    let shown: Vec<&str> = names.iter().take(MAX_NAMES).map(AsRef::as_ref).collect();
    let more = all - shown.len();
    match more {
        0 => shown.join(", "),
        _ => format!("{} and {more} more", shown.join(", ")),
    }
}
