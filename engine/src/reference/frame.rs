//! The tangent frame of a point of a mesh.

use glam::DVec3;

/// An orthonormal frame in world space, on the side of the surface that is seen.
///
/// With the vertices' normal n and tangent (t, w) interpolated perspective-correctly in the space of the
/// mesh:
///
/// 1. normal N: n by the inverse transpose of the placement, normalized; the triangle's own normal where
///    that is shorter than 1e-12;
/// 2. tangent T: t by the placement, its part across N, normalized; where that is shorter than 1e-12 the part
///    across N of the x axis, or of the y axis if |N.x| > ½;
/// 3. bitangent B: N × T, negated if w < 0;
/// 4. if the triangle is seen from behind, that is if its own normal (edge from the first to the second
///    corner × edge from the first to the third, in world space) points along the ray, N and B are negated
///    and T stays. The frame keeps its handedness and u still runs along T; seen from behind v runs against
///    B, as it does on the back of a sheet.
///
/// The sheet has the same material on both sides. x, y and z of the BTF's tangent space are T, B and N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentFrame {
    /// x: towards growing u.
    pub tangent: DVec3,
    /// y.
    pub bitangent: DVec3,
    /// z: away from the surface, towards the viewer's side.
    pub normal: DVec3,
}

impl TangentFrame {
    /// The frame from vectors in world space, of any length: normal and tangent as interpolated, w, the
    /// triangle's own normal, and whether the triangle is seen from behind.
    pub fn new(normal: DVec3, tangent: DVec3, w: f64, face_normal: DVec3, behind: bool) -> Self {
        let normal = unit(normal, face_normal);
        let tangent = unit(tangent - normal * normal.dot(tangent), across(normal));
        let bitangent = normal.cross(tangent) * if w < 0.0 { -1.0 } else { 1.0 };
        let side = if behind { -1.0 } else { 1.0 };
        Self {
            tangent,
            bitangent: bitangent * side,
            normal: normal * side,
        }
    }

    /// A vector of world space in the frame.
    pub fn tangent_from_world(&self, vector: DVec3) -> DVec3 {
        DVec3::new(
            self.tangent.dot(vector),
            self.bitangent.dot(vector),
            self.normal.dot(vector),
        )
    }
}

/// `vector` made a unit vector, or `other` where it has no direction, or z.
fn unit(vector: DVec3, other: DVec3) -> DVec3 {
    let usable = |vector: &DVec3| vector.length_squared() > 1e-24 && vector.is_finite();
    let other = Some(other.normalize_or_zero()).filter(usable).unwrap_or(DVec3::Z);
    Some(vector).filter(usable).map_or(other, DVec3::normalize)
}

fn across(normal: DVec3) -> DVec3 {
    let axis = if normal.x.abs() > 0.5 { DVec3::Y } else { DVec3::X };
    (axis - normal * normal.dot(axis)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_orthonormal_whatever_comes_in() {
        let odd = [
            DVec3::ZERO,
            DVec3::NAN,
            DVec3::splat(1e-20),
            DVec3::new(0.0, 3.0, 4.0),
            DVec3::X,
        ];
        for normal in odd {
            for tangent in odd {
                for behind in [false, true] {
                    let frame = TangentFrame::new(normal, tangent, -1.0, DVec3::Y, behind);
                    let matrix = glam::DMat3::from_cols(frame.tangent, frame.bitangent, frame.normal);
                    assert!((matrix * matrix.transpose()).abs_diff_eq(glam::DMat3::IDENTITY, 1e-12));
                    assert!(
                        (matrix.determinant() + 1.0).abs() < 1e-12,
                        "w = -1 is left-handed on both sides"
                    );
                }
            }
        }
    }

    #[test]
    fn the_back_is_the_front_turned_about_the_tangent() {
        let front = TangentFrame::new(DVec3::Z, DVec3::X, 1.0, DVec3::Z, false);
        let back = TangentFrame::new(DVec3::Z, DVec3::X, 1.0, DVec3::Z, true);
        assert_eq!(
            front.tangent_from_world(DVec3::new(1.0, 2.0, 3.0)),
            DVec3::new(1.0, 2.0, 3.0)
        );
        assert_eq!(
            back.tangent_from_world(DVec3::new(1.0, 2.0, 3.0)),
            DVec3::new(1.0, -2.0, -3.0)
        );
    }
}
