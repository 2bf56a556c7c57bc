//! Numerical stress: what BTFs that are hard on floating point numbers come out like, against bounds that are stated.
//!
//! Each case goes the whole way: factorized, coded, written, decoded. Judged in f64 by forming the products, which
//! is affordable because the cases are small:
//!
//! - orthonormality of both factors;
//! - the error of the truncated product against the optimum of an f64 singular value decomposition (Eckart and Young,
//!   The Approximation of One Matrix by Another of Lower Rank, 1936);
//! - the error that the factorization states against the true one;
//! - what half floats and codec lose, and the ledger of the archive against the truth.
//!
//! BTFs with NaN or infinities must first be refused with an error that names the place, and then come out well
//! repaired. Errors are relative to ‖B‖, or absolute where B is zero. [`pictures()`] draws the same cases.

mod bounds;
mod cases;
mod generate;
mod input;
mod measure;
mod pictures;
mod suite;
mod table;

pub use bounds::Bounds;
pub use cases::{Case, Harm, Sizes, cases};
pub use input::{Input, Shape};
pub use measure::{Measured, RepairMeasured, measure};
pub use pictures::{PictureRow, pictures, pictures_table};
pub use suite::{Row, examine, run};
pub use table::table;
