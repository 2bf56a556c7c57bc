//! From a BTF to an archive, and back to numpy files.
//!
//! - [`source`]: BTFs in any format.
//! - [`npy`]: BTFs in the exchange format, read through a memory map and written as a stream.
//! - [`factorize`](mod@factorize): truncated SVD of a BTF that is far larger than memory.
//! - [`goal`]: rank and quantizer step that meet an error or a number of bytes.
//! - [`build`](mod@build): pyramids, pages, columns, and the ledger of errors.
//! - [`export`](mod@export): an archive as numpy files.
//! - [`run`](fn@run): all of it in one call, with a [`Report`].
//!
//! Every error is measured in one unit, the root mean square of reflectance: see [`tileset::Ledger`].
//!
//! Source: Schwartz, Ruiters, Klein: Level-of-Detail Streaming and Rendering using Bidirectional Sparse Virtual
//! Texture Functions, 2013, sections 3 and 6.

pub mod build;
mod error;
pub mod export;
pub mod factorize;
pub mod goal;
mod measure;
pub mod memory;
pub mod npy;
mod output;
mod progress;
mod report;
mod run;
pub mod source;

pub use error::{Error, Result};
pub use export::export;
pub use factorize::{Factors, Settings, Weights};
pub use goal::Goal;
pub use progress::{Phase, Progress, ProgressFn};
pub use report::{Report, Seconds, StageError, WeightedError};
pub use run::{Options, run, run_once};
pub use source::Btf;
