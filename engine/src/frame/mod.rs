//! One frame, from feedback to picture.
//!
//! [`Engine::frame`] (`engine`) reads from top to bottom; its `phases` and what they call lie beside it: `archives`
//! (indices of the scene's BTFs), `votes` (votes of several frames), `records` (requests and answers), `decoding`,
//! `workers` (what must not hold up a frame), `problems` (what went wrong), `events` (what a program is told).
//! `prefetch`, `ahead` and `motion`: views that are not shown yet. `budgets`: changes at run time.
//! `page_format`: what the page cache holds. `outputs`: pictures
//! and counters. `viewing`: what viewers change. `maps`, `materials`: what lies where, and how far it is, for programs that show it; `placed`: since when.
//! `overlays`: what covers the picture. `measured`: what measurements need. `policy`: who decides what is resident. `visibility`: where errors are seen.

mod ahead;
mod archives;
mod budgets;
mod decoding;
mod engine;
mod events;
mod maps;
mod materials;
mod measured;
mod motion;
mod options;
mod outputs;
mod overlays;
mod page_format;
mod phases;
mod placed;
mod policy;
mod prefetch;
mod problems;
mod records;
mod stats;
mod viewing;
mod visibility;
mod votes;
mod workers;

pub use crate::gpu::Filter;
pub use ahead::MAX_PREFETCHED_VIEWS;
pub use engine::Engine;
pub use events::Event;
pub use maps::{CacheMap, CachedColumn, CachedPage, MipTiles, PageTree};
pub use materials::{MaterialState, MaterialStatus};
pub use options::{
    Arithmetic, Budgets, Decode, HALF_ERROR, MAX_FEEDBACK_STRIDE, MAX_PREFETCH_SECONDS, MIN_HOST_BYTES,
    Options,
};
pub use policy::Policy;
pub use stats::{Clock, Counters, FrameStats, Milliseconds};
