//! Meshes, instances and lights of a scene as the shaders read them.
//!
//! What is not finite in a mesh ends here: see `finite.wgsl`.

use glam::{Mat3A, Vec3, Vec3A};
use scenes::{Light, Scene};
use shaders::mirror;

use crate::{
    Error, Result,
    gpu::{Context, bind},
};

/// The scene's buffers, and what to draw.
pub(super) struct Geometry {
    pub(super) vertices: wgpu::Buffer,
    pub(super) indices: wgpu::Buffer,
    pub(super) instances: wgpu::Buffer,
    pub(super) lights: wgpu::Buffer,
    /// Corners (three a triangle) of each instance.
    pub(super) draws: Vec<u32>,
}

impl Geometry {
    /// # Errors
    /// [`Error::Scene`] if an index points nowhere or attributes are missing, [`Error::Budget`] beyond the
    /// adapter's buffers.
    pub(super) fn new(context: &Context, scene: &Scene) -> Result<Self> {
        check(scene)?;
        let mut vertices: Vec<mirror::Vertex> = Vec::new();
        let mut indices: Vec<u32> = Vec::new();
        let mut first = Vec::with_capacity(scene.meshes.len());
        for mesh in &scene.meshes {
            first.push((vertices.len() as u32, indices.len() as u32));
            vertices.extend((0..mesh.positions.len()).map(|i| vertex(mesh, i)));
            indices.extend(mesh.indices.chunks_exact(3).flat_map(|corners| {
                let drawn = corners.iter().all(|&i| mesh.positions[i as usize].is_finite());
                // Without area it is not drawn, and keeps its number.
                if drawn {
                    [corners[0], corners[1], corners[2]]
                } else {
                    [corners[0]; 3]
                }
            }));
        }
        let instances: Vec<_> = scene
            .instances
            .iter()
            .map(|placed| instance(scene, placed, first[placed.mesh]))
            .collect();
        let lights: Vec<_> = scene.lights.iter().map(light).collect();
        Ok(Self {
            vertices: bind::storage(context, "vertices", &vertices)?,
            indices: bind::storage(context, "indices", &indices)?,
            instances: bind::storage(context, "instances", &instances)?,
            lights: bind::storage(context, "lights", &lights)?,
            draws: scene
                .instances
                .iter()
                .map(|placed| scene.meshes[placed.mesh].indices.len() as u32)
                .collect(),
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        self.vertices.size() + self.indices.size() + self.instances.size() + self.lights.size()
    }
}

fn vertex(mesh: &scenes::Mesh, i: usize) -> mirror::Vertex {
    let vector = |vector: Vec3| if vector.is_finite() { vector } else { Vec3::ZERO };
    let uv = Some(mesh.uvs[i]).filter(|uv| uv.is_finite()).unwrap_or_default();
    let tangent = Some(mesh.tangents[i]).filter(|tangent| tangent.is_finite());
    mirror::Vertex {
        position: vector(mesh.positions[i]),
        u: uv.x,
        normal: vector(mesh.normals[i]),
        v: uv.y,
        tangent: tangent.unwrap_or_default(),
    }
}

fn instance(
    scene: &Scene,
    placed: &scenes::Instance,
    (first_vertex, first_index): (u32, u32),
) -> mirror::Instance {
    let linear = placed.world_from_mesh.matrix3;
    let rows = linear.transpose();
    let translation = placed.world_from_mesh.translation;
    let determinant = linear.determinant();
    // A flat instance has no normals of its own: its surfaces keep those of the mesh.
    let inverse = if determinant.is_normal() {
        linear.inverse()
    } else {
        Mat3A::IDENTITY
    };
    let row = |axis: Vec3A, offset: f32| axis.extend(offset);
    mirror::Instance {
        world_from_mesh_x: row(rows.x_axis, translation.x),
        world_from_mesh_y: row(rows.y_axis, translation.y),
        world_from_mesh_z: row(rows.z_axis, translation.z),
        // Rows of the inverse transpose are columns of the inverse.
        world_from_normal_x: inverse.x_axis.into(),
        first_index,
        world_from_normal_y: inverse.y_axis.into(),
        first_vertex,
        world_from_normal_z: inverse.z_axis.into(),
        material: scene.meshes[placed.mesh].material as u32,
    }
}

pub(super) fn light(light: &Light) -> mirror::Light {
    let (vector, kind, intensity) = match *light {
        Light::Directional { to_light, irradiance } => (to_light, mirror::DIRECTIONAL, irradiance),
        Light::Point { position, intensity } => (position, mirror::POINT, intensity),
    };
    mirror::Light {
        vector,
        kind,
        intensity,
        pad: 0,
    }
}

fn check(scene: &Scene) -> Result<()> {
    let wrong = |text: String| Err(Error::Scene(text));
    let (mut vertices, mut indices) = (0u64, 0u64);
    for (i, mesh) in scene.meshes.iter().enumerate() {
        let count = mesh.positions.len();
        if [mesh.normals.len(), mesh.tangents.len(), mesh.uvs.len()] != [count; 3] {
            return wrong(format!(
                "mesh {i} has {count} positions, {} normals, {} tangents and {} texture coordinates: as many of each are needed",
                mesh.normals.len(),
                mesh.tangents.len(),
                mesh.uvs.len()
            ));
        }
        if let Some(index) = mesh.indices.iter().find(|&&index| index as usize >= count) {
            return wrong(format!("mesh {i} has an index {index}, but {count} vertices"));
        }
        if !mesh.indices.len().is_multiple_of(3) {
            return wrong(format!(
                "mesh {i} has {} indices, which is no multiple of three",
                mesh.indices.len()
            ));
        }
        if mesh.material >= scene.materials.len() {
            return wrong(format!(
                "mesh {i} names material {}, but there are {}",
                mesh.material,
                scene.materials.len()
            ));
        }
        vertices += count as u64;
        indices += mesh.indices.len() as u64;
    }
    if vertices.max(indices) >= u64::from(u32::MAX) {
        return wrong(format!(
            "{vertices} vertices and {indices} indices are more than 32 bits can name"
        ));
    }
    for (i, placed) in scene.instances.iter().enumerate() {
        if placed.mesh >= scene.meshes.len() {
            return wrong(format!(
                "instance {i} names mesh {}, but there are {}",
                placed.mesh,
                scene.meshes.len()
            ));
        }
        if !placed.world_from_mesh.is_finite() {
            return wrong(format!("instance {i} has a placement that is not finite"));
        }
    }
    Ok(())
}
