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
    /// The files of the web page cannot be served.
    #[error("the web page in {} cannot be served: {source}", path.display())]
    Pages {
        /// The folder.
        path: PathBuf,
        /// What is wrong with it.
        source: std::io::Error,
    },
    /// The archives cannot be reached.
    #[error("{url} cannot be served: {reason}")]
    Source {
        /// Where they should be, without secrets.
        url: String,
        /// What is wrong.
        reason: String,
    },
    /// Two collections have one place, or a place that no address can have.
    #[error("a collection cannot be served at {0:?}: {1}")]
    Place(String, &'static str),
    /// The certificate or its key.
    #[error("TLS cannot be set up from {}: {reason}", path.display())]
    Tls {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The socket does not work.
    #[error("the socket cannot be used: {0}")]
    Socket(std::io::Error),
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
