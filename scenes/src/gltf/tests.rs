//! Files as other programs write them, and damaged ones.

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::{Loaded, externals, load, open, parse};
use crate::{Error, Light, Scene, Surface};

/// A triangle with indices in 8 bits and texture coordinates in normalized 16 bits, all in one buffer:
/// positions 36 bytes, coordinates 12, indices 3.
fn bytes() -> Vec<u8> {
    let mut bytes: Vec<u8> = Vec::new();
    for value in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        bytes.extend(value.to_le_bytes());
    }
    for value in [0u16, 65535, 65535, 65535, 0, 0] {
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0, 1, 2]);
    bytes
}

fn document() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0], "extensions": { "EIGENTILE_environment": { "ambient": [0.1, 0.2, 0.3] } } }],
        "nodes": [
            { "translation": [1, 2, 3], "children": [1, 2, 3] },
            { "mesh": 0, "scale": [2, 2, 2] },
            { "mesh": 0, "scale": [-1, 1, 1], "camera": 0 },
            { "rotation": [0, 1, 0, 1], "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        ],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "directional", "color": [1, 0.5, 0], "intensity": 4 }] } },
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 },
            { "attributes": { "POSITION": 0 } },
        ] }],
        "materials": [{ "name": "coat", "extensions": { "EIGENTILE_materials_btf": { "archive": "wool", "uvScale": [2, 3] } } }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3 },
            { "bufferView": 1, "componentType": 5123, "type": "VEC2", "count": 3, "normalized": true },
            { "bufferView": 2, "componentType": 5121, "type": "SCALAR", "count": 3 },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 12 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 3 },
        ],
        "buffers": [{ "byteLength": 51, "uri": "tri%61ngle.bin" }],
    })
}

/// Writes the document and its buffer into a new folder.
fn written(document: &Value) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(folder.path().join("triangle.bin"), bytes()).unwrap();
    std::fs::write(&path, document.to_string()).unwrap();
    (folder, path)
}

fn complaint(path: &Path) -> String {
    match load(path) {
        Err(error @ Error::Invalid { .. }) => error.to_string(),
        other => panic!("{other:?}"),
    }
}

fn check(scene: &Scene) {
    assert_eq!(
        (scene.instances.len(), scene.meshes.len()),
        (4, 4),
        "two primitives, and both mirrored"
    );
    let Surface::Btf {
        archive,
        uv_scale,
        uv_offset,
    } = &scene.materials[0].surface
    else {
        panic!()
    };
    assert_eq!(
        (archive.as_str(), *uv_scale, *uv_offset),
        ("wool", Vec2::new(2.0, 3.0), Vec2::ZERO)
    );
    assert!(matches!(
        scene.materials[1].surface,
        Surface::Diffuse { albedo: Vec3::ONE }
    ));
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.uvs, [Vec2::new(0.0, 1.0), Vec2::ONE, Vec2::ZERO]);
    assert!((mesh.tangents[0] - Vec3::X.extend(1.0)).length() < 1e-6 && mesh.normals[2] == Vec3::Z);
    let place = scene.instances[0].world_from_mesh;
    assert_eq!(place.transform_point3(Vec3::X), Vec3::new(3.0, 2.0, 3.0));
    // The mirrored one: the same points, no mirror in its matrix.
    let (mirrored, place) = (
        &scene.meshes[scene.instances[2].mesh],
        scene.instances[2].world_from_mesh,
    );
    assert!(place.matrix3.determinant() > 0.0 && mirrored.tangents[0].w == -1.0);
    assert!((place.transform_point3(mirrored.positions[1]) - Vec3::new(0.0, 2.0, 3.0)).length() < 1e-6);
    let Light::Directional { to_light, irradiance } = scene.lights[0] else {
        panic!()
    };
    assert!((to_light - Vec3::X).length() < 1e-6 && irradiance == Vec3::new(4.0, 2.0, 0.0));
    assert_eq!(
        (scene.ambient, scene.background),
        (Vec3::new(0.1, 0.2, 0.3), Vec3::ZERO)
    );
    assert_eq!(scene.cameras[0].eye, Vec3::new(1.0, 2.0, 3.0));
}

#[test]
fn files_in_memory_are_read_as_those_on_disk() {
    let text = document().to_string();
    assert_eq!(
        externals("scene.gltf", text.as_bytes()).unwrap(),
        ["tri%61ngle.bin"]
    );
    check(&parse("scene.gltf", text.as_bytes(), vec![bytes()]).unwrap().scene);
    let message = |result: Result<Loaded, Error>| result.unwrap_err().to_string();
    assert!(message(parse("scene.gltf", text.as_bytes(), vec![])).contains("was not loaded"));
    assert!(message(parse("a.gltf", text.as_bytes(), vec![vec![0; 50]])).contains("cut short"));
    for uri in [
        "../up.bin",
        "/etc/passwd",
        "http://elsewhere/x.bin",
        "a/../../b.bin",
        "%2e%2e/b",
    ] {
        let mut document = document();
        document["buffers"][0]["uri"] = uri.into();
        let text = document.to_string();
        let error = externals("scene.gltf", text.as_bytes()).unwrap_err();
        assert!(error.to_string().contains("leads out"), "{uri}: {error}");
    }
    assert!(externals("x", b"{}").is_err() && externals("x", b"glTF").is_err());
}

#[test]
fn external_embedded_and_binary_buffers_give_the_same_scene() {
    let (folder, path) = written(&document());
    check(&load(&path).unwrap());

    let mut embedded = document();
    embedded["buffers"][0]["uri"] =
        format!("data:application/octet-stream;base64,{}", base64(&bytes())).into();
    std::fs::remove_file(folder.path().join("triangle.bin")).unwrap();
    std::fs::write(&path, embedded.to_string()).unwrap();
    check(&load(&path).unwrap());

    let mut binary = document();
    binary["buffers"][0].as_object_mut().unwrap().remove("uri");
    let glb = folder.path().join("scene.glb");
    std::fs::write(&glb, container(&binary.to_string(), &bytes())).unwrap();
    check(&load(&glb).unwrap());
}

fn base64(bytes: &[u8]) -> String {
    const SYMBOLS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let symbol = |chunk: &[u8], at: usize| {
        let word =
            chunk.iter().fold(0u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - chunk.len()));
        if at > chunk.len() {
            '='
        } else {
            char::from(SYMBOLS[(word >> (18 - 6 * at) & 63) as usize])
        }
    };
    bytes
        .chunks(3)
        .flat_map(|chunk| (0..4).map(move |at| symbol(chunk, at)))
        .collect()
}

fn container(json: &str, blob: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut blob = blob.to_vec();
    blob.resize(blob.len().next_multiple_of(4), 0);
    let length = (12 + 8 + json.len() + 8 + blob.len()) as u32;
    let words = |words: [u32; 2]| words.map(u32::to_le_bytes).concat();
    [
        b"glTF".to_vec(),
        words([2, length]),
        words([json.len() as u32, 0x4e4f534a]),
        json,
        words([blob.len() as u32, 0x004e4942]),
        blob,
    ]
    .concat()
}

/// Each damage, by the JSON pointer of what is changed, and what the error must say.
#[test]
fn damage_is_named() {
    for (pointer, value, expected) in [
        ("/asset/version", json!("1.0"), "version"),
        ("/scene", json!(4), "scenes[4]"),
        ("/scenes/0/nodes", json!([9]), "nodes[9]"),
        ("/nodes/3/children", json!([0]), "its own ancestor"),
        ("/nodes/1/mesh", json!(7), "meshes[7]"),
        ("/nodes/3/rotation", json!([0, 0, 0, 0]), "quaternion"),
        ("/nodes/0/translation", json!([1e38, 1e38, 3.5e38]), "not"),
        (
            "/nodes/3/extensions/KHR_lights_punctual/light",
            json!(1),
            "no light 1",
        ),
        (
            "/extensions/KHR_lights_punctual/lights/0/intensity",
            json!(-1),
            "not negative",
        ),
        ("/nodes/2/camera", json!(5), "cameras[5]"),
        ("/cameras/0/perspective/yfov", json!(9), "field of view"),
        ("/meshes/0/primitives/0/material", json!(3), "materials[3]"),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(8),
            "no such accessor",
        ),
        ("/meshes/0/primitives/0/attributes", json!({}), "no POSITION"),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(1),
            "expected Vec3",
        ),
        (
            "/materials/0/extensions/EIGENTILE_materials_btf/archive",
            json!("../../etc/passwd"),
            "no name of an archive",
        ),
        (
            "/materials/0/extensions/EIGENTILE_materials_btf/uvScale",
            json!([0, 1]),
            "uvScale",
        ),
        (
            "/materials/0/extensions/EIGENTILE_materials_btf/uvscale",
            json!([1, 1]),
            "uvscale",
        ),
        (
            "/scenes/0/extensions/EIGENTILE_environment/ambient",
            json!([-1, 0, 0]),
            "ambient",
        ),
        ("/accessors/0/count", json!(4), "reach beyond"),
        ("/accessors/0/count", json!(u64::MAX), "elements"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "reach beyond"),
        ("/accessors/0/bufferView", json!(6), "no bufferViews[6]"),
        ("/accessors/0/componentType", json!(5125), "floats"),
        (
            "/accessors/0",
            json!({ "componentType": 5126, "type": "VEC3", "count": 3 }),
            "without compression",
        ),
        (
            "/accessors/0",
            json!({ "componentType": 5126, "type": "VEC3", "count": 1 << 24, "sparse": {
                "count": 1, "indices": { "bufferView": 2, "componentType": 5121 }, "values": { "bufferView": 0 },
            } }),
            "elements without a bufferView",
        ),
        ("/accessors/1/count", json!(2), "POSITION has 3"),
        ("/accessors/2/componentType", json!(5126), "reach beyond"),
        ("/bufferViews/0/byteLength", json!(52), "beyond the 51"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "beyond the 51"),
        ("/bufferViews/0/byteStride", json!(4), "byteStride"),
        ("/bufferViews/2/byteOffset", json!(12), "beyond its 3 vertices"),
        ("/bufferViews/0/buffer", json!(2), "buffers[2]"),
        ("/buffers/0/byteLength", json!(52), "cut short"),
        ("/buffers/0/byteLength", json!(1u64 << 40), "all together"),
        ("/buffers/0/uri", json!("missing.bin"), "missing.bin"),
        ("/buffers/0/uri", json!("/etc/hostname"), "leads out"),
        ("/buffers/0/uri", json!("a/../../b.bin"), "leads out"),
        ("/buffers/0/uri", json!("%2e%2e/b.bin"), "leads out"),
        ("/buffers/0/uri", json!("https://example.org/b.bin"), "leads out"),
        ("/buffers/0/uri", json!("."), "not a regular file"),
    ] {
        let mut damaged = document();
        match damaged.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => {
                let (parent, key) = pointer.rsplit_once('/').unwrap();
                damaged.pointer_mut(parent).unwrap()[key] = value;
            }
        }
        let (_folder, path) = written(&damaged);
        let message = complaint(&path);
        assert!(
            message.contains(expected) && message.contains("scene.gltf"),
            "{pointer}: {message}"
        );
        assert_eq!(message.lines().count(), 1);
    }
    for (extension, advice) in [
        (
            "KHR_draco_mesh_compression",
            "export the scene without compression",
        ),
        ("EXT_meshopt_compression", "export the scene without compression"),
        ("KHR_something_new", "export the scene without it"),
    ] {
        let mut required = document();
        required["extensionsRequired"] = json!([extension]);
        let (_folder, path) = written(&required);
        let message = complaint(&path);
        assert!(
            message.contains(extension) && message.contains(advice),
            "{message}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_link_does_not_lead_out_of_the_folder() {
    let mut linked = document();
    linked["buffers"][0]["uri"] = json!("link.bin");
    let (folder, path) = written(&linked);
    let outside = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(outside.path(), bytes()).unwrap();
    std::os::unix::fs::symlink(outside.path(), folder.path().join("link.bin")).unwrap();
    assert!(complaint(&path).contains("leads out"));
}

#[test]
fn a_triangle_with_a_position_that_is_not_finite_is_left_out() {
    for value in [f32::NAN, f32::INFINITY, -1e30] {
        let (folder, path) = written(&document());
        let mut damaged = bytes();
        damaged[12..16].copy_from_slice(&value.to_le_bytes());
        std::fs::write(folder.path().join("triangle.bin"), damaged).unwrap();
        let Loaded { scene, notes } = open(&path).unwrap();
        assert_eq!(scene.triangle_count(), 0);
        assert_eq!(notes.len(), 2, "one for each primitive: {notes:?}");
        assert!(
            notes[0].starts_with("meshes[0].primitives[0]: 1 positions are not finite"),
            "{notes:?}"
        );
        assert!(
            notes[0].ends_with("1 of its 1 triangles are left out"),
            "{notes:?}"
        );
    }
}

/// What is not drawn is said, and the rest is drawn.
#[test]
fn what_is_left_out_is_noted() {
    for (pointer, value, expected, instances) in [
        (
            "/nodes/1/scale",
            json!([1, 0, 1]),
            "nodes[1]: its scale is zero",
            2,
        ),
        (
            "/extensions/KHR_lights_punctual/lights/0/type",
            json!("spot"),
            "nodes[3]: its spot light is not drawn",
            4,
        ),
        (
            "/meshes/0/primitives/0/mode",
            json!(1),
            "meshes[0].primitives[0]: is drawn as lines",
            2,
        ),
        (
            "/cameras/0",
            json!({ "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 1, "zfar": 9, "znear": 0 } }),
            "nodes[2]: its camera is not perspective",
            4,
        ),
        (
            "/materials/0/alphaMode",
            json!("BLEND"),
            "1 materials are transparent",
            4,
        ),
        (
            "/meshes/0/primitives/0/targets",
            json!([{ "POSITION": 0 }]),
            "1 primitives have morph targets",
            4,
        ),
    ] {
        let mut changed = document();
        match changed.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => {
                let (parent, key) = pointer.rsplit_once('/').unwrap();
                changed.pointer_mut(parent).unwrap()[key] = value;
            }
        }
        let (_folder, path) = written(&changed);
        let Loaded { scene, notes } = open(&path).unwrap();
        assert!(
            notes.iter().any(|note| note.starts_with(expected)),
            "{pointer}: {notes:?}"
        );
        assert_eq!(
            (scene.instances.len(), notes.len()),
            (instances, 1),
            "{pointer}: {notes:?}"
        );
    }
    let (_folder, path) = written(&document());
    assert_eq!(open(&path).unwrap().notes, [""; 0]);
}

#[test]
fn sparse_accessors_are_read() {
    let mut sparse = document();
    // Vertex 2 moves to the place of vertex 1; the indices of the change are those of the triangle.
    sparse["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": { "bufferView": 2, "byteOffset": 2, "componentType": 5121 },
        "values": { "bufferView": 0, "byteOffset": 12 },
    });
    let (_folder, path) = written(&sparse);
    assert_eq!(
        load(&path).unwrap().meshes[0].positions,
        [Vec3::ZERO, Vec3::X, Vec3::X]
    );
    sparse["accessors"][0]["sparse"]["indices"]["bufferView"] = json!(0);
    let (_folder, path) = written(&sparse);
    let scene = load(&path);
    assert!(scene.is_ok(), "byte 2 of the positions is 0: {scene:?}");
    sparse["accessors"][0]["sparse"]["indices"]["byteOffset"] = json!(15);
    let (_folder, path) = written(&sparse);
    assert!(complaint(&path).contains("sparse index 63 is beyond"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Any byte of the JSON or of the buffer may change: a scene or an error, never a panic.
    #[test]
    fn random_damage_never_panics(at in 0usize..4000, byte in any::<u8>(), cut in 0usize..4000, glb in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.gltf");
        let mut json = document();
        if glb {
            json["buffers"][0].as_object_mut().unwrap().remove("uri");
        }
        let mut whole = if glb { container(&json.to_string(), &bytes()) } else { json.to_string().into_bytes() };
        let length = whole.len();
        whole[at % length] = byte;
        if cut < length / 2 {
            whole.truncate(length - cut);
        }
        std::fs::write(folder.path().join("triangle.bin"), bytes()).unwrap();
        std::fs::write(&path, whole).unwrap();
        if let Ok(scene) = load(&path) {
            for mesh in &scene.meshes {
                prop_assert!(mesh.indices.iter().all(|index| (*index as usize) < mesh.positions.len()));
                prop_assert_eq!(mesh.tangents.len(), mesh.positions.len());
            }
        }
    }
}
