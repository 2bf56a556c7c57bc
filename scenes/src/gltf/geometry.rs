//! From primitives to meshes: triangles, normals, tangents.

use glam::{Vec2, Vec3};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::Detail;
use super::accessor::Reader;
use crate::Mesh;

/// Positions further out, in the mesh's own units, are as useless as those that are not finite: squares of them leave
/// the range of f32 where they are shaded.
const MAX_POSITION: f32 = 1e15;
/// Texture coordinates further out have no fraction left to look up.
const MAX_UV: f32 = 8_388_608.0;

/// What a primitive is drawn as, if not as triangles.
pub(super) fn undrawn(primitive: &Primitive) -> Option<&'static str> {
    match primitive.mode {
        Checked::Valid(Mode::Points) => Some("points"),
        Checked::Valid(Mode::Lines | Mode::LineLoop | Mode::LineStrip) => Some("lines"),
        _ => None,
    }
}

/// The mesh of a primitive, complete; `material` becomes its material. `note` hears what was mended or left out.
pub(super) fn mesh(
    reader: &mut Reader,
    primitive: &Primitive,
    material: usize,
    note: &mut dyn FnMut(String),
) -> Detail<Mesh> {
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
        normals: normals.map_or_else(Vec::new, |normals| normals.into_iter().map(Into::into).collect()),
        tangents: tangents.map_or_else(Vec::new, |tangents| {
            tangents.into_iter().map(Into::into).collect()
        }),
        uvs: uvs.map_or_else(
            || vec![Vec2::ZERO; count],
            |uvs| uvs.into_iter().map(Into::into).collect(),
        ),
        indices: triangles(&primitive.mode, corners)?,
        material,
    };
    drop_bad_positions(&mut mesh, note);
    mend_uvs(&mut mesh, note);
    if mesh.normals.is_empty() {
        mesh.compute_flat_normals(); // tangents without normals are to be ignored
        mesh.compute_tangents();
    } else {
        mend_normals(&mut mesh, note);
        mend_tangents(&mut mesh, note);
    }
    Ok(mesh)
}

/// Removes triangles with a corner that is nowhere, and vertices that are.
fn drop_bad_positions(mesh: &mut Mesh, note: &mut dyn FnMut(String)) {
    let bad = |position: &Vec3| !(position.abs().max_element() <= MAX_POSITION && position.is_finite());
    let count = mesh.positions.iter().filter(|position| bad(position)).count();
    if count == 0 {
        return;
    }
    let before = mesh.indices.len() / 3;
    // Number of each vertex among those that stay.
    let mut kept = 0u32;
    let stays: Vec<Option<u32>> = mesh
        .positions
        .iter()
        .map(|position| {
            let stays = (!bad(position)).then_some(kept);
            kept += u32::from(stays.is_some());
            stays
        })
        .collect();
    mesh.indices = mesh
        .indices
        .chunks_exact(3)
        .filter_map(|corners| {
            let [a, b, c] = [0, 1, 2].map(|corner| stays[corners[corner] as usize]);
            Some([a?, b?, c?])
        })
        .flatten()
        .collect();
    fn keep<T>(values: &mut Vec<T>, stays: &[Option<u32>]) {
        let mut stays = stays.iter();
        values.retain(|_| stays.next().is_some_and(Option::is_some));
    }
    keep(&mut mesh.positions, &stays);
    keep(&mut mesh.normals, &stays);
    keep(&mut mesh.tangents, &stays);
    keep(&mut mesh.uvs, &stays);
    note(format!(
        "{count} positions are not finite or beyond {MAX_POSITION:e}; {} of its {before} triangles are left out",
        before - mesh.indices.len() / 3
    ));
}

/// Texture coordinates that are no place become (0, 0).
fn mend_uvs(mesh: &mut Mesh, note: &mut dyn FnMut(String)) {
    let bad = |uv: &&mut Vec2| !(uv.abs().max_element() <= MAX_UV && uv.is_finite());
    let count = mesh.uvs.iter_mut().filter(bad).map(|uv| *uv = Vec2::ZERO).count();
    if count > 0 {
        note(format!(
            "{count} texture coordinates are not finite or beyond {MAX_UV}; they are taken as (0, 0)"
        ));
    }
}

/// Unit normals; those that are zero (as at degenerate corners) or not finite become the surface's.
fn mend_normals(mesh: &mut Mesh, note: &mut dyn FnMut(String)) {
    let given = std::mem::take(&mut mesh.normals);
    let unit = |normal: &Vec3| {
        // Divided first, because squares of large finite numbers are not finite.
        (*normal / normal.abs().max_element()).try_normalize()
    };
    let count = given.iter().filter(|normal| unit(normal).is_none()).count();
    if count == 0 {
        mesh.normals = given.iter().filter_map(unit).collect();
        return;
    }
    mesh.compute_smooth_normals();
    for (normal, given) in mesh.normals.iter_mut().zip(&given) {
        *normal = unit(given).unwrap_or(*normal);
    }
    note(format!(
        "{count} normals are zero or not finite; they are computed"
    ));
}

/// Unit tangents at right angles to the normals; all are computed where one is not finite.
fn mend_tangents(mesh: &mut Mesh, note: &mut dyn FnMut(String)) {
    let count = mesh
        .tangents
        .iter()
        .filter(|tangent| !tangent.is_finite())
        .count();
    if count > 0 {
        note(format!(
            "{count} tangents are not finite; all of the mesh are computed"
        ));
    }
    if count > 0 || mesh.tangents.is_empty() {
        mesh.compute_tangents();
    } else {
        mesh.clean_tangents();
    }
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
        Checked::Valid(mode) => Err(format!("is drawn as {mode:?}, not as triangles")),
        Checked::Invalid => Err("has an unknown mode".into()),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::*;

    /// A square of two triangles, and what was said of it after `change`.
    fn mended(change: fn(&mut Mesh)) -> (Mesh, Vec<String>) {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let mut mesh = Mesh {
            positions: corners.iter().map(|[x, y]| Vec3::new(*x, *y, 0.0)).collect(),
            normals: vec![Vec3::Z; 4],
            tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
            uvs: corners.iter().map(|[x, y]| Vec2::new(*x, 1.0 - *y)).collect(),
            indices: vec![0, 1, 2, 0, 2, 3],
            material: 0,
        };
        change(&mut mesh);
        let mut notes = Vec::new();
        let mut note = |what| notes.push(what);
        drop_bad_positions(&mut mesh, &mut note);
        mend_uvs(&mut mesh, &mut note);
        mend_normals(&mut mesh, &mut note);
        mend_tangents(&mut mesh, &mut note);
        let count = mesh.positions.len();
        assert_eq!(
            (mesh.normals.len(), mesh.tangents.len(), mesh.uvs.len()),
            (count, count, count)
        );
        for (normal, tangent) in mesh.normals.iter().zip(&mesh.tangents) {
            assert!((normal.length() - 1.0).abs() < 1e-5 && normal.dot(tangent.truncate()).abs() < 1e-5);
            assert!((tangent.truncate().length() - 1.0).abs() < 1e-5 && tangent.w.abs() == 1.0);
        }
        (mesh, notes)
    }

    #[test]
    fn sound_meshes_stay_as_they_are() {
        let (mesh, notes) = mended(|_| ());
        assert_eq!(
            (mesh.indices.len(), notes.len(), mesh.normals[0]),
            (6, 0, Vec3::Z)
        );
    }

    #[test]
    fn bad_vertices_take_their_triangles_with_them_and_no_others() {
        for value in [f32::NAN, f32::INFINITY, 2e15] {
            let (mesh, notes) = match value {
                v if v.is_nan() => mended(|mesh| mesh.positions[1].y = f32::NAN),
                f32::INFINITY => mended(|mesh| mesh.positions[1].y = f32::INFINITY),
                _ => mended(|mesh| mesh.positions[1].y = 2e15),
            };
            assert_eq!(
                (mesh.positions.len(), mesh.indices.as_slice()),
                (3, &[0, 1, 2][..])
            );
            assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0), Vec3::Y]);
            assert!(
                notes[0].contains("1 positions") && notes[0].contains("1 of its 2 triangles"),
                "{notes:?}"
            );
        }
    }

    #[test]
    fn bad_normals_tangents_and_coordinates_are_replaced() {
        let (mesh, notes) = mended(|mesh| mesh.normals[2] = Vec3::NAN);
        assert_eq!((mesh.normals[2], notes.len()), (Vec3::Z, 1));
        let (mesh, _) = mended(|mesh| mesh.normals = vec![Vec3::new(0.0, 1e38, 1e38); 4]);
        assert!(
            (mesh.normals[0] - Vec3::new(0.0, 0.5f32.sqrt(), 0.5f32.sqrt())).length() < 1e-6,
            "only scaled"
        );
        let (mesh, notes) = mended(|mesh| mesh.tangents[0].y = f32::NEG_INFINITY);
        assert_eq!((mesh.tangents[0].truncate(), notes.len()), (Vec3::X, 1));
        let (mesh, notes) = mended(|mesh| mesh.tangents[0].w = f32::NAN);
        assert_eq!((mesh.tangents[0].w, notes.len()), (1.0, 1));
        let (mesh, notes) = mended(|mesh| (mesh.uvs[1].x, mesh.uvs[2].y) = (f32::NAN, 1e12));
        assert_eq!(
            (mesh.uvs[1], mesh.uvs[2], notes.len()),
            (Vec2::ZERO, Vec2::ZERO, 1)
        );
        assert!(notes[0].contains("2 texture coordinates"), "{notes:?}");
    }

    #[test]
    fn triangles_without_area_stay_and_have_a_frame() {
        let (mesh, notes) = mended(|mesh| {
            mesh.positions.fill(Vec3::ONE);
            mesh.normals.fill(Vec3::ZERO);
            mesh.tangents.clear();
        });
        assert_eq!((mesh.indices.len(), notes.len()), (6, 1));
    }

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
