//! Errors of measuring.

use std::path::{Path, PathBuf};

/// What went wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading, factorizing or coding a BTF failed.
    #[error(transparent)]
    Preprocess(#[from] preprocess::Error),
    /// Drawing or streaming failed.
    #[error(transparent)]
    Engine(#[from] engine::Error),
    /// An archive cannot be read or decoded.
    #[error("{path}: {source}", path = .path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What the archive's own layer says.
        source: tileset::Error,
    },
    /// A file or folder cannot be read or written.
    #[error("{path}: cannot {action}: {source}", path = .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was being done: "open", "write".
        action: &'static str,
        /// The system's own error.
        source: std::io::Error,
    },
    /// Kept factors whose files contradict each other.
    #[error("{path}: {detail}; keep the factors of this BTF again", path = .path.display())]
    Kept {
        /// The file.
        path: PathBuf,
        /// What was found, and what was expected.
        detail: String,
    },
    /// Kept results that cannot be shown.
    #[error("{path}: {detail}; measure again", path = .path.display())]
    Results {
        /// The file.
        path: PathBuf,
        /// What was found, and what was expected.
        detail: String,
    },
    /// No accepted quantizer step meets an error.
    #[error(
        "no quantizer step meets the relative error {target}: step {quality:e} gives {error:.6}; \
         choose a {advice} target"
    )]
    Unreachable {
        /// The relative error asked for.
        target: f64,
        /// The finest or coarsest accepted step, in root mean squares of the BTF.
        quality: f64,
        /// What it gives.
        error: f64,
        /// "larger" or "smaller".
        advice: &'static str,
    },
    /// A trace of votes that cannot be written, read or replayed.
    #[error("trace of votes: {0}")]
    Trace(String),
    /// A program that is measured, or measures, does not run as it should.
    #[error("{program}: {detail}")]
    Program {
        /// Which one.
        program: &'static str,
        /// What it did, or what to install.
        detail: String,
    },
    /// An argument outside of its range.
    #[error("{what} is {found}; it must be {expected}")]
    Invalid {
        /// Which one.
        what: &'static str,
        /// Its value.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },
}

impl Error {
    /// For `map_err`: an [`Error::Io`] of `path`.
    pub(crate) fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.to_owned();
        move |source| Error::Io { path, action, source }
    }

    /// For `map_err`: an [`Error::Archive`] of `path`.
    pub(crate) fn archive(path: &Path) -> impl FnOnce(tileset::Error) -> Error {
        let path = path.to_owned();
        move |source| Error::Archive { path, source }
    }
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
