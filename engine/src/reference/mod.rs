//! Shading in f64 on the CPU: the reference for the GPU, and for everything before it.
//!
//! Twin of the shaders: the same geometry, frames, filters and interpolation, step by step, with nothing
//! compressed, cached or skipped. What it does not do: visibility. It shades the pixels that a visibility
//! pass found, so that pictures differ by shading only.
//!
//! - `camera`: from pixels to rays. `surface`: what a ray meets. `frame`: the tangent frame there.
//! - `footprint`: the texels under a pixel, trilinear.
//! - `reflectance`: BTFs that can be read anywhere; `factors`: from an archive; `mipped`: from samples
//!   of the finest mip.
//! - `light`: what falls in. `shade`: the picture.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 3 (equation 1) and section 4 (equation 5).

mod camera;
mod factors;
mod footprint;
mod frame;
mod light;
mod mipped;
mod reflectance;
mod shade;
mod surface;

pub use camera::Rays;
pub use factors::FactorReflectance;
pub use footprint::{Footprint, Texel};
pub use frame::TangentFrame;
pub use light::Incident;
pub use mipped::{Mipped, Samples};
pub use reflectance::Reflectance;
pub use shade::shade;
pub use surface::{Placed, SurfacePoint};
