//! The picture.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
#[cfg(not(target_arch = "wasm32"))]
use rayon::prelude::*;
use scenes::{Camera, Scene, Surface};
use tileset::Pyramid;

use super::{Footprint, Incident, Placed, Rays, Reflectance, SurfacePoint};
use crate::{angular::Triangulation, metrics::Picture};

/// Shades the pixels of a visibility pass.
///
/// `visibility` has `size.0` × `size.1` pixels, row by row from the top: instance + 1 or 0 for none, and
/// the triangle of its mesh. `materials` are by index of the scene's; diffuse ones need none, and a BTF
/// without one is black. Pixels that name what the scene does not have show the background.
pub fn shade(
    scene: &Scene,
    camera: &Camera,
    size: (u32, u32),
    visibility: &[[u32; 2]],
    materials: &[Option<&dyn Reflectance>],
) -> Picture {
    let rays = Rays::new(camera, size);
    let shader = Shader {
        scene,
        placed: (0..scene.instances.len())
            .map(|instance| Placed::new(scene, instance, rays.eye))
            .collect(),
        btfs: materials
            .iter()
            .map(|reflectance| reflectance.and_then(Btf::new))
            .collect(),
        rays,
    };
    let pixel = |at: usize| {
        let (x, y) = ((at % size.0 as usize) as u32, (at / size.0 as usize) as u32);
        let seen = visibility.get(at).copied().unwrap_or([0, 0]);
        shader.radiance(x, y, seen).as_vec3().to_array()
    };
    let count = size.0 as usize * size.1 as usize;
    #[cfg(not(target_arch = "wasm32"))]
    let pixels = (0..count).into_par_iter().with_min_len(16).map(pixel).collect();
    #[cfg(target_arch = "wasm32")]
    let pixels = (0..count).map(pixel).collect();
    Picture {
        width: size.0,
        height: size.1,
        pixels,
    }
}

struct Shader<'a> {
    scene: &'a Scene,
    placed: Vec<Option<Placed<'a>>>,
    btfs: Vec<Option<Btf<'a>>>,
    rays: Rays,
}

/// A BTF and what is worked out once for all its pixels.
struct Btf<'a> {
    reflectance: &'a dyn Reflectance,
    pyramid: Pyramid,
    views: Triangulation,
    lights: Triangulation,
    ambient_weights: Vec<f64>,
}

impl<'a> Btf<'a> {
    fn new(reflectance: &'a dyn Reflectance) -> Option<Self> {
        let (width, height) = reflectance.size();
        if reflectance.views().is_empty() || reflectance.lights().is_empty() {
            return None;
        }
        let lights = Triangulation::new(reflectance.lights());
        Some(Self {
            reflectance,
            pyramid: Pyramid::new(width, height, reflectance.wrap()).ok()?,
            views: Triangulation::new(reflectance.views()),
            ambient_weights: lights.ambient_weights(reflectance.lights(), reflectance.cosine()),
            lights,
        })
    }
}

impl Shader<'_> {
    /// Outgoing radiance of a pixel, linear RGB.
    fn radiance(&self, x: u32, y: u32, [instance, triangle]: [u32; 2]) -> DVec3 {
        let placed = (instance as usize)
            .checked_sub(1)
            .and_then(|instance| self.placed.get(instance)?.as_ref());
        let point = placed.and_then(|placed| placed.meet(triangle, &self.rays, x, y));
        let surface =
            point.and_then(|point| Some((point, &self.scene.materials.get(point.material)?.surface)));
        match surface {
            None => self.scene.background.as_dvec3(),
            Some((point, Surface::Diffuse { albedo })) => self.diffuse(&point, albedo.as_dvec3()),
            Some((
                point,
                Surface::Btf {
                    uv_scale, uv_offset, ..
                },
            )) => {
                let btf = self.btfs.get(point.material).and_then(Option::as_ref);
                btf.map_or(DVec3::ZERO, |btf| {
                    self.btf(&point, btf, uv_scale.as_dvec2(), uv_offset.as_dvec2())
                })
            }
        }
    }

    fn incident<'b>(&'b self, point: &'b SurfacePoint) -> impl Iterator<Item = Incident> + 'b {
        let lights = self.scene.lights.iter();
        lights
            .filter_map(|light| Incident::new(light, point, self.rays.eye))
            .filter(|incident| incident.direction.z > 0.0)
    }

    fn diffuse(&self, point: &SurfacePoint, albedo: DVec3) -> DVec3 {
        let direct: DVec3 = self
            .incident(point)
            .map(|incident| incident.irradiance * incident.direction.z)
            .sum();
        albedo * (self.scene.ambient.as_dvec3() + direct / PI)
    }

    fn btf(&self, point: &SurfacePoint, btf: &Btf, uv_scale: DVec2, uv_offset: DVec2) -> DVec3 {
        let st = point.uv * uv_scale + uv_offset;
        let footprint = Footprint::new(&btf.pyramid, st, point.uv_dx * uv_scale, point.uv_dy * uv_scale);
        // Interpolated normals can turn from the viewer at silhouettes: `taps` takes that for the horizon.
        let views = btf
            .views
            .taps(point.frame.tangent_from_world(-point.position).to_array());
        let cosine = btf.reflectance.cosine();

        let mut radiance = DVec3::ZERO;
        if self.scene.ambient.max_element() > 0.0 {
            let ambient = btf.reflectance.ambient(&footprint, &views, &btf.ambient_weights);
            radiance += self.scene.ambient.as_dvec3() * DVec3::from(ambient);
        }
        for Incident {
            direction,
            irradiance,
        } in self.incident(point)
        {
            let taps = btf.lights.taps(direction.to_array());
            let factor = if cosine {
                taps.horizon_scale(direction.z)
            } else {
                direction.z
            };
            let reflectance = btf.reflectance.interpolate(&footprint, &views, &taps);
            radiance += irradiance * DVec3::from(reflectance) * (factor / PI);
        }
        radiance
    }
}
