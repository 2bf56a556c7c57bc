//! Where archives lie, and what lies beside them: one small trait, and what stands behind it.
//!
//! - [`Folder`]: files directly in a folder of this machine.
//! - [`Objects`]: objects of a bucket, or one archive on a web server, by URL.
//!
//! A store lists the files that are served, and opens versions of them; a [`Version`] answers reads with bytes of that
//! version or not at all, so that no answer is put together from two. What is served is a matter of names alone
//! ([`Kind`]). Nothing is cached or tried again here: `records` does that for all stores.

mod folder;
mod kind;
mod objects;

use std::{fmt, future::Future, ops::Range, pin::Pin, sync::Arc};

pub use folder::Folder;
pub use kind::Kind;
pub(crate) use kind::{Found, archive_name};
pub use objects::Objects;

/// What a store answers, later.
pub type Answer<'a, T> = Pin<Box<dyn Future<Output = Result<T, StoreError>> + Send + 'a>>;

/// Files that can be listed and opened by name.
pub trait Store: Send + Sync + 'static {
    /// The files that are served, in the order of their names: at most [`crate::MAX_ARCHIVES`] archives and
    /// [`crate::MAX_FILES`] others, the first by name.
    fn list(&self) -> Answer<'_, Vec<Listed>>;

    /// Opens what the name of a file in the last list stands for now.
    fn open<'a>(&'a self, file: &'a str) -> Answer<'a, Arc<dyn Version>>;
}

/// One content of a file.
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

/// A file of a store.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Its whole name, such as `cloth.bsvtf`.
    pub file: String,
    /// Its content, or why it is not served: a sentence for clients, without paths of this machine.
    pub identity: Result<Identity, String>,
    /// Its length; 0 if it is not served.
    pub bytes: u64,
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
    /// There is no such file.
    #[error("it is not there any more")]
    NotFound,
    /// The file has another content now.
    #[error("it has been replaced")]
    Changed,
    /// It may work if it is tried again.
    #[error("the store does not answer as it should: {0}")]
    Unavailable(String),
    /// It will not work.
    #[error("{0}")]
    Refused(String),
}
