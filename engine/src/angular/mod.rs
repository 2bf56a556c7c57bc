//! Interpolation between sampled directions: Delaunay triangulation in parabolic coordinates.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 4, after Ngan, Durand 2006. The paper rasters the
//! triangulation into textures; here every lookup walks to its triangle, which is exact everywhere and needs
//! a few hundred triangles instead of textures.
//!
//! - `triangulation`: the triangles, their hull, and the grid of start triangles.
//! - `locate`: from a direction to its [`Taps`].
//! - `ambient`: what each sample contributes under uniform light.
//!
//! The interpolant is continuous everywhere. Inside the convex hull of the samples it is linear in each
//! triangle, so it is exact for functions that are linear in parabolic coordinates. Outside it is constant
//! along the normals of the hull: the value of the hull's closest point.

mod ambient;
mod locate;
mod triangulation;

pub use locate::{Taps, cosine_from_parabolic, parabolic_from_direction};
pub use triangulation::{START_CELLS, Triangle, Triangulation};

/// Smallest cosine by which a sample beyond the hull is divided, see [`Taps::horizon_scale`]: samples that
/// include the light's cosine hold nothing but noise this close (0.006°) to the horizon.
pub const HULL_COSINE_FLOOR: f64 = 1e-4;
