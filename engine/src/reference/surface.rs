//! What a ray meets: a point of a triangle, with everything that shading needs there.

use glam::{DMat3, DVec2, DVec3};
use scenes::{Mesh, Scene};

use super::{Rays, TangentFrame};

/// A mesh in its place.
pub struct Placed<'a> {
    mesh: &'a Mesh,
    linear: DMat3,
    /// Inverse transpose of `linear`.
    of_normals: DMat3,
    /// From the eye to the origin of the mesh.
    translation: DVec3,
}

/// A point of a surface, seen through a pixel.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// World space, relative to the eye.
    pub position: DVec3,
    /// Tangent frame, on the side that is seen.
    pub frame: TangentFrame,
    /// Texture coordinates of the mesh, and their derivatives by pixels to the right and downwards.
    pub uv: DVec2,
    /// See `uv`.
    pub uv_dx: DVec2,
    /// See `uv`.
    pub uv_dy: DVec2,
}

impl<'a> Placed<'a> {
    /// The instance with this index, if there is one and its mesh.
    pub fn new(scene: &'a Scene, instance: usize, eye: DVec3) -> Option<Self> {
        let instance = scene.instances.get(instance)?;
        let mesh = scene.meshes.get(instance.mesh)?;
        let placement = &instance.world_from_mesh;
        let linear = DMat3::from_cols(
            placement.matrix3.x_axis.as_dvec3(),
            placement.matrix3.y_axis.as_dvec3(),
            placement.matrix3.z_axis.as_dvec3(),
        );
        let of_normals = if linear.determinant() != 0.0 {
            linear.inverse().transpose()
        } else {
            DMat3::ZERO
        };
        Some(Self {
            mesh,
            linear,
            of_normals,
            translation: placement.translation.as_dvec3() - eye,
        })
    }

    /// Where the ray of a pixel meets the plane of a triangle, and how that point moves from pixel to pixel.
    /// `None` for a triangle that the mesh does not have.
    ///
    /// Normals, tangents and texture coordinates that are not finite count as zero.
    ///
    /// Ray against plane after Möller, Trumbore 1997. The derivatives are exact at the pixel. A triangle
    /// seen edge on has no inside: its first corner stands for it, and derivatives are zero.
    pub fn meet(&self, triangle: u32, rays: &Rays, x: u32, y: u32) -> Option<SurfacePoint> {
        let mesh = self.mesh;
        let first = (triangle as usize).checked_mul(3)?;
        let corners = mesh.indices.get(first..first.checked_add(3)?)?;
        let at = |corner: usize| corners[corner] as usize;
        let position = |corner: usize| Some(mesh.positions.get(at(corner))?.as_dvec3());
        let origin = self.linear * position(0)? + self.translation;
        let edge_b = self.linear * (position(1)? - position(0)?);
        let edge_c = self.linear * (position(2)? - position(0)?);
        let (weight_b, weight_c) = (edge_c.cross(origin), origin.cross(edge_b));
        let face_normal = edge_b.cross(edge_c);

        let ray = rays.ray(x, y);
        let facing = ray.dot(face_normal);
        let scale = if facing != 0.0 && facing.recip().is_finite() {
            facing.recip()
        } else {
            0.0
        };
        let bc = DVec2::new(ray.dot(weight_b), ray.dot(weight_c)) * scale;
        let derivative = |step: DVec3| {
            (DVec2::new(step.dot(weight_b), step.dot(weight_c)) - bc * step.dot(face_normal)) * scale
        };

        let weights = [1.0 - bc.x - bc.y, bc.x, bc.y];
        let (mut normal, mut tangent, mut w) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for (corner, weight) in weights.into_iter().enumerate() {
            normal += finite(mesh.normals.get(at(corner))?.as_dvec3()) * weight;
            let vertex_tangent = mesh.tangents.get(at(corner))?.as_dvec4();
            let vertex_tangent = Some(vertex_tangent)
                .filter(|tangent| tangent.is_finite())
                .unwrap_or_default();
            tangent += vertex_tangent.truncate() * weight;
            w += vertex_tangent.w * weight;
        }
        let uv = |corner: usize| {
            let uv = mesh.uvs.get(at(corner))?.as_dvec2();
            Some(if uv.is_finite() { uv } else { DVec2::ZERO })
        };
        let uv_from_bc = |bc: DVec2| Some((uv(1)? - uv(0)?) * bc.x + (uv(2)? - uv(0)?) * bc.y);
        Some(SurfacePoint {
            material: mesh.material,
            position: origin + edge_b * bc.x + edge_c * bc.y,
            frame: TangentFrame::new(
                self.of_normals * normal,
                self.linear * tangent,
                w,
                face_normal,
                facing > 0.0,
            ),
            uv: uv(0)? + uv_from_bc(bc)?,
            uv_dx: uv_from_bc(derivative(rays.dx))?,
            uv_dy: uv_from_bc(derivative(rays.dy))?,
        })
    }
}

fn finite(vector: DVec3) -> DVec3 {
    if vector.is_finite() { vector } else { DVec3::ZERO }
}
