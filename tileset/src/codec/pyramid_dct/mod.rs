//! The page codec of choice: a critically sampled pyramid of 16×16 DCTs.
//!
//! Half of the frequencies of a 16×16 block in each direction, its lowest 8×8 coefficients, *are* an 8×8 block of the
//! next coarser mip, transformed. So a page sends only the other 192 of 256: all mips together take as many
//! coefficients as the finest has texels, where a pyramid of differences takes a third more. The transform of the
//! whole pyramid is orthonormal: errors of coefficients are errors of texels, a uniform step is optimal, and nothing
//! adds up from mip to mip. Blocks lie within pages, so a page needs its parent's payload and no border, and is sent
//! without one: borders are put together where the neighbours are.
//!
//! A block may go on from an earlier one of its page, see `page::source`. Levels are chosen by rate and distortion, and
//! coded with static models by context; see `levels`. What all pages share, [`PageTables`], is a section of the archive.
//!
//! Source: Schwartz, Ruiters, Klein, 2013, section 6, codes 8×8 DCTs of differences to up-sampled parents with
//! deflate. Halving a picture in the DCT domain: Dugad and Ahuja, "A fast scheme for image size change in the
//! compressed domain", 2001.

mod border;
mod context;
mod dispatch;
mod full;
mod levels;
mod page;
mod scan;
mod tables;
pub(super) mod transform;

pub use page::{CodedPage, Coefficients, code_group, count_group};
pub(super) use page::{coefficients, decode_into};
pub use tables::{PageTables, Statistics};
pub use transform::matrices;
