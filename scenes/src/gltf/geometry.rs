//! From primitives to meshes: triangles, normals, tangents.

use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::Detail;
use super::accessor::Reader;
use crate::Mesh;

/// The mesh of a primitive, complete; `material` becomes its material.
pub(super) fn mesh(reader: &mut Reader, primitive: &Primitive, material: usize) -> Detail<Mesh> {
    let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
    let positions = attribute(Semantic::Positions).ok_or("has no POSITION")?;
    let positions = reader.floats::<3>(positions, "POSITION")?;
    let normals = attribute(Semantic::Normals)
        .map(|index| reader.floats::<3>(index, "NORMAL"))
        .transpose()?;
    let tangents = attribute(Semantic::Tangents)
        .map(|index| reader.floats::<4>(index, "TANGENT"))
        .transpose()?;
    let uvs = attribute(Semantic::TexCoords(0))
        .map(|index| reader.floats::<2>(index, "TEXCOORD_0"))
        .transpose()?;
    let count = positions.len();
    for (name, length) in [
        ("NORMAL", normals.as_ref().map(Vec::len)),
        ("TANGENT", tangents.as_ref().map(Vec::len)),
        ("TEXCOORD_0", uvs.as_ref().map(Vec::len)),
    ] {
        if length.is_some_and(|length| length != count) {
            return Err(format!(
                "{name} has {} elements, POSITION has {count}",
                length.unwrap_or_default()
            ));
        }
    }
    let corners = match primitive.indices {
        Some(index) => reader.indices(index)?,
        None => (0..u32::try_from(count).map_err(|_| "has too many vertices")?).collect(),
    };
    if let Some(corner) = corners.iter().find(|corner| **corner as usize >= count) {
        return Err(format!(
            "index {corner} is beyond its {count} vertices: export the mesh again"
        ));
    }
    let mut mesh = Mesh {
        positions: positions.into_iter().map(Into::into).collect(),
        uvs: uvs.map_or_else(
            || vec![glam::Vec2::ZERO; count],
            |uvs| uvs.into_iter().map(Into::into).collect(),
        ),
        indices: triangles(&primitive.mode, corners)?,
        material,
        ..Mesh::default()
    };
    let Some(normals) = normals else {
        mesh.compute_flat_normals(); // tangents without normals are to be ignored
        mesh.compute_tangents();
        return Ok(mesh);
    };
    mesh.normals = normals.into_iter().map(glam::Vec3::from).collect();
    if mesh.normals.iter().any(|normal| normal.try_normalize().is_none()) {
        // Zero where a mesh has degenerate corners: those alone are replaced.
        let given = std::mem::take(&mut mesh.normals);
        mesh.compute_smooth_normals();
        for (normal, given) in mesh.normals.iter_mut().zip(given) {
            *normal = given.try_normalize().unwrap_or(*normal);
        }
    } else {
        mesh.normals
            .iter_mut()
            .for_each(|normal| *normal = normal.normalize());
    }
    match tangents {
        Some(tangents) => {
            mesh.tangents = tangents.into_iter().map(Into::into).collect();
            mesh.clean_tangents();
        }
        None => mesh.compute_tangents(),
    }
    Ok(mesh)
}

/// Lists of three corners, from lists, strips or fans (glTF 2.0, section 3.7.2.1). Triangles with two equal
/// corners, which strips use to jump, are left out.
fn triangles(mode: &Checked<Mode>, corners: Vec<u32>) -> Detail<Vec<u32>> {
    let whole = |triangle: &[u32]| {
        triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0]
    };
    match mode {
        Checked::Valid(Mode::Triangles) => {
            if !corners.len().is_multiple_of(3) {
                return Err(format!("{} corners, not a multiple of three", corners.len()));
            }
            Ok(corners
                .chunks_exact(3)
                .filter(|triangle| whole(triangle))
                .flatten()
                .copied()
                .collect())
        }
        Checked::Valid(Mode::TriangleStrip) => {
            let turned = corners.windows(3).enumerate().map(|(at, corner)| match at % 2 {
                0 => [corner[0], corner[1], corner[2]],
                _ => [corner[0], corner[2], corner[1]],
            });
            Ok(turned.filter(|triangle| whole(triangle)).flatten().collect())
        }
        Checked::Valid(Mode::TriangleFan) => {
            let pairs = corners.get(1..).unwrap_or_default().windows(2);
            let turned = pairs.map(|pair| [pair[0], pair[1], corners[0]]);
            Ok(turned.filter(|triangle| whole(triangle)).flatten().collect())
        }
        Checked::Valid(mode) => Err(format!(
            "is drawn as {mode:?}; only triangles, strips and fans are"
        )),
        Checked::Invalid => Err("has an unknown mode".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_become_lists_of_one_winding() {
        let list = |mode, corners: &[u32]| triangles(&Checked::Valid(mode), corners.to_vec());
        assert_eq!(
            list(Mode::TriangleStrip, &[0, 1, 2, 3]).unwrap(),
            [0, 1, 2, 1, 3, 2]
        );
        assert_eq!(list(Mode::TriangleStrip, &[0, 1, 2, 2, 3, 3]).unwrap(), [0, 1, 2]);
        assert_eq!(
            list(Mode::TriangleFan, &[9, 1, 2, 3]).unwrap(),
            [1, 2, 9, 2, 3, 9]
        );
        assert_eq!(list(Mode::Triangles, &[0, 1, 2, 5, 5, 6]).unwrap(), [0, 1, 2]);
        for mode in [Mode::TriangleStrip, Mode::TriangleFan, Mode::Triangles] {
            assert!(list(mode, &[]).unwrap().is_empty());
        }
        assert!(
            list(Mode::Triangles, &[0, 1])
                .unwrap_err()
                .contains("multiple of three")
        );
        assert!(list(Mode::Lines, &[0, 1]).unwrap_err().contains("Lines"));
    }
}
