//! Normals and tangents for meshes that lack them.
//!
//! The tangent frame of a BTF is x = tangent, towards growing u; y = w · cross(normal, tangent), towards
//! falling v, which is up in the picture of the material; z = normal. Where texture coordinates run mirrored
//! over a surface, w is -1. Computed in f64, so that no finite mesh overflows.

use glam::{DVec3, Vec3, Vec4};

use crate::Mesh;

/// Two edges in texture space whose angle has a sine below this have no direction of u and v: coordinates
/// in f32 carry 24 bits.
const DEGENERATE: f64 = 1e-7;

impl Mesh {
    /// Replaces the normals by those of the surface, averaged at each vertex by area: smooth shading.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn compute_smooth_normals(&mut self) {
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for corners in self.indices.chunks_exact(3) {
            let normal = self.area_normal(corners);
            for &corner in corners {
                sums[corner as usize] += normal;
            }
        }
        self.normals = sums
            .iter()
            .map(|sum| unit(*sum).unwrap_or(DVec3::Z).as_vec3())
            .collect();
    }

    /// Gives each triangle its own three vertices and its own normal: flat shading, which glTF 2.0 (section
    /// 3.7.2.1) asks for where a mesh has no normals. Tangents are dropped.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn compute_flat_normals(&mut self) {
        let mut flat = Mesh {
            material: self.material,
            ..Mesh::default()
        };
        for corners in self.indices.chunks_exact(3) {
            let normal = unit(self.area_normal(corners)).unwrap_or(DVec3::Z).as_vec3();
            for &corner in corners {
                flat.indices.push(flat.positions.len() as u32);
                flat.positions.push(self.positions[corner as usize]);
                flat.normals.push(normal);
                flat.uvs.push(self.uvs[corner as usize]);
            }
        }
        *self = flat;
    }

    /// Replaces the tangents by the directions of growing u, averaged at each vertex by area. A vertex
    /// between mirrored and unmirrored triangles is doubled. Where the texture coordinates have no
    /// direction, the tangent is some vector in the surface.
    ///
    /// # Panics
    /// If an index is out of range, or normals or texture coordinates are missing.
    pub fn compute_tangents(&mut self) {
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        let mut signs = vec![0.0f32; self.positions.len()];
        // The second copy of each vertex that is on both sides of a mirror line.
        let mut doubles = std::collections::BTreeMap::new();
        for triangle in 0..self.indices.len() / 3 {
            let corners = [0, 1, 2].map(|corner| self.indices[triangle * 3 + corner]);
            let Some((tangent, sign)) = self.u_direction(corners) else {
                continue;
            };
            for (corner, vertex) in corners.into_iter().enumerate() {
                let mut vertex = vertex as usize;
                if signs[vertex] == -sign {
                    vertex = *doubles.entry(vertex).or_insert_with(|| {
                        self.positions.push(self.positions[vertex]);
                        self.normals.push(self.normals[vertex]);
                        self.uvs.push(self.uvs[vertex]);
                        sums.push(DVec3::ZERO);
                        signs.push(sign);
                        self.positions.len() - 1
                    });
                    self.indices[triangle * 3 + corner] = vertex as u32;
                }
                signs[vertex] = sign;
                sums[vertex] += tangent;
            }
        }
        self.tangents = (sums.iter().zip(&signs).zip(&self.normals))
            .map(|((sum, sign), normal)| {
                orthonormal(*sum, *normal).extend(if *sign < 0.0 { -1.0 } else { 1.0 })
            })
            .collect();
    }

    /// Makes given tangents unit vectors at right angles to the normals, and their signs ±1.
    pub(crate) fn clean_tangents(&mut self) {
        for (tangent, normal) in self.tangents.iter_mut().zip(&self.normals) {
            let sign = if tangent.w < 0.0 { -1.0 } else { 1.0 };
            *tangent = orthonormal(tangent.truncate().as_dvec3(), *normal).extend(sign);
        }
    }

    /// The mesh seen in the mirror x → -x, with windings and tangent signs that fit.
    pub(crate) fn mirrored(&self) -> Mesh {
        let flip = |vector: &Vec3| Vec3::new(-vector.x, vector.y, vector.z);
        let swap = |corners: &[u32]| [corners[0], corners[2], corners[1]];
        Mesh {
            positions: self.positions.iter().map(flip).collect(),
            normals: self.normals.iter().map(flip).collect(),
            tangents: self
                .tangents
                .iter()
                .map(|t| Vec4::new(-t.x, t.y, t.z, -t.w))
                .collect(),
            uvs: self.uvs.clone(),
            indices: self.indices.chunks_exact(3).flat_map(swap).collect(),
            material: self.material,
        }
    }

    /// Normal of a triangle, twice its area long.
    fn area_normal(&self, corners: &[u32]) -> DVec3 {
        let [a, b, c] = [0, 1, 2].map(|corner| self.positions[corners[corner] as usize].as_dvec3());
        (b - a).cross(c - a)
    }

    /// Direction of growing u over a triangle, as long as twice its area, and the sign of its frame; `None`
    /// where the triangle or its texture coordinates are degenerate.
    fn u_direction(&self, corners: [u32; 3]) -> Option<(DVec3, f32)> {
        let [a, b, c] = corners.map(|corner| self.positions[corner as usize].as_dvec3());
        let [s, t, r] = corners.map(|corner| self.uvs[corner as usize].as_dvec2());
        let (edge_1, edge_2, uv_1, uv_2) = (b - a, c - a, t - s, r - s);
        let area_uv = uv_1.perp_dot(uv_2);
        let normal = edge_1.cross(edge_2);
        let spread = area_uv.abs() > DEGENERATE * uv_1.length() * uv_2.length();
        if !spread || !normal.is_finite() {
            return None;
        }
        let direction = unit((edge_1 * uv_2.y - edge_2 * uv_1.y) * area_uv.signum())?;
        let shading: Vec3 = corners.iter().map(|corner| self.normals[*corner as usize]).sum();
        let facing = if normal.dot(shading.as_dvec3()) < 0.0 {
            -1.0
        } else {
            1.0
        };
        // With v falling upwards, an unmirrored map of an outward, counter-clockwise triangle runs clockwise.
        let sign = -area_uv.signum() * facing;
        Some((direction * normal.length(), sign as f32))
    }
}

fn unit(vector: DVec3) -> Option<DVec3> {
    // Scaled first: squares of finite f32 values fit f64, but products of them need not.
    let largest = vector.abs().max_element();
    (largest > 0.0 && largest.is_finite()).then(|| (vector / largest).normalize())
}

/// `tangent` made a unit vector at right angles to the unit vector `normal`, or some such vector.
fn orthonormal(tangent: DVec3, normal: Vec3) -> Vec3 {
    let normal = normal.as_dvec3();
    let flat = unit(tangent).map(|tangent| tangent - normal * normal.dot(tangent));
    match flat.filter(|flat| flat.length() > 1e-4) {
        Some(flat) => flat.normalize().as_vec3(),
        None => normal.normalize_or(DVec3::Z).any_orthonormal_vector().as_vec3(),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;

    /// Two triangles over [0, 1]² in the xy plane, seen from +z, the picture upright: v = 0 at the top.
    fn square(uv: fn(Vec2) -> Vec2) -> Mesh {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let mut mesh = Mesh {
            positions: corners.iter().map(|[x, y]| Vec3::new(*x, *y, 0.0)).collect(),
            uvs: corners.iter().map(|[x, y]| uv(Vec2::new(*x, 1.0 - *y))).collect(),
            indices: vec![0, 1, 2, 0, 2, 3],
            ..Mesh::default()
        };
        mesh.compute_smooth_normals();
        mesh.compute_tangents();
        mesh
    }

    fn frame(mesh: &Mesh, vertex: usize) -> (Vec3, Vec3) {
        let tangent = mesh.tangents[vertex];
        (
            tangent.truncate(),
            mesh.normals[vertex].cross(tangent.truncate()) * tangent.w,
        )
    }

    #[test]
    fn upright_turned_and_mirrored_maps_have_the_expected_frames() {
        let upright = square(|uv| uv);
        let mirrored = square(|uv| Vec2::new(1.0 - uv.x, uv.y));
        let turned = square(|uv| Vec2::new(uv.y, -uv.x) * 3.0);
        for vertex in 0..4 {
            assert_eq!(upright.normals[vertex], Vec3::Z);
            assert_eq!(frame(&upright, vertex), (Vec3::X, Vec3::Y));
            assert_eq!(upright.tangents[vertex].w, 1.0);
            assert_eq!(frame(&mirrored, vertex), (-Vec3::X, Vec3::Y));
            assert_eq!(mirrored.tangents[vertex].w, -1.0);
            // u grows downwards; v falls to the right.
            assert_eq!(frame(&turned, vertex), (-Vec3::Y, Vec3::X));
        }
    }

    #[test]
    fn a_mirror_line_doubles_its_vertices() {
        // u runs up to the middle and back again: the line x = 1 is shared.
        let mut mesh = Mesh {
            positions: (0..6)
                .map(|i| Vec3::new((i % 3) as f32, (i / 3) as f32, 0.0))
                .collect(),
            uvs: (0..6)
                .map(|i| Vec2::new([0.0, 1.0, 0.0][i % 3], 1.0 - (i / 3) as f32))
                .collect(),
            indices: vec![0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4],
            ..Mesh::default()
        };
        mesh.compute_smooth_normals();
        mesh.compute_tangents();
        assert_eq!(
            (mesh.positions.len(), mesh.tangents.len(), mesh.uvs.len()),
            (8, 8, 8)
        );
        for (corners, right) in mesh.indices.chunks_exact(3).zip([1.0, 1.0, -1.0, -1.0]) {
            for &corner in corners {
                assert_eq!(frame(&mesh, corner as usize), (Vec3::X * right, Vec3::Y));
            }
        }
    }

    #[test]
    fn degenerate_coordinates_still_give_a_frame() {
        for mesh in [
            square(|_| Vec2::ZERO),
            square(|uv| Vec2::splat(uv.x)),
            square(|_| Vec2::splat(1e30)),
        ] {
            for vertex in 0..4 {
                let (tangent, up) = frame(&mesh, vertex);
                assert!((tangent.length() - 1.0).abs() < 1e-6 && (up.length() - 1.0).abs() < 1e-6);
                assert!(tangent.dot(Vec3::Z).abs() < 1e-6);
            }
        }
        // One good triangle beside one without texture area: the good one decides.
        let mut mesh = square(|uv| uv);
        mesh.uvs[3] = mesh.uvs[2];
        mesh.compute_tangents();
        assert_eq!(frame(&mesh, 0), (Vec3::X, Vec3::Y));
    }

    #[test]
    fn huge_and_flat_meshes_have_unit_normals() {
        let mut mesh = square(|uv| uv);
        mesh.positions.iter_mut().for_each(|position| *position *= 1e37);
        mesh.compute_smooth_normals();
        assert_eq!(mesh.normals[0], Vec3::Z);
        mesh.positions.fill(Vec3::ONE);
        mesh.compute_flat_normals();
        assert_eq!((mesh.positions.len(), mesh.normals[5].length()), (6, 1.0));
    }

    #[test]
    fn the_mirror_image_keeps_windings_and_frames_together() {
        let mirrored = square(|uv| uv).mirrored();
        let corners: Vec<Vec3> = mirrored.indices[..3]
            .iter()
            .map(|i| mirrored.positions[*i as usize])
            .collect();
        assert!(
            (corners[1] - corners[0])
                .cross(corners[2] - corners[0])
                .dot(mirrored.normals[0])
                > 0.0
        );
        assert_eq!(frame(&mirrored, 0), (-Vec3::X, Vec3::Y));
    }
}
