//! Errors of scenes and materials.

/// What is wrong with a scene, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: std::path::PathBuf,
        /// The system's own error.
        source: std::io::Error,
    },
    /// The file is not what it should be.
    #[error("{path}: {detail}")]
    Invalid {
        /// File, or the name of what was built in memory.
        path: std::path::PathBuf,
        /// What was found, what was expected, what to do.
        detail: String,
    },
    /// No procedural material has this name.
    #[error("no material named {name:?}; there are {known}")]
    UnknownMaterial {
        /// What was asked for.
        name: String,
        /// All names.
        known: String,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
