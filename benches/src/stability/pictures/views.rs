//! Views that are hard to draw.

use glam::{Affine3A, Quat, Vec2, Vec3, Vec4};
use scenes::{Camera, Instance, Light, Mesh, Scene, Shape};

/// Pixels. Odd, so that one has its centre in the middle of the picture.
pub(super) const SIZE: (u32, u32) = (49, 33);

/// A mesh and a camera.
pub(super) struct View {
    /// Its name, for people and scripts.
    pub(super) name: &'static str,
    mesh: Mesh,
    world_from_mesh: Affine3A,
    /// From where it is seen.
    pub(super) camera: Camera,
    /// Whether the reference can tell what is right: not where texture coordinates are beyond the fractions of f32.
    pub(super) compared: bool,
    /// Whether all of it is the very edge of the material.
    pub(super) on_edge: bool,
}

impl View {
    /// Shows this in `scene`, in the material with this index.
    pub(super) fn show(&self, scene: &mut Scene, material: usize) {
        scene.meshes = vec![Mesh {
            material,
            ..self.mesh.clone()
        }];
        scene.instances = vec![Instance {
            mesh: 0,
            world_from_mesh: self.world_from_mesh,
        }];
    }
}

/// The one light: a white surface that faces it has radiance 1.
pub(super) fn light() -> Light {
    Light::Directional {
        to_light: to_light(),
        irradiance: Vec3::splat(std::f32::consts::PI),
    }
}

fn to_light() -> Vec3 {
    Vec3::new(0.3, 0.4, 1.0).normalize()
}

/// All views. The plane is a square of one metre in the plane z = 0 that shows the material once.
pub(super) fn views() -> Vec<View> {
    let facing = Camera {
        eye: Vec3::new(0.0, 0.0, 1.3),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 0.7,
        near: 1e-4,
    };
    let view = |name, shape: Shape, camera| View {
        name,
        mesh: shape.mesh(),
        world_from_mesh: Affine3A::IDENTITY,
        camera,
        compared: true,
        on_edge: false,
    };
    // A pixel in the middle of a picture is so large, a metre away.
    let pixel = 2.0 * (0.5 * facing.fov_y).tan() / SIZE.1 as f32;
    let low = 0.1f32.to_radians();
    let turned = Quat::from_rotation_arc(Vec3::Z, to_light().cross(Vec3::Y).normalize());
    vec![
        view("facing", Shape::Plane, facing),
        View {
            // All pixels within a fiftieth of a texel of 128 across.
            camera: Camera {
                eye: Vec3::new(0.131, 0.077, 0.5),
                target: Vec3::new(0.131, 0.077, 0.0),
                fov_y: SIZE.1 as f32 / (1000.0 * 128.0 * 0.5),
                ..facing
            },
            ..view("magnified 1000 times", Shape::Plane, facing)
        },
        view(
            "minified to one pixel",
            Shape::Plane,
            Camera {
                eye: Vec3::new(0.0, 0.0, 1.0 / pixel),
                ..facing
            },
        ),
        view(
            "grazing, 89.9 degrees",
            Shape::Plane,
            Camera {
                eye: 0.8 * Vec3::new(low.cos(), 0.0, low.sin()),
                up: Vec3::Z,
                ..facing
            },
        ),
        View {
            // The light lies in the plane, up to 0.1 degrees; seen from above.
            world_from_mesh: Affine3A::from_quat(Quat::from_axis_angle(Vec3::Y, low) * turned),
            ..view(
                "lit from the horizon",
                Shape::Plane,
                Camera {
                    eye: 1.3 * (turned * Vec3::Z),
                    ..facing
                },
            )
        },
        view(
            "camera inside",
            Shape::Sphere,
            Camera {
                eye: Vec3::new(0.02, 0.01, 0.0),
                target: Vec3::new(-0.3, 0.1, -1.0),
                fov_y: 2.0,
                ..facing
            },
        ),
        View {
            mesh: no_frames(Shape::Cylinder.mesh()),
            ..view("degenerate frames", Shape::Cylinder, facing)
        },
        View {
            mesh: no_coordinates(Shape::Cylinder.mesh()),
            on_edge: true,
            ..view("degenerate coordinates", Shape::Cylinder, facing)
        },
        View {
            mesh: far_coordinates(Shape::Cylinder.mesh()),
            compared: false,
            ..view("coordinates to 1e38", Shape::Cylinder, facing)
        },
    ]
}

/// Normals and tangents that are none, and triangles without area.
fn no_frames(mut mesh: Mesh) -> Mesh {
    let odd = [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::splat(1e-30)];
    for vertex in 0..mesh.positions.len() {
        let odd = odd[vertex / 3 % odd.len()];
        match vertex % 3 {
            0 => mesh.normals[vertex] = odd,
            1 => mesh.tangents[vertex] = odd.extend(f32::NAN),
            // A tangent along the normal.
            _ => mesh.tangents[vertex] = mesh.normals[vertex].extend(1.0),
        }
    }
    mesh.tangents[0] = Vec4::ZERO;
    let corners = [mesh.indices[0], mesh.indices[1]];
    mesh.indices.extend([
        corners[0], corners[0], corners[1], corners[1], corners[1], corners[1],
    ]);
    mesh
}

/// Texture coordinates that are all one point, or none at all.
fn no_coordinates(mut mesh: Mesh) -> Mesh {
    for (vertex, uv) in mesh.uvs.iter_mut().enumerate() {
        *uv = match vertex % 4 {
            0 => Vec2::new(f32::NAN, 0.3),
            1 => Vec2::new(0.7, f32::NEG_INFINITY),
            _ => Vec2::ZERO,
        };
    }
    mesh
}

/// Texture coordinates without fractions.
fn far_coordinates(mut mesh: Mesh) -> Mesh {
    let far = [1e9, -1e20, 1e38, 3e38];
    for (vertex, uv) in mesh.uvs.iter_mut().enumerate() {
        *uv *= far[vertex % far.len()];
    }
    mesh
}
