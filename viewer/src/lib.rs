//! What every viewer does, with or without a window: cameras, lights, shapes, links, and one session over the engine.
//!
//! - [`input`] and [`keys`]: what users do, as plain events in pixels, and which key means what.
//! - [`controls`]: the camera that follows them: [`controls::Mode::Orbit`] or [`controls::Mode::Fly`].
//! - [`lights`]: several lights, turned by dragging.
//! - [`quality`]: from an error that may be seen to budgets and to what is left out.
//! - [`link`]: camera, light, exposure, shape and overlay in a short string.
//! - [`recorder`]: camera paths recorded, replayed, and around the middle.
//! - [`report`]: what there is to tell, and its course over time.
//! - [`Viewer`]: a scene or a lone archive, its engine, and all of these.
//!
//! No window, no clock, no thread and no file here: time comes in as seconds, archives through a
//! [`engine::stream::TileSource`] that the program has made. So the same code runs in a window and in a browser.

pub mod controls;
pub mod input;
pub mod keys;
pub mod lights;
pub mod link;
pub mod quality;
pub mod recorder;
pub mod report;
mod touch;
mod viewer;

pub use controls::Mode;
pub use input::Input;
pub use keys::Command;
pub use link::Link;
pub use report::{Connection, Report};
pub use viewer::{Subject, Viewer};

/// What [`Viewer`] fails with: the engine's errors.
pub use engine::{Error, Result};
