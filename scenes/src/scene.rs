//! What a picture is made of.

use glam::{Affine3A, Vec2, Vec3, Vec4};

/// Meshes placed in the world, their materials, and the light on them. Linear RGB, metres.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Triangle meshes, each of one material.
    pub meshes: Vec<Mesh>,
    /// Placed meshes.
    pub instances: Vec<Instance>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Directional and point lights.
    pub lights: Vec<Light>,
    /// Radiance of the uniform surroundings.
    pub ambient: Vec3,
    /// Radiance where nothing is hit.
    pub background: Vec3,
    /// Cameras that came with the scene.
    pub cameras: Vec<crate::Camera>,
}

/// An indexed triangle mesh with a tangent frame and texture coordinates at each vertex.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Positions.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents, and in w the sign of the bitangent: w · cross(normal, tangent), as in glTF.
    pub tangents: Vec<Vec4>,
    /// Texture coordinates; (0, 0) is the upper left corner of a material, one unit its whole width.
    pub uvs: Vec<Vec2>,
    /// Three a triangle, counter-clockwise seen from outside.
    pub indices: Vec<u32>,
    /// Index into [`Scene::materials`].
    pub material: usize,
}

/// A mesh placed in the world.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// Placement, without mirroring: the determinant is positive. Loaded scenes hold to it by mirroring the
    /// mesh instead, so that windings and tangent frames stay what they say.
    pub world_from_mesh: Affine3A,
}

/// A named surface.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// How it reflects.
    pub surface: Surface,
}

/// How a material reflects.
#[derive(Clone, Debug)]
pub enum Surface {
    /// A BTF, streamed from an archive.
    Btf {
        /// Name of the archive in its collection, without extension.
        archive: String,
        /// Repeats of the material over one unit of texture coordinates.
        uv_scale: Vec2,
        /// Offset added after scaling.
        uv_offset: Vec2,
    },
    /// A constant diffuse reflectance.
    Diffuse {
        /// Albedo, linear RGB.
        albedo: Vec3,
    },
}

/// A light source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// Infinitely far away.
    Directional {
        /// Unit vector towards the light.
        to_light: Vec3,
        /// Irradiance on a surface that faces the light.
        irradiance: Vec3,
    },
    /// At a point.
    Point {
        /// Position.
        position: Vec3,
        /// Radiant intensity: irradiance at distance d is intensity / d².
        intensity: Vec3,
    },
}

impl Scene {
    /// Corners of the box around all instances, in world space; `None` for a scene without a vertex.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let points = self.instances.iter().flat_map(|instance| {
            let positions = self
                .meshes
                .get(instance.mesh)
                .map_or(&[][..], |mesh| &mesh.positions);
            positions
                .iter()
                .map(|position| instance.world_from_mesh.transform_point3(*position))
        });
        points.fold(None, |bounds, point| match bounds {
            None => Some((point, point)),
            Some((min, max)) => Some((min.min(point), max.max(point))),
        })
    }

    /// Triangles of all instances.
    pub fn triangle_count(&self) -> usize {
        let of = |instance: &Instance| {
            self.meshes
                .get(instance.mesh)
                .map_or(0, |mesh| mesh.indices.len() / 3)
        };
        self.instances.iter().map(of).sum()
    }

    /// Names of the archives that the materials name, sorted, each once.
    pub fn archives(&self) -> Vec<&str> {
        let names = self
            .materials
            .iter()
            .filter_map(|material| match &material.surface {
                Surface::Btf { archive, .. } => Some(archive.as_str()),
                Surface::Diffuse { .. } => None,
            });
        names
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .collect()
    }
}
