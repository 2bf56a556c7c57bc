//! The engine: streams the pages that a view needs, and draws with what is there.
//!
//! One frame, in the order of the data: feedback ([`gpu`]) → votes → [`residency`] → requests to a
//! [`stream::TileSource`] → [`decode`] → page cache ([`gpu`]) → shading ([`gpu`]). [`frame`] reads it from
//! top to bottom.
//!
//! - [`residency`] is pure: votes in, operations out; no clock, no I/O, no wgpu.
//! - [`stream`] is one trait, its implementations and its decorators.
//! - [`gpu`] is the only module that names wgpu.
//! - [`angular`] interpolates between sampled directions; [`mod@reference`] shades in f64 on the CPU;
//!   [`metrics`] compares pictures; an [`Overlay`] shows what is known of them.

pub mod angular;
pub mod decode;
mod error;
pub mod frame;
pub mod gpu;
pub mod metrics;
mod overlay;
pub mod reference;
pub mod residency;
pub mod stream;

pub use error::{Error, Result};
pub use overlay::Overlay;
