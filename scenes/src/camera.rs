//! A pinhole camera.

use glam::{Mat4, Vec3, Vec4};
use serde::{Deserialize, Serialize};

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Position.
    pub eye: Vec3,
    /// Point in the middle of the picture.
    pub target: Vec3,
    /// Up.
    pub up: Vec3,
    /// Vertical field of view, radians.
    pub fov_y: f32,
    /// Distance of the near plane.
    pub near: f32,
}

/// The axes of a camera in world space: unit vectors, each at right angles to the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basis {
    /// To the right in the picture.
    pub right: Vec3,
    /// Upwards in the picture.
    pub up: Vec3,
    /// Into the picture.
    pub forward: Vec3,
}

impl Camera {
    /// Looks at the middle of a box from the front, a little from above, so that all of it is in a picture of
    /// the ratio width : height = `aspect`.
    pub fn framing(min: Vec3, max: Vec3, aspect: f32) -> Self {
        let fov_y = 40f32.to_radians();
        let centre = (min + max) * 0.5;
        let radius = ((max - min).length() * 0.5).max(1e-3);
        let half_angle = (fov_y * 0.5).min(((fov_y * 0.5).tan() * aspect.max(1e-3)).atan());
        let distance = radius / half_angle.sin();
        let eye = centre + Vec3::new(0.25, 0.45, 1.0).normalize() * distance;
        Self {
            eye,
            target: centre,
            up: Vec3::Y,
            fov_y,
            near: distance * 0.01,
        }
    }

    /// What makes this camera unusable, if anything: values that are not finite, eye and target in one place,
    /// an `up` along the view, an angle outside (0, π), a near plane that is not in front of the eye.
    pub fn problem(&self) -> Option<&'static str> {
        let forward = self.target - self.eye;
        let finite = self.eye.is_finite() && self.target.is_finite() && self.up.is_finite();
        if !finite || !self.fov_y.is_finite() || !self.near.is_finite() {
            Some("has a value that is not finite")
        } else if forward.length() < 1e-6 || !forward.length().is_finite() {
            Some("has eye and target in one place, or too far apart")
        } else if forward.normalize().cross(self.up.normalize_or_zero()).length() < 1e-4 {
            Some("has an up vector that is zero or lies along the view")
        } else if self.fov_y <= 0.0 || self.fov_y >= std::f32::consts::PI {
            Some("has a vertical field of view outside 0 to 180 degrees")
        } else if self.near <= 0.0 {
            Some("has a near plane that is not in front of the eye")
        } else {
            None
        }
    }

    /// The camera's axes. Finite for every camera: where eye and target coincide it looks along -z, and an
    /// `up` along the view is replaced.
    pub fn basis(&self) -> Basis {
        let forward = (self.target - self.eye).try_normalize().unwrap_or(Vec3::NEG_Z);
        let right = forward
            .cross(self.up)
            .try_normalize()
            .unwrap_or_else(|| forward.any_orthonormal_vector());
        Basis {
            right,
            up: right.cross(forward),
            forward,
        }
    }

    /// World to view space: x right, y up, z towards the viewer.
    pub fn view_from_world(&self) -> Mat4 {
        let Basis { right, up, forward } = self.basis();
        let rotation = Mat4::from_cols(
            Vec4::new(right.x, up.x, -forward.x, 0.0),
            Vec4::new(right.y, up.y, -forward.y, 0.0),
            Vec4::new(right.z, up.z, -forward.z, 0.0),
            Vec4::W,
        );
        rotation * Mat4::from_translation(-self.eye)
    }

    /// View to clip space (y up, depth 0 to 1) for a picture of the ratio width : height = `aspect`. Depth is
    /// reversed and without a far plane: near / distance, which spreads the precision of floats evenly.
    pub fn clip_from_view(&self, aspect: f32) -> Mat4 {
        let scale = 1.0 / (self.fov_y * 0.5).tan();
        Mat4::from_cols(
            Vec4::new(scale / aspect, 0.0, 0.0, 0.0),
            Vec4::new(0.0, scale, 0.0, 0.0),
            Vec4::new(0.0, 0.0, 0.0, -1.0),
            Vec4::new(0.0, 0.0, self.near, 0.0),
        )
    }

    /// World to clip space.
    pub fn clip_from_world(&self, aspect: f32) -> Mat4 {
        self.clip_from_view(aspect) * self.view_from_world()
    }

    /// Unit direction through a point of the picture, in pixels from its upper left corner; the middle of the
    /// first pixel is at (0.5, 0.5). `size` is width and height in pixels.
    pub fn ray(&self, x: f32, y: f32, size: (u32, u32)) -> Vec3 {
        let Basis { right, up, forward } = self.basis();
        let (width, height) = (size.0.max(1) as f32, size.1.max(1) as f32);
        let half = (self.fov_y * 0.5).tan();
        let across = (2.0 * x / width - 1.0) * half * width / height;
        let upwards = (1.0 - 2.0 * y / height) * half;
        (forward + right * across + up * upwards).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            eye: Vec3::new(1.0, 2.0, 3.0),
            target: Vec3::new(0.0, 0.5, -1.0),
            up: Vec3::Y,
            fov_y: 0.7,
            near: 0.1,
        }
    }

    #[test]
    fn a_point_on_a_ray_projects_to_the_rays_pixel() {
        let (camera, size) = (camera(), (640, 360));
        for (x, y) in [(0.5, 0.5), (320.0, 180.0), (600.25, 17.0)] {
            let point = camera.eye + camera.ray(x, y, size) * 2.5;
            let clip = camera.clip_from_world(640.0 / 360.0) * point.extend(1.0);
            let (ndc_x, ndc_y) = (clip.x / clip.w, clip.y / clip.w);
            assert!(((ndc_x * 0.5 + 0.5) * 640.0 - x).abs() < 1e-2, "{x} {ndc_x}");
            assert!(((0.5 - ndc_y * 0.5) * 360.0 - y).abs() < 1e-2, "{y} {ndc_y}");
            assert!(clip.z / clip.w > 0.0 && clip.z / clip.w < 1.0);
        }
    }

    #[test]
    fn depth_is_one_at_the_near_plane_and_falls_with_distance() {
        let camera = camera();
        let depth = |distance: f32| {
            let point = camera.eye + camera.basis().forward * distance;
            let clip = camera.clip_from_world(1.0) * point.extend(1.0);
            clip.z / clip.w
        };
        assert!((depth(0.1) - 1.0).abs() < 1e-4);
        assert!((depth(10.0) - 0.01).abs() < 1e-5);
    }

    #[test]
    fn framing_keeps_all_corners_in_the_picture() {
        let (min, max) = (Vec3::new(-1.0, 0.0, -2.0), Vec3::new(3.0, 1.0, 2.0));
        for aspect in [0.5, 1.0, 1.8] {
            let camera = Camera::framing(min, max, aspect);
            assert_eq!(camera.problem(), None);
            for corner in 0..8 {
                let pick = |axis: usize| {
                    if corner >> axis & 1 == 0 {
                        min[axis]
                    } else {
                        max[axis]
                    }
                };
                let clip = camera.clip_from_world(aspect) * Vec4::new(pick(0), pick(1), pick(2), 1.0);
                assert!(
                    clip.x.abs() <= clip.w && clip.y.abs() <= clip.w,
                    "{aspect} {corner}"
                );
            }
        }
    }

    #[test]
    fn odd_cameras_have_a_finite_basis_and_are_named() {
        let along = Camera {
            up: Vec3::new(-1.0, -1.5, -4.0),
            ..camera()
        };
        let nowhere = Camera {
            target: camera().eye,
            ..camera()
        };
        for odd in [along, nowhere] {
            assert!(odd.problem().is_some());
            let Basis { right, up, forward } = odd.basis();
            assert!((right.length() - 1.0).abs() < 1e-5 && (up.length() - 1.0).abs() < 1e-5);
            assert!(forward.dot(up).abs() < 1e-5);
        }
        assert!(
            Camera {
                fov_y: 4.0,
                ..camera()
            }
            .problem()
            .unwrap()
            .contains("field of view")
        );
        assert!(
            Camera {
                near: f32::NAN,
                ..camera()
            }
            .problem()
            .unwrap()
            .contains("finite")
        );
    }
}
