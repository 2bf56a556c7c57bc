//! Two reports of one measurement, figure by figure.
//!
//! A report is any JSON that `eigentile bench … --json` prints. [`Figures`] finds its numbers and names them by their place; entries of lists are
//! named by the short texts in them (scene, network, case), so that they are found again when others come between. [`compare`] gives
//! ratios, and how much of one is noise:
//!
//! - the range of repeated runs: lists whose name ends in `rounds`, and several reports of the same program;
//! - where a median stands beside its 95th percentile (`ms` and `ms_95`), the distance of the two.
//!
//! Whether more is better follows from the last words of a name; of figures whose names do not tell, only the change is told.

mod direction;
mod figures;
mod judge;
mod table;

pub use direction::Direction;
pub use figures::Figures;
pub use judge::{Change, Comparison, Verdict, compare};
pub use table::table;
