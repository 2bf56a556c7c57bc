//! The container: header, manifest, directory, records. docs/format.md gives every byte.
//!
//! - [`ReadAt`]: where the bytes come from.
//! - [`Index`]: header, manifest and directory, parsed and checked from the first bytes of an archive.
//! - [`Archive`]: an index and the bytes behind it.
//! - [`ArchiveWriter`]: from records to a file whose every prefix is already a picture.
//!
//! Nothing is decoded here; see [`crate::codec`]. Nothing is cached either.

mod directory;
mod header;
mod index;
mod order;
mod read_at;
mod reader;
mod writer;

pub use header::{HEADER_BYTES, MAX_INDEX_BYTES};
pub use index::{CHECKSUM_BYTES, Index, Record, contents};
pub use read_at::ReadAt;
pub use reader::Archive;
pub use writer::ArchiveWriter;
