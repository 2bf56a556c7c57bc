//! Scenes of a few simple shapes.

use glam::{Affine3A, Mat3, Vec2, Vec3, Vec4};
use scenes::{Camera, Instance, Light, Material, Mesh, Scene, Surface};

pub(crate) fn btf(archive: &str, scale: f32) -> Material {
    Material {
        name: archive.into(),
        surface: Surface::Btf {
            archive: archive.into(),
            uv_scale: Vec2::splat(scale),
            uv_offset: Vec2::ZERO,
        },
    }
}

pub(crate) fn diffuse(albedo: [f32; 3]) -> Material {
    Material {
        name: "diffuse".into(),
        surface: Surface::Diffuse {
            albedo: albedo.into(),
        },
    }
}

/// A square of side 2 in the plane y = 0, seen from above; texture coordinates from 0 to 1, v along z.
pub(crate) fn square(material: usize) -> Mesh {
    let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
    Mesh {
        positions: corners.map(|(x, z)| Vec3::new(x, 0.0, z)).to_vec(),
        normals: vec![Vec3::Y; 4],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
        uvs: corners.map(|(x, z)| Vec2::new(x, z) * 0.5 + 0.5).to_vec(),
        indices: vec![0, 1, 2, 0, 2, 3],
        material,
    }
}

/// A sphere of radius 1.
pub(crate) fn sphere(material: usize, columns: u32, rows: u32) -> Mesh {
    let mut mesh = Mesh {
        material,
        ..Default::default()
    };
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
            let (phi, theta) = (u * std::f32::consts::TAU, v * std::f32::consts::PI);
            let normal = Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
            mesh.positions.push(normal);
            mesh.normals.push(normal);
            mesh.tangents.push(Vec4::new(-phi.sin(), 0.0, -phi.cos(), 1.0));
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let c = a + columns + 1;
            mesh.indices.extend([a, c, a + 1, a + 1, c, c + 1]);
        }
    }
    mesh
}

/// A ground and two balls, three materials, three lights.
pub(crate) fn still_life() -> (Scene, Camera) {
    let place = |mesh, scale: f32, at: [f32; 3]| Instance {
        mesh,
        world_from_mesh: Affine3A::from_mat3_translation(Mat3::from_diagonal(Vec3::splat(scale)), at.into()),
    };
    let squeezed = Instance {
        mesh: 2,
        world_from_mesh: Affine3A::from_mat3_translation(
            Mat3::from_rotation_z(0.4) * Mat3::from_diagonal(Vec3::new(0.5, 0.8, 0.5)),
            Vec3::new(0.9, 0.8, -0.2),
        ),
    };
    let scene = Scene {
        meshes: vec![square(0), sphere(1, 48, 24), sphere(2, 48, 24)],
        instances: vec![place(0, 4.0, [0.0; 3]), place(1, 0.8, [-0.9, 0.8, 0.0]), squeezed],
        materials: vec![btf("weave", 4.0), btf("weave", 2.0), diffuse([0.6, 0.3, 0.2])],
        lights: vec![
            Light::Directional {
                to_light: Vec3::new(0.5, 0.8, 0.3).normalize(),
                irradiance: Vec3::new(2.0, 1.9, 1.7),
            },
            Light::Point {
                position: Vec3::new(-1.5, 2.0, 1.5),
                intensity: Vec3::new(2.0, 3.0, 5.0),
            },
            Light::Directional {
                to_light: Vec3::new(-0.9, 0.1, 0.0).normalize(),
                irradiance: Vec3::splat(0.5),
            },
        ],
        ambient: Vec3::new(0.15, 0.2, 0.3),
        background: Vec3::new(0.05, 0.06, 0.08),
        cameras: Vec::new(),
    };
    let camera = Camera {
        eye: Vec3::new(0.0, 2.0, 4.5),
        target: Vec3::new(0.0, 0.6, 0.0),
        up: Vec3::Y,
        fov_y: 0.8,
        near: 0.05,
    };
    (scene, camera)
}
