//! Errors of archives: each variant is something a caller can decide on.

/// What went wrong with an archive, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The bytes are no archive, or damaged.
    #[error(
        "{what} at byte {offset}: {detail}; the archive is damaged or is no .bsvtf file, fetch or build it again"
    )]
    Corrupt {
        /// The part that was read: header, manifest, directory, page, column.
        what: String,
        /// Offset in the archive, or in the record where that is all that is known.
        offset: u64,
        /// What was found and what was expected.
        detail: String,
    },
    /// The archive was written by a newer program.
    #[error(
        "archive version {found} is not {supported}, the one that this program reads: update the program if it is newer, \
         preprocess the material again if it is older"
    )]
    UnsupportedVersion {
        /// Version in the file.
        found: u32,
        /// The version that is read.
        supported: u32,
    },
    /// A page or column that the archive does not have.
    #[error("{what} is not in this archive: {detail}")]
    NotFound {
        /// Which record.
        what: String,
        /// What the archive has.
        detail: String,
    },
    /// A limit of this implementation.
    #[error("{what} is {found}, more than the limit of {limit}")]
    OverLimit {
        /// Which quantity.
        what: &'static str,
        /// Its value.
        found: u64,
        /// The largest accepted value.
        limit: u64,
    },
    /// Values that cannot be stored: not finite, or out of range.
    #[error("{what}: {detail}")]
    Invalid {
        /// Which value.
        what: String,
        /// Why it is refused.
        detail: String,
    },
    /// Reading or writing the underlying bytes failed.
    #[error("{what}: {source}")]
    Io {
        /// What was being done.
        what: String,
        /// The system's own error.
        source: std::io::Error,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Shorthand for [`Error::Corrupt`].
pub(crate) fn corrupt(what: impl Into<String>, offset: u64, detail: impl Into<String>) -> Error {
    Error::Corrupt {
        what: what.into(),
        offset,
        detail: detail.into(),
    }
}
