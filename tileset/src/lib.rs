//! The ground floor of Eigentile: what a page is, what an error is, how both become bytes.
//!
//! - [`pyramid`]: mips and tiles of a material of any size, and the packed mip tail.
//! - [`manifest`]: what an archive says about itself, with the ledger of errors.
//! - [`codec`]: pages and eigen-ABRDF columns to bytes and back.
//! - [`archive`]: the container, read through [`ReadAt`] and written to any `Write`.
//!
//! No files, no sockets, no threads, no GPU: bytes come in and go out.
//!
//! Source: Schwartz, Ruiters, Klein: Level-of-Detail Streaming and Rendering using Bidirectional Sparse
//! Virtual Texture Functions, 2013, sections 3, 5 and 6.

pub mod archive;
pub mod codec;
mod error;
mod frame;
pub mod manifest;
pub mod pyramid;

pub use archive::{Archive, ArchiveWriter, Index, ReadAt, Record};
pub use codec::{Column, Page};
pub use error::{Error, Result};
pub use manifest::{Codec, Direction, Factorization, Ledger, Manifest};
pub use pyramid::{PageId, Pyramid, Tile};

/// Side of a page's payload, in texels (paper, section 7: T = 64).
pub const PAGE_TEXELS: u32 = 64;
/// Border around a payload, in texels: enough for bilinear filtering, for the codec's up-sampling of the
/// parent and for moderate anisotropy (paper, section 7).
pub const BORDER_TEXELS: u32 = 4;
/// Side of a slot of the page cache: payload and both borders; nine DCT blocks of eight.
pub const SLOT_TEXELS: u32 = PAGE_TEXELS + 2 * BORDER_TEXELS;
/// Texels in a slot.
pub const SLOT_AREA: usize = (SLOT_TEXELS * SLOT_TEXELS) as usize;
/// Largest side of the finest mip in the packed tail; it and all coarser mips share one page.
pub const TAIL_TEXELS: u32 = 32;
/// Components in one group: the four channels of a texel.
pub const GROUP_COMPONENTS: usize = 4;
/// Largest accepted side of a material, in texels.
pub const MAX_SIDE_TEXELS: u32 = 1 << 16;
/// Largest accepted number of components.
pub const MAX_COMPONENTS: u32 = 1024;
/// Largest accepted number of view or of light directions.
pub const MAX_DIRECTIONS: u32 = 4096;
