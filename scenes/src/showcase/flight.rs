//! The flight past the objects: from the overview to close-ups of each material and back.

use glam::Vec3;

use crate::camera_path::Key;
use crate::{Camera, CameraPath};

/// Seconds, eye, target, degrees of view.
type Stop = (f32, [f32; 3], [f32; 3], f32);

const STOPS: [Stop; 7] = [
    (0.0, [0.25, 1.2, 2.75], [0.05, 0.22, -0.1], 36.0),
    (3.0, [-0.75, 0.95, 1.75], [-0.3, 0.28, -0.1], 36.0),
    (5.0, [-0.95, 0.62, 0.72], [-0.52, 0.38, -0.05], 32.0),
    (7.0, [0.15, 0.42, 1.25], [0.2, 0.1, 0.45], 32.0),
    (9.0, [0.95, 0.5, 0.55], [0.78, 0.25, -0.2], 32.0),
    (11.0, [0.9, 0.16, 1.3], [0.35, 0.1, 0.3], 36.0),
    (13.0, [0.25, 1.2, 2.75], [0.05, 0.22, -0.1], 36.0),
];

/// The camera path of the demo: 13 seconds.
pub fn flight() -> CameraPath {
    let key = |(time, eye, target, fov_degrees): Stop| Key {
        time,
        camera: Camera {
            eye: eye.into(),
            target: target.into(),
            up: Vec3::Y,
            fov_y: fov_degrees.to_radians(),
            near: 0.02,
        },
    };
    // The stops above are valid; a test builds them.
    CameraPath::new(STOPS.map(key).to_vec()).unwrap_or_else(|problem| unreachable!("flight: {problem}"))
}

#[cfg(test)]
mod tests {
    #[test]
    fn stays_above_the_ground_and_near_the_objects() {
        for camera in super::flight().frames(200) {
            assert_eq!(camera.problem(), None);
            assert!(camera.eye.y > 0.1 && camera.eye.length() < 4.0, "{}", camera.eye);
        }
    }
}
