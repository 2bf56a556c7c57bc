//! Pages and columns to bytes and back.
//!
//! Two codecs, by their [`crate::Codec`]: the one of choice, [`pyramid_dct`] for pages and [`columns`] for
//! eigen-ABRDFs, and that of the paper with zstd behind it, to compare with: [`encode_page`] and [`encode_column`].
//! docs/format.md gives every byte. [`Decoder`] reads the records of an archive of either.
//!
//! Decoding gives the same bits on every platform: additions and multiplications of f32 in a fixed order,
//! never fused, and constants instead of run-time cosines. So pages that were coded on one machine meet the
//! very same parents on another.
//!
//! - [`MipImage`]: one mip before coding, and the filter that makes the next.
//! - [`encode_page`], [`decode_page`]: one page as the 8×8 DCT of its difference to its up-sampled, *decoded* parent
//!   (closed loop: errors do not add up from mip to mip), quantized with one step for all components, and zstd.
//! - [`encode_column`], [`decode_column`]: one group's eigen-ABRDFs, without loss.
//!
//! No files, no threads; nothing is kept between calls but working memory, one per thread.
//!
//! Source: Schwartz, Ruiters, Klein, 2013, section 6 (8×8 DCT of the difference to the up-sampled parent) and
//! equation 8 (the weight of a page). Different from the paper: the loop is closed, up-sampling is sharper,
//! levels are chosen by rate and distortion, and zstd replaces deflate.

mod column;
pub mod columns;
mod dct;
mod decoder;
mod lines;
mod mip;
mod page;
pub mod pyramid_dct;
mod quantize;
mod rans;
mod region;
mod symbols;
mod tail;
mod texel;
mod upsample;

pub use column::{Column, MAX_COLUMN_BYTES, decode_column, encode_column};

pub(crate) use decoder::check;
pub use decoder::{Decoder, MAX_TABLES_BYTES, column_steps, tables_bytes};
pub use mip::MipImage;
pub use page::{EncodedPage, MAX_PAGE_BYTES, Page, decode_page, encode_page};
