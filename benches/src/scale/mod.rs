//! What grows with the number of materials, and with their size: memory, the CPU of a frame, start-up.
//!
//! Archives are `virtual`: one archive under many names, and of any size, because all its pages are the same record. So ten materials of
//! 8192² texels, whose pages would be gigabytes, have all their directories, tables and trees, and take a few megabytes. `run` shows a square of each
//! material, and measures [`Row`]s; [`table`](fn@table) shows.

mod archive;
mod run;
mod table;

pub use run::{Plan, Results, Row, measure};
pub use table::table;
