//! Scenes built in code: materials, meshes, and where they stand.

use glam::{Affine3A, Quat, Vec2, Vec3};

use crate::{Instance, Material, Mesh, Scene, Surface};

/// A scene that grows.
#[derive(Default)]
pub(crate) struct Builder {
    pub(crate) scene: Scene,
}

impl Builder {
    /// Adds a material that shows an archive `repeats` times along each unit of texture coordinates; its index.
    pub(crate) fn material(&mut self, archive: &str, repeats: f32) -> usize {
        let name = if repeats == 1.0 {
            archive.into()
        } else {
            format!("{archive} x{repeats}")
        };
        let surface = Surface::Btf {
            archive: archive.into(),
            uv_scale: Vec2::splat(repeats),
            uv_offset: Vec2::ZERO,
        };
        self.scene.materials.push(Material { name, surface });
        self.scene.materials.len() - 1
    }

    /// Adds a mesh of a material, placed.
    pub(crate) fn place(&mut self, mut mesh: Mesh, material: usize, world_from_mesh: Affine3A) {
        mesh.material = material;
        self.scene.meshes.push(mesh);
        self.scene.instances.push(Instance {
            mesh: self.scene.meshes.len() - 1,
            world_from_mesh,
        });
    }
}

/// A place on the ground, turned about the vertical by `turn` radians.
pub(crate) fn at(position: Vec3, turn: f32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_y(turn), position)
}

/// Unit vector at an elevation above the horizon, towards the left (-x) and by an angle to the front (+z).
pub(crate) fn direction(elevation_degrees: f32, front_degrees: f32) -> Vec3 {
    let (elevation, front) = (elevation_degrees.to_radians(), front_degrees.to_radians());
    Vec3::new(
        -elevation.cos() * front.cos(),
        elevation.sin(),
        elevation.cos() * front.sin(),
    )
}
