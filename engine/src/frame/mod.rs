//! One frame, from feedback to picture.
//!
//! [`Engine::frame`] (`engine`) reads from top to bottom; what it calls lies beside it: `archives` (indices of the
//! scene's BTFs), `votes` (votes of several frames), `records` (requests, answers, decoding), `problems` (what
//! went wrong). `outputs`: pictures and counters.

mod archives;
mod engine;
mod options;
mod outputs;
mod problems;
mod records;
mod stats;
mod votes;

pub use engine::Engine;
pub use options::{MAX_FEEDBACK_STRIDE, MIN_HOST_BYTES, Options};
pub use stats::{Counters, FrameStats, Milliseconds};
