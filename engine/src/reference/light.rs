//! What falls onto a point.

use glam::DVec3;
use scenes::Light;

use super::SurfacePoint;

/// Light from one direction.
#[derive(Clone, Copy, Debug)]
pub struct Incident {
    /// Unit vector towards the light, tangent frame.
    pub direction: DVec3,
    /// On a plane that faces the light, linear RGB.
    pub irradiance: DVec3,
}

impl Incident {
    /// What a light sends to a point; `None` if the light lies in the point.
    ///
    /// The square of the distance counts as 1e-12 at least, so that a light close to a surface stays finite.
    pub fn new(light: &Light, point: &SurfacePoint, eye: DVec3) -> Option<Self> {
        let (to_light, irradiance) = match *light {
            Light::Directional { to_light, irradiance } => (to_light.as_dvec3(), irradiance.as_dvec3()),
            Light::Point { position, intensity } => {
                let to_light = position.as_dvec3() - eye - point.position;
                (
                    to_light,
                    intensity.as_dvec3() / to_light.length_squared().max(1e-12),
                )
            }
        };
        let direction = point.frame.tangent_from_world(to_light).try_normalize()?;
        Some(Self {
            direction,
            irradiance,
        })
    }
}
