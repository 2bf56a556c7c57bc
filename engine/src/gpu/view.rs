//! The camera as the shaders read it.

use glam::{DVec3, Mat4, UVec2, Vec2, Vec3};
use scenes::{Camera, Scene};
use shaders::mirror;

/// Fills in what depends on camera and picture. Rays are computed in f64: their differences by pixels are small.
pub(super) fn set_camera(frame: &mut mirror::Frame, camera: &Camera, size: (u32, u32)) {
    let (width, height) = (f64::from(size.0), f64::from(size.1));
    let basis = camera.basis();
    let (right, up, forward): (DVec3, DVec3, DVec3) = (
        basis.right.as_dvec3(),
        basis.up.as_dvec3(),
        basis.forward.as_dvec3(),
    );
    let half = (f64::from(camera.fov_y) * 0.5).tan();
    let ray = |x: f64, y: f64| {
        let across = (2.0 * x / width - 1.0) * half * width / height;
        forward + right * across + up * ((1.0 - 2.0 * y / height) * half)
    };
    let view_from_eye = Mat4::from_mat3(glam::Mat3::from_mat4(camera.view_from_world()));
    frame.clip_from_eye = camera.clip_from_view((width / height) as f32) * view_from_eye;
    frame.eye = camera.eye;
    frame.ray_origin = ray(0.5, 0.5).as_vec3();
    frame.ray_dx = (right * (2.0 * half / height)).as_vec3();
    frame.ray_dy = (up * (-2.0 * half / height)).as_vec3();
    frame.size = UVec2::new(size.0, size.1);
}

/// What depends on the scene alone.
pub(super) fn frame(scene: &Scene) -> mirror::Frame {
    let finite = |color: Vec3| if color.is_finite() { color } else { Vec3::ZERO };
    mirror::Frame {
        light_count: scene.lights.len() as u32,
        ambient: finite(scene.ambient),
        background: finite(scene.background),
        exposure: 1.0,
        feedback_stride: 1,
        page_scale: Vec2::ONE,
        pixel_scale: 1.0,
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_and_projection_agree_with_the_camera() {
        let camera = Camera {
            eye: glam::Vec3::new(1.0, 2.0, 3.0),
            target: glam::Vec3::new(0.0, 0.5, -1.0),
            up: glam::Vec3::Y,
            fov_y: 0.7,
            near: 0.1,
        };
        let mut frame = mirror::Frame::default();
        set_camera(&mut frame, &camera, (640, 360));
        for (x, y) in [(0u16, 0u16), (320, 180), (639, 17)] {
            let ray = frame.ray_origin + frame.ray_dx * f32::from(x) + frame.ray_dy * f32::from(y);
            let wanted = camera.ray(f32::from(x) + 0.5, f32::from(y) + 0.5, (640, 360));
            assert!((ray.normalize() - wanted).length() < 1e-6, "{ray} {wanted}");
            let clip = frame.clip_from_eye * (ray * 3.0).extend(1.0);
            assert!(((clip.x / clip.w * 0.5 + 0.5) * 640.0 - f32::from(x) - 0.5).abs() < 1e-3);
            assert!(((0.5 - clip.y / clip.w * 0.5) * 360.0 - f32::from(y) - 0.5).abs() < 1e-3);
        }
    }
}
