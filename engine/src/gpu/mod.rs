//! The GPU side of the engine: the only module that names wgpu.
//!
//! One pass is one file here beside one `.wgsl` of the crate `shaders`, in the order of a frame: [`visibility`] (ids of
//! what pixels see), [`feedback`] (votes for tiles, counted and compacted), [`classify`] (materials by tile of the
//! picture), [`shade`] (one workgroup for a tile and a material), [`tonemap`] or, in its place, `overlay`; and in the
//! page cache [`decode`], which makes pages of coefficients, and [`stitch`], which copies borders ([`borders`]). What they share lies in three bind groups: the scene (group 0: camera, [`geometry`],
//! materials), the caches (group 1: [`page_table`], [`page_cache`], [`column_cache`], directions) and what a pass reads
//! and writes (group 2). [`Renderer`] owns all of it: `look` has what draws ids and asks for votes, `placing` what fills the caches, `outputs` what reads
//! back. [`cutoff`] says which component groups matter, [`fade`] how new pages come in, [`page_format`] what a texel of the page
//! cache is. [`Present`] shows pictures in a target that somebody else owns; `changing` replaces lights and meshes. `uploads` brings texels into both caches, `kept` shows the old page cache while
//! one of another format fills. `resident` is what measurements compare with: the same without a page table. Nothing here decides what is
//! resident. Meshes and lights may hold anything: what then is drawn is written down in `finite.wgsl`.
//!
//! Stays within the default limits of WebGPU: 4 bind groups, 8 storage buffers in a stage, 128 MiB bindings. Only
//! array layers, texture sides and buffer sizes are raised where the adapter has more.

mod bind;
pub mod borders;
mod changing;
pub mod classify;
pub mod column_cache;
mod context;
pub mod cutoff;
pub mod decode;
pub mod fade;
pub mod feedback;
pub mod geometry;
mod growing;
mod kept;
mod look;
pub mod materials;
mod outputs;
mod overlay;
pub mod page_cache;
pub mod page_format;
pub mod page_table;
mod placing;
mod present;
mod readback;
mod renderer;
mod resident;
mod resources;
pub mod shade;
mod slot_scales;
pub mod stitch;
mod targets;
mod timers;
pub mod tonemap;
mod uploads;
mod view;
pub mod visibility;

pub use context::Context;
pub use look::Ask;
pub use page_format::PageFormat;
pub use present::{Area, Present};
pub use renderer::Renderer;
pub use resources::{Caches, Filter, Layout, Shading};
pub use shade::ShadingWork;
pub use slot_scales::Rounded;
pub use timers::GpuMilliseconds;
