//! How good a picture is with how much memory on the GPU: budgets from one page for each material to all that a view wants, by
//! format of the page cache and by rank.
//!
//! - [`measure`] (`run`) settles one view under each [`Setting`] and compares the picture with full residency, and with the
//!   uncompressed BTFs where they are given. `crate::capped`: residency of leading component groups only, which is what a
//!   factorization of lower rank would hold.
//! - `knee`: where more memory begins to bring little. `shots`: pictures and error maps at chosen points.
//! - [`table`] and [`report`](fn@report) show.
//!
//! After figure 4 of Schwartz, Ruiters and Klein 2013 (too small, right, full, and low rank at equal memory), for any scene.

mod knee;
mod report;
mod run;
mod shots;

pub use report::{plot, report, rows, side_by_side, table};
pub(crate) use run::covered;
pub use run::{Plan, Point, Quality, Results, Setting, Truth, measure};
pub use shots::Shot;
