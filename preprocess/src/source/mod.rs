//! BTFs in any format, behind one type.
//!
//! - [`Btf`]: what a BTF says about itself, and its samples in the order in which the factorization wants them.
//! - [`Images`]: what a format has to do: give the samples of consecutive images. No format holds a BTF in memory.
//!
//! An image is the picture of the material under one view and one light; image `view·lights + light` holds the rows
//! `3·image` to `3·image + 2` of the matrix, red, green and blue.

mod btf;
mod images;
mod open;

pub use btf::Btf;
pub use images::{Images, LowRank};
