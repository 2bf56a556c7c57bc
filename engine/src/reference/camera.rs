//! From pixels to rays.

use glam::DVec3;
use scenes::{Camera, camera::Basis};

/// The rays of a picture.
///
/// Pixel (x, y), row 0 at the top, looks through its middle: along forward + right · (2(x + ½)/W − 1) ·
/// tan(fov/2) · W/H + up · (1 − 2(y + ½)/H) · tan(fov/2), which is not normalized, so that it changes by
/// the same step from pixel to pixel. right = forward × up of the camera, up = right × forward:
/// right-handed, looking along forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rays {
    /// Where all rays begin.
    pub eye: DVec3,
    /// Through the middle of pixel (0, 0).
    pub origin: DVec3,
    /// From a pixel to its right neighbour.
    pub dx: DVec3,
    /// From a pixel to the one below.
    pub dy: DVec3,
}

impl Rays {
    /// The rays of a camera for a picture of `size` pixels.
    pub fn new(camera: &Camera, size: (u32, u32)) -> Self {
        let (forward, right) = axes(camera);
        let up = right.cross(forward);
        let (width, height) = (f64::from(size.0.max(1)), f64::from(size.1.max(1)));
        let half_height = (f64::from(camera.fov_y) / 2.0).tan();
        let half_width = half_height * width / height;
        let dx = right * (2.0 * half_width / width);
        let dy = -up * (2.0 * half_height / height);
        let corner = forward - right * half_width + up * half_height;
        Self {
            eye: camera.eye.as_dvec3(),
            origin: corner + (dx + dy) * 0.5,
            dx,
            dy,
        }
    }

    /// Direction of the ray of a pixel, not normalized.
    pub fn ray(&self, x: u32, y: u32) -> DVec3 {
        self.origin + self.dx * f64::from(x) + self.dy * f64::from(y)
    }
}

/// Forward and right, worked out in f64; where they have no direction as [`Camera::basis`] has it.
fn axes(camera: &Camera) -> (DVec3, DVec3) {
    let Basis { right, forward, .. } = camera.basis();
    let exact_forward = (camera.target.as_dvec3() - camera.eye.as_dvec3()).normalize_or_zero();
    if exact_forward.dot(forward.as_dvec3()) < 0.999 {
        return (forward.as_dvec3(), right.as_dvec3());
    }
    let exact_right = exact_forward.cross(camera.up.as_dvec3()).normalize_or_zero();
    if exact_right.dot(right.as_dvec3()) < 0.999 {
        let right = right.as_dvec3();
        return (
            exact_forward,
            (right - exact_forward * exact_forward.dot(right)).normalize_or_zero(),
        );
    }
    (exact_forward, exact_right)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn camera() -> Camera {
        Camera {
            eye: Vec3::new(1.0, 2.0, 3.0),
            target: Vec3::ZERO,
            up: Vec3::Y,
            fov_y: 0.7,
            near: 0.1,
        }
    }

    #[test]
    fn rays_are_those_of_the_camera() {
        let size = (64, 36);
        let rays = Rays::new(&camera(), size);
        for (x, y) in [(0, 0), (63, 0), (10, 35), (32, 18)] {
            let expected = camera().ray(x as f32 + 0.5, y as f32 + 0.5, size);
            assert!((rays.ray(x, y).normalize().as_vec3() - expected).length() < 1e-6);
        }
    }

    #[test]
    fn odd_cameras_have_finite_rays() {
        let along = Camera {
            up: Vec3::new(1.0, 2.0, 3.0),
            ..camera()
        };
        let nowhere = Camera {
            target: camera().eye,
            ..camera()
        };
        for odd in [along, nowhere] {
            let rays = Rays::new(&odd, (0, 7));
            assert!(rays.ray(3, 3).is_finite() && rays.dx.length() > 0.0 && rays.dy.length() > 0.0);
        }
    }
}
