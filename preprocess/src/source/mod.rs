//! BTFs in any format, behind one type.
//!
//! - [`Btf`]: what a BTF says about itself, and its samples in the order in which the factorization wants them.
//! - [`Images`]: what a format has to do: give the samples of consecutive images. No format holds a BTF in memory.
//! - [`inspect`](fn@inspect): what a file or folder holds, before hours are spent on it.
//! - [`convert`](fn@convert): any BTF to the exchange format.
//! - [`Btf::repaired`]: the same BTF with NaN and infinities filled in, and [`Repairs`], the count of them.
//!
//! An image is the picture of the material under one view and one light; image `view·lights + light` holds the rows
//! `3·image` to `3·image + 2` of the matrix, red, green and blue.

mod btf;
mod btf_file;
mod convert;
mod decode;
mod image_set;
mod images;
mod inspect;
mod open;
mod repair;

pub use btf::Btf;
pub use convert::{Conversion, convert};
pub use decode::Color;
pub use images::{Images, LowRank};
pub use inspect::{Estimate, Inspection, Ring, Sample, Table, inspect};
pub use open::Overrides;
pub use repair::{Repair, RepairReport, Repairs};
