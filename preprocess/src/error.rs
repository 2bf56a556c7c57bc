//! Errors of preprocessing: each variant is something a caller can decide on.

use std::path::{Path, PathBuf};

/// What went wrong, in which file, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder cannot be read or written.
    #[error("{path}: cannot {action}: {source}", path = .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was being done: "open", "write", "rename to ...".
        action: String,
        /// The system's own error.
        source: std::io::Error,
    },
    /// A file is not in the exchange format, or its parts contradict each other.
    #[error("{path}: {detail}", path = .path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What was found, what was expected, what to do.
        detail: String,
    },
    /// A sample that no reflectance can have.
    #[error(
        "{path} ({place}): the sample of view {view}, light {light}, channel {channel}, texel x {x} y {y} is {value}; \
         samples must be finite and at most {limit:e} in size: repair it at its source, or \
         preprocess with --repair",
        path = .path.display(), limit = crate::npy::MAX_SAMPLE
    )]
    BadSample {
        /// The file.
        path: PathBuf,
        /// Where in it the image stands.
        place: String,
        /// Index of the view.
        view: usize,
        /// Index of the light.
        light: usize,
        /// 'r', 'g' or 'b'.
        channel: char,
        /// Column of the texel.
        x: usize,
        /// Row of the texel.
        y: usize,
        /// What stands there.
        value: f64,
    },
    /// The factors themselves do not fit the memory that may be used.
    #[error(
        "{components} components of {rows} x {columns} samples need {needed_bytes} bytes of memory, more than \
         the {limit_bytes} allowed: allow more (--memory) or ask for fewer components"
    )]
    OverBudget {
        /// Components asked for.
        components: u32,
        /// Rows of the matrix: views × lights × 3.
        rows: usize,
        /// Columns of the matrix: texels.
        columns: usize,
        /// Least memory that is enough.
        needed_bytes: u64,
        /// What may be used.
        limit_bytes: u64,
    },
    /// No rank and quantizer step meet a goal.
    #[error(
        "{goal} cannot be reached: {best}; ask for less, or allow more memory (--memory) if that was the limit"
    )]
    Unreachable {
        /// What was asked for.
        goal: String,
        /// What can be reached instead.
        best: String,
    },
    /// An option or argument outside of its range.
    #[error("{what} is {found}; it must be {expected}")]
    Invalid {
        /// Which one.
        what: &'static str,
        /// Its value.
        found: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// An archive cannot be built or read.
    #[error("{path}: {source}", path = .path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What the archive's own layer says.
        source: tileset::Error,
    },
    /// A decomposition of a small matrix did not converge; its input is finite, so this is a defect.
    #[error("the {0} did not converge on finite input: please report this with the file that caused it")]
    NotConverged(&'static str),
}

impl Error {
    /// For `map_err`: an [`Error::Io`] of `path`.
    pub(crate) fn io(path: &Path, action: impl Into<String>) -> impl FnOnce(std::io::Error) -> Error {
        let (path, action) = (path.to_owned(), action.into());
        move |source| Error::Io { path, action, source }
    }

    /// An [`Error::Format`] of `path`.
    pub(crate) fn format(path: &Path, detail: impl Into<String>) -> Error {
        Error::Format {
            path: path.to_owned(),
            detail: detail.into(),
        }
    }

    /// For `map_err`: an [`Error::Archive`] of `path`.
    pub(crate) fn archive(path: &Path) -> impl FnOnce(tileset::Error) -> Error {
        let path = path.to_owned();
        move |source| Error::Archive { path, source }
    }
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
