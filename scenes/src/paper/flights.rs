//! The recorded flights, and two still views of each scene: an overview, and one close by at a grazing angle.

use glam::Vec3;

use super::PaperScene;
use crate::camera_path::Key;
use crate::{Camera, CameraPath};

/// Seconds, eye, target.
type Stop = (f32, [f32; 3], [f32; 3]);

/// Vertical field of view, degrees.
const FOV: f32 = 38.0;

const TORI: [Stop; 8] = [
    (0.0, [0.0, 3.4, 5.2], [0.0, -0.2, 0.3]),
    (3.0, [-2.6, 1.6, 3.6], [-1.0, 0.0, 1.0]),
    (5.0, [-1.75, 0.42, 1.65], [-1.25, 0.0, 0.75]),
    (7.0, [0.2, 0.3, 1.3], [0.75, 0.0, 0.25]),
    (9.0, [1.9, 0.3, 0.95], [0.5, 0.05, -1.2]),
    (11.0, [2.9, 0.5, -1.9], [0.2, 0.0, -0.4]),
    (14.0, [0.5, 2.2, -4.6], [0.0, 0.0, 0.0]),
    (18.0, [0.0, 6.5, 7.5], [0.0, 0.0, 0.0]),
];
const OBJECTS: [Stop; 8] = [
    (0.0, [0.1, 1.75, 3.5], [0.05, 0.22, 0.0]),
    (3.0, [-1.9, 0.9, 2.1], [-0.8, 0.25, 0.2]),
    (5.0, [-1.5, 0.42, 1.5], [-0.9, 0.2, 0.55]),
    (7.0, [0.1, 0.3, 1.55], [0.25, 0.18, 0.6]),
    (9.0, [1.5, 0.24, 1.35], [0.6, 0.22, 0.1]),
    (11.0, [2.2, 1.0, 0.2], [0.4, 0.35, -0.3]),
    (14.0, [0.9, 0.9, -2.2], [0.0, 0.4, -0.2]),
    (18.0, [0.3, 3.2, 5.2], [0.0, 0.0, 0.0]),
];
const LARGE: [Stop; 7] = [
    (0.0, [0.05, 0.95, 2.9], [0.03, 0.48, 0.0]),
    (3.0, [-1.5, 0.75, 1.35], [-1.0, 0.5, 0.1]),
    (5.0, [-0.75, 0.8, 0.55], [-0.3, 0.75, -0.3]),
    (7.0, [0.3, 0.6, 0.85], [0.45, 0.3, 0.15]),
    (9.0, [1.05, 0.55, 0.75], [1.2, 0.5, -0.1]),
    (11.0, [2.3, 0.35, 0.0], [0.3, 0.45, 0.0]),
    (15.0, [0.6, 1.4, 4.2], [0.0, 0.45, 0.0]),
];
const CYLINDERS: [Stop; 6] = [
    (0.0, [0.0, 0.75, 1.9], [0.0, 0.29, -0.1]),
    (3.0, [-1.25, 0.5, 0.75], [-0.75, 0.32, -0.3]),
    (5.0, [-0.2, 0.4, 0.62], [0.1, 0.32, 0.0]),
    (7.0, [0.75, 0.68, 0.5], [0.45, 0.6, -0.1]),
    (9.0, [1.75, 0.35, -0.1], [0.2, 0.3, -0.15]),
    (12.0, [0.2, 1.2, 3.2], [0.0, 0.25, -0.1]),
];
const FIGURE: [Stop; 6] = [
    (0.0, [0.35, 0.75, 1.75], [0.0, 0.42, 0.0]),
    (3.0, [-0.7, 0.6, 0.95], [0.0, 0.45, 0.1]),
    (5.0, [-0.15, 0.5, 0.75], [0.0, 0.4, 0.2]),
    (7.0, [0.75, 0.35, 0.4], [0.0, 0.4, 0.15]),
    (9.0, [0.55, 1.0, -0.9], [0.0, 0.5, 0.0]),
    (12.0, [0.9, 1.1, 3.4], [0.0, 0.35, 0.0]),
];
const DENSE: [Stop; 6] = [
    (0.0, [0.55, 1.25, 2.9], [0.0, 0.92, 0.0]),
    (3.0, [-0.7, 1.25, 0.95], [0.0, 1.15, 0.0]),
    (5.0, [-0.12, 1.2, 0.72], [0.02, 1.15, 0.1]),
    (7.0, [0.75, 0.85, 0.25], [0.05, 1.05, 0.1]),
    (9.0, [0.6, 1.7, -1.1], [0.0, 1.3, 0.0]),
    (12.0, [1.2, 1.5, 5.0], [0.0, 0.85, 0.0]),
];

fn stops(scene: PaperScene) -> &'static [Stop] {
    match scene {
        PaperScene::Tori => &TORI,
        PaperScene::Objects => &OBJECTS,
        PaperScene::Large => &LARGE,
        PaperScene::Cylinders => &CYLINDERS,
        PaperScene::Figure => &FIGURE,
        PaperScene::Dense => &DENSE,
    }
}

fn camera((_, eye, target): &Stop) -> Camera {
    Camera {
        eye: Vec3::from(*eye),
        target: Vec3::from(*target),
        up: Vec3::Y,
        fov_y: FOV.to_radians(),
        near: 0.02,
    }
}

pub(super) fn flight(scene: PaperScene) -> CameraPath {
    let key = |stop: &Stop| Key {
        time: stop.0,
        camera: camera(stop),
    };
    // The stops above are valid; a test builds them.
    CameraPath::new(stops(scene).iter().map(key).collect())
        .unwrap_or_else(|problem| unreachable!("{}: {problem}", scene.name()))
}

/// The overview, and the stop at a grazing angle.
pub(super) fn views(scene: PaperScene) -> Vec<Camera> {
    let stops = stops(scene);
    let grazing = match scene {
        PaperScene::Tori | PaperScene::Objects | PaperScene::Large => 3,
        PaperScene::Cylinders | PaperScene::Figure | PaperScene::Dense => 1,
    };
    vec![camera(&stops[0]), camera(&stops[grazing])]
}
