//! Errors that keep the service from running at all; what a request can do wrong is answered over HTTP.

use std::path::PathBuf;

/// Why the service does not run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The folder of the archives cannot be listed.
    #[error("the folder {} cannot be served: {source}; give a folder with .bsvtf files", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's own error.
        source: std::io::Error,
    },
    /// The socket does not work.
    #[error("the socket cannot be used: {0}")]
    Socket(std::io::Error),
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
