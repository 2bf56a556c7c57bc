//! Interpolation between sampled directions: Delaunay triangulation in parabolic coordinates.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 4, after Ngan, Durand 2006. The paper rasters the
//! triangulation into textures; here every lookup walks to its triangle, which is exact everywhere and needs
//! a few hundred triangles instead of textures.
//!
//! - `triangulation`: the triangles, their hull, and the grid of start triangles.
//! - `locate`: from a direction to its [`Taps`].
//! - `ambient`: what each sample contributes under uniform light.
//! - `hemisphere`: samples by light as maps that texture units interpolate, the other way of [`Angular`].
//!
//! The interpolant is continuous everywhere. Inside the convex hull of the samples it is linear in each
//! triangle, so it is exact for functions that are linear in parabolic coordinates. Outside it is constant
//! along the normals of the hull: the value of the hull's closest point.

mod ambient;
mod hemisphere;
mod locate;
mod triangulation;

pub use hemisphere::{Hemisphere, ROW_TEXELS, map_side, map_texels};
pub use locate::{Taps, cosine_from_parabolic, parabolic_from_direction};
pub use triangulation::{START_CELLS, Triangle, Triangulation};

/// Smallest cosine by which a sample beyond the hull is divided, see [`Taps::horizon_scale`]: samples that
/// include the light's cosine hold nothing but noise this close (0.006°) to the horizon.
pub const HULL_COSINE_FLOOR: f64 = 1e-4;

/// How shading interpolates an eigen-ABRDF between directions, and so what the column cache holds. Views are
/// interpolated in their triangle in both ways, and the ambient light has an entry of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
pub enum Angular {
    /// Between the three lights around the direction: the column as it was sampled. Exact, with nine taps a light and
    /// group (Schwartz, Ruiters, Klein 2013, section 4).
    #[default]
    Delaunay,
    /// In maps of the light hemisphere, which texture units filter: fewer fetches, more memory, and an error of
    /// resampling (Schwartz, Ruiters, Weinmann, Klein 2011, section 3). See [`Hemisphere`].
    Hemisphere,
}

impl Angular {
    /// Texels that a pixel fetches from the column cache for each light and each component group: loads, or filtered
    /// samples.
    pub fn fetches(self) -> u32 {
        match self {
            // Three colours at nine taps: one and a half texels each, of which two are loaded.
            Self::Delaunay => 18,
            // Three colours at three views.
            Self::Hemisphere => 9,
        }
    }
}
