//! Where archives lie: one small trait, and what stands behind it.
//!
//! - [`Folder`]: `.bsvtf` files directly in a folder of this machine.
//! - [`Objects`]: objects of a bucket, or one archive on a web server, by URL.
//!
//! A store lists archives and opens versions of them; a [`Version`] answers reads with bytes of that version or
//! not at all, so that no answer is put together from two. Nothing is cached or tried again here:
//! `records` does that for all stores.

mod folder;
mod objects;

use std::{fmt, future::Future, ops::Range, pin::Pin, sync::Arc};

pub use folder::Folder;
pub use objects::Objects;

/// What a store answers, later.
pub type Answer<'a, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 'a>>;

/// Archives that can be listed and opened by name.
pub trait Store: Send + Sync + 'static {
    /// The archives there are now: at most [`crate::MAX_ARCHIVES`], the first by name, in order.
    fn list(&self) -> Answer<'_, Vec<Listed>>;

    /// Opens what a name of the last list stands for now.
    fn open<'a>(&'a self, name: &'a str) -> Answer<'a, Arc<dyn Version>>;
}

/// One content of an archive.
pub trait Version: Send + Sync + 'static {
    /// Tells this content from others of the same name.
    fn identity(&self) -> &Identity;

    /// Length in bytes.
    fn bytes(&self) -> u64;

    /// Reads exactly these bytes, which lie inside.
    ///
    /// Fails with [`StoreError::Changed`] if the name stands for another content now and this one cannot be
    /// read any more.
    fn read(&self, range: Range<u64>) -> Answer<'_, Vec<u8>>;
}

/// An archive of a store.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Without the ending `.bsvtf`.
    pub name: String,
    /// Its content, or why it is not served: a sentence for clients, without paths of this machine.
    pub identity: Result<Identity, String>,
}

/// What a store knows a content by: time and inode of a file, the ETag of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity(Arc<str>);

impl Identity {
    /// From any text that is another one for another content.
    pub fn new(text: impl Into<Arc<str>>) -> Self {
        Self(text.into())
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Why a store has no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// There is no such archive.
    #[error("it is not there any more")]
    NotFound,
    /// The archive has another content now.
    #[error("it has been replaced")]
    Changed,
    /// It may work if it is tried again.
    #[error("the store does not answer as it should: {0}")]
    Unavailable(String),
    /// It will not work.
    #[error("{0}")]
    Refused(String),
}

/// The name under which a file or an object is served; `None` for others, for hidden ones, and for names that
/// addresses cannot carry or that would be taken for the file of another archive.
pub(crate) fn archive_name(file: &str) -> Option<&str> {
    let name = file.strip_suffix(".bsvtf")?;
    let refused = name.is_empty() || name.starts_with('.') || name.ends_with(".bsvtf");
    (!refused && !name.contains(char::is_control) && !name.contains(['/', '\\'])).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files() {
        for (file, name) in [
            ("cloth.bsvtf", Some("cloth")),
            ("wool 2.bsvtf", Some("wool 2")),
            ("größe.bsvtf", Some("größe")),
            ("cloth.BSVTF", None),
            ("cloth.bsvtf.part", None),
            ("cloth.bsvtf.bsvtf", None),
            (".bsvtf", None),
            (".hidden.bsvtf", None),
            ("new\nline.bsvtf", None),
            ("in/ner.bsvtf", None),
        ] {
            assert_eq!(archive_name(file), name, "{file:?}");
        }
    }
}
