//! A square, a camera, and where each of its rays goes, worked out by hand.

use glam::{Affine3A, DVec3, Vec2, Vec3, Vec4};
use scenes::{Camera, Instance, Material, Mesh, Scene, Surface};
use tileset::Direction;

pub(crate) const WIDTH: u32 = 60;
pub(crate) const HEIGHT: u32 = 40;

/// The square [-1, 1]² in the plane z = 0: u to the right (+x), v downwards (−y), so the bitangent is +y.
pub(crate) fn quad_scene() -> Scene {
    let corners = [
        Vec2::new(-1.0, 1.0),
        Vec2::new(-1.0, -1.0),
        Vec2::new(1.0, -1.0),
        Vec2::new(1.0, 1.0),
    ];
    let mesh = Mesh {
        positions: corners.iter().map(|corner| corner.extend(0.0)).collect(),
        normals: vec![Vec3::Z; 4],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
        uvs: corners
            .iter()
            .map(|corner| Vec2::new(corner.x + 1.0, 1.0 - corner.y) / 2.0)
            .collect(),
        indices: vec![0, 1, 2, 0, 2, 3],
        material: 0,
    };
    let surface = Surface::Btf {
        archive: "x".into(),
        uv_scale: Vec2::ONE,
        uv_offset: Vec2::ZERO,
    };
    Scene {
        meshes: vec![mesh],
        instances: vec![Instance {
            mesh: 0,
            world_from_mesh: Affine3A::IDENTITY,
        }],
        materials: vec![Material {
            name: "x".into(),
            surface,
        }],
        ..Scene::default()
    }
}

/// Askew, and near enough that all pixels look well inside the outermost views.
pub(crate) fn camera() -> Camera {
    Camera {
        eye: Vec3::new(0.4, -0.6, 1.1),
        target: Vec3::new(0.1, 0.05, 0.0),
        up: Vec3::new(0.1, 1.0, 0.2),
        fov_y: 0.7,
        near: 0.01,
    }
}

/// Every pixel sees the plane of the first triangle, whether or not it lies inside.
pub(crate) fn see_all() -> Vec<[u32; 2]> {
    vec![[1, 0]; (WIDTH * HEIGHT) as usize]
}

/// Where the ray of a pixel meets the plane z = 0, and the unit vector from there to the eye.
pub(crate) fn closed_form(x: u32, y: u32) -> (DVec3, DVec3) {
    let Camera {
        eye,
        target,
        up,
        fov_y,
        ..
    } = camera();
    let (eye, target, up) = (eye.as_dvec3(), target.as_dvec3(), up.as_dvec3());
    let forward = (target - eye).normalize();
    let right = forward.cross(up).normalize();
    let up = right.cross(forward);
    let (width, height) = (f64::from(WIDTH), f64::from(HEIGHT));
    let tan = (f64::from(fov_y) / 2.0).tan();
    let across = (2.0 * (f64::from(x) + 0.5) / width - 1.0) * tan * width / height;
    let upwards = (1.0 - 2.0 * (f64::from(y) + 0.5) / height) * tan;
    let ray = forward + right * across + up * upwards;
    (eye - ray * (eye.z / ray.z), -ray.normalize())
}

/// Rings of directions down to 75°.
pub(crate) fn spread() -> Vec<Direction> {
    let ring = |theta: f64, count: u32| {
        (0..count).map(move |i| Direction {
            theta: theta.to_radians(),
            phi: f64::from(i) / f64::from(count) * std::f64::consts::TAU,
        })
    };
    [
        (0.0, 1),
        (15.0, 6),
        (30.0, 12),
        (45.0, 18),
        (60.0, 20),
        (75.0, 24),
    ]
    .into_iter()
    .flat_map(|(theta, count)| ring(theta, count))
    .collect()
}
