//! The GPU side of the engine: the only module that names wgpu.
//!
//! One pass is one file here beside one `.wgsl` of the crate `shaders`: [`visibility`], [`feedback`], [`shade`],
//! [`tonemap`], [`stitch`]. What they share lies in three bind groups: the scene (group 0: camera, [`geometry`], materials), the
//! caches (group 1: [`page_table`], [`page_cache`], [`column_cache`], directions) and what a pass reads and writes
//! (group 2); [`stitch`] alone works on the page cache itself ([`borders`]). [`Renderer`] owns all of it. Nothing here decides what is resident.
//!
//! Stays within the default limits of WebGPU: 4 bind groups, 8 storage buffers in a stage, 128 MiB bindings. Only
//! array layers, texture sides and buffer sizes are raised where the adapter has more.

mod bind;
pub mod borders;
pub mod column_cache;
mod context;
pub mod feedback;
pub mod geometry;
mod growing;
pub mod materials;
pub mod page_cache;
pub mod page_table;
mod readback;
mod renderer;
mod resources;
pub mod shade;
pub mod stitch;
mod targets;
mod timers;
pub mod tonemap;
mod view;
pub mod visibility;

pub use context::Context;
pub use renderer::{Ask, Renderer};
pub use resources::{Caches, Layout};
pub use timers::GpuMilliseconds;
