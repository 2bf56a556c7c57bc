//! Where a moving camera will be.

use glam::{Mat3, Quat};
use scenes::{Camera, camera::Basis};

/// A turn between two frames that no motion makes: the camera has jumped, or was switched.
const JUMP_RADIANS: f32 = 0.8;
/// Largest turn that is foreseen.
const MOST_RADIANS: f32 = 1.5;

/// The camera `factor` times as far from `now` as `now` is from `before`: velocity and rate of rotation stay what they
/// are, angle and near plane what they are now. `None` where there is no motion, or a jump, or where it would end in a
/// camera that cannot be used.
pub(super) fn extrapolate(before: &Camera, now: &Camera, factor: f32) -> Option<Camera> {
    if (before.eye, before.target, before.up) == (now.eye, now.target, now.up) || factor <= 0.0 {
        return None;
    }
    let orientation = rotation(now);
    let (axis, angle) = shortest(orientation * rotation(before).inverse()).to_axis_angle();
    if angle > JUMP_RADIANS {
        return None;
    }
    let turned = Quat::from_axis_angle(axis, (angle * factor).min(MOST_RADIANS)) * orientation;
    let axes = Mat3::from_quat(turned);
    let eye = now.eye + (now.eye - before.eye) * factor;
    let camera = Camera {
        eye,
        target: eye - axes.z_axis * (now.target - now.eye).length(),
        up: axes.y_axis,
        ..*now
    };
    (camera.problem().is_none()).then_some(camera)
}

/// From view space (x right, y up, z towards the viewer) to the world.
fn rotation(camera: &Camera) -> Quat {
    let Basis { right, up, forward } = camera.basis();
    Quat::from_mat3(&Mat3::from_cols(right, up, -forward)).normalize()
}

/// The same rotation, by at most half a turn.
fn shortest(rotation: Quat) -> Quat {
    if rotation.w < 0.0 { -rotation } else { rotation }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn camera(eye: Vec3, target: Vec3) -> Camera {
        Camera {
            eye,
            target,
            up: Vec3::Y,
            fov_y: 0.8,
            near: 0.1,
        }
    }

    fn assert_near(a: &Camera, b: &Camera) {
        assert!((a.eye - b.eye).length() < 1e-4, "{a:?} {b:?}");
        let (a, b) = (a.basis(), b.basis());
        for (a, b) in [(a.right, b.right), (a.up, b.up), (a.forward, b.forward)] {
            assert!((a - b).length() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn a_flight_goes_straight_on() {
        let at = |t: f32| camera(Vec3::new(t, 2.0, 3.0 * t), Vec3::new(t, 0.0, 3.0 * t - 5.0));
        assert_near(&extrapolate(&at(0.0), &at(0.1), 7.0).unwrap(), &at(0.8));
        assert_eq!(extrapolate(&at(0.0), &at(0.0), 7.0), None);
        assert_eq!(extrapolate(&at(0.0), &at(0.1), 0.0), None);
    }

    #[test]
    fn a_turn_goes_on_turning() {
        let at = |t: f32| {
            let eye = Vec3::new(1.0, 1.0, 1.0);
            camera(eye, eye + Quat::from_rotation_y(t) * Vec3::new(0.0, 0.0, -4.0))
        };
        assert_near(&extrapolate(&at(3.1), &at(3.2), 5.0).unwrap(), &at(3.7));
        // By less than a quarter of a turn, however far ahead.
        let far = extrapolate(&at(0.0), &at(0.1), 1e9).unwrap();
        assert_near(&far, &at(0.1 + MOST_RADIANS));
    }

    #[test]
    fn jumps_and_odd_cameras_lead_nowhere() {
        let (here, there) = (
            camera(Vec3::ZERO, Vec3::Z),
            camera(Vec3::ZERO, Vec3::new(1.0, 0.0, -1.0)),
        );
        assert_eq!(extrapolate(&here, &there, 1.0), None);
        let far = camera(Vec3::splat(1e38), Vec3::new(1e38, 1e38, 0.0));
        assert_eq!(extrapolate(&here, &far, 10.0), None);
        let nan = camera(Vec3::splat(f32::NAN), Vec3::Z);
        assert_eq!(extrapolate(&here, &nan, 1.0), None);
    }
}
