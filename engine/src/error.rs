//! Errors of the engine.

/// What went wrong, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No graphics adapter, or one that lacks what the engine needs.
    #[error("no usable graphics adapter: {0}")]
    Adapter(String),
    /// The scene cannot be drawn as it is.
    #[error("scene: {0}")]
    Scene(String),
    /// The budget is too small for anything at all, or beyond what the adapter has.
    #[error("budget: {0}")]
    Budget(String),
    /// A tile source failed for good.
    #[error("{what}: {detail}")]
    Source {
        /// What was asked for: archive and record.
        what: String,
        /// What the source said.
        detail: String,
    },
    /// A tile source could not answer now; asked again later it may.
    #[error("{what}: {detail}")]
    Unavailable {
        /// What was asked for: archive and record, or an address.
        what: String,
        /// What went wrong.
        detail: String,
        /// How long the source itself asks to be left alone.
        retry_after: Option<std::time::Duration>,
    },
    /// The source has another version of the archive than the one whose index it gave out. With a new index its records
    /// can be had again.
    #[error("{what}: {detail}")]
    Changed {
        /// What was asked for: archive and record.
        what: String,
        /// What the source said.
        detail: String,
    },
    /// The source has no such archive or record.
    #[error("{0} was not found: check the folder or address given with --tiles")]
    NotFound(String),
    /// A record or archive that does not hold.
    #[error(transparent)]
    Archive(#[from] tileset::Error),
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
