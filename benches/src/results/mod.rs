//! What was measured and kept as JSON, as tables and plots of documents.
//!
//! A document has a place for each table, between the lines `<!-- table: NAME -->` and `<!-- end -->`; [`fill`] (`document`) writes
//! them anew and leaves the rest alone. `show` says which tables and plots come of which JSON. `peers`: of the JSON that the
//! programs in `peers/` write, which measure beside us.

mod document;
mod peers;
mod show;

pub use document::{fill, open};
pub use show::{KINDS, Kept};
