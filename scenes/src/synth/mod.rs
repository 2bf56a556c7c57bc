//! Procedural materials with real meso-geometry, ray traced to BTFs.
//!
//! A material is a solid that repeats in x and y, and what its surface is made of at each point. For each
//! view, rays go from above through every texel of the reference plane; where they hit, all lights are
//! evaluated at once. What is expensive does not depend on the view: visibility of the lights, the surface's
//! own properties and the bounce are computed once for each small cell of the surface and shared by all views
//! and texels that see it.
//!
//! - [`sampling`]: the view and light directions of well-known measurements.
//! - [`synthesize()`]: from a material's name to samples, one view at a time.
//! - `volume`, `distances`, `march`: the solid as a periodic grid of signed distances, and rays through it.
//! - `ceiling`: where lights are visible without a ray.
//! - `surface`, `bounce`: the cells of the surface, their visible lights, and light by way of other cells.
//! - `reflectance`: the diffuse and glossy reflectance, for all lights at once.
//! - [`Style`]: colour, gloss, relief and pattern, so that one kind of material is many.
//! - `materials`: the materials; `noise`, `random`, `strands`: what they are made from.
//!
//! Deliberately left out: translucency, more than one bounce, and lights of finite size.
//!
//! The reference plane z = 0 is the mean height of the surface seen from straight above.

mod bounce;
mod ceiling;
mod distances;
mod march;
mod materials;
mod noise;
mod options;
mod random;
mod reflectance;
mod sampler;
pub mod sampling;
mod strands;
mod style;
mod surface;
mod synthesize;
mod volume;

pub use materials::{MaterialDescription, materials};
pub use options::{MAX_BLOCK_BYTES, MAX_SAMPLES_PER_TEXEL, MAX_SIZE, SynthOptions};
pub use sampler::{Sampler, sample};
pub use sampling::Sampling;
pub use style::{PATTERNS, Style};
pub use synthesize::{SynthReport, synthesize};
