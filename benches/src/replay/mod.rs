//! Camera × network traces, recorded and replayed exactly.
//!
//! A [`Trace`] names a scene, and holds the camera of each frame, a sixtieth of a second apart in simulated time, the network, budgets, and
//! what came of it when it was recorded. [`replay`] does it again: the engine waits for its votes and decodes in its frames, the source answers
//! in the order of the requests, and the network has no clock, so that the same program gives the same [`Counts`], down to the order in which
//! records come. Another version of the program gives others, and [`crate::compare`] says which.
//!
//! What depends on the adapter is which pixels see what: votes of another rasterizer may differ at edges of triangles.

mod counts;
mod run;
mod trace;

pub use counts::Counts;
pub use run::{Replayed, replay, table};
pub use trace::{Footage, Line, Trace};
