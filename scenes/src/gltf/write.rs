//! From a scene to a `.gltf` file and the `.bin` beside it.

use std::path::Path;

use glam::{Mat4, Quat, Vec3};
use serde_json::{Value, json};

use super::{ENVIRONMENT_EXTENSION, MATERIAL_EXTENSION};
use crate::{Camera, Error, Light, Mesh, Result, Scene, Surface, file};

/// Writes a scene as glTF 2.0: JSON to `path` (`NAME.gltf`), numbers to `NAME.bin` beside it.
/// [`super::load()`] gives the same scene again, up to rounding in the directions of lights and cameras.
///
/// # Errors
/// [`Error::Io`]; [`Error::Invalid`] if `path` has no file name in UTF-8.
pub fn save(scene: &Scene, path: &Path) -> Result<()> {
    let stem = path
        .file_stem()
        .and_then(|stem| stem.to_str())
        .filter(|stem| !stem.contains([':', '%', '\\']));
    let stem = stem.ok_or_else(|| Error::Invalid {
        path: path.into(),
        detail: "a scene's file needs a plain name, without : % \\".into(),
    })?;
    let mut binary = Binary::default();
    let meshes: Vec<Value> = scene.meshes.iter().map(|mesh| binary.mesh(mesh)).collect();
    let mut nodes: Vec<Value> = Vec::new();
    for instance in &scene.instances {
        let matrix = Mat4::from(instance.world_from_mesh).to_cols_array();
        nodes.push(json!({ "mesh": instance.mesh, "matrix": matrix }));
    }
    for (index, light) in scene.lights.iter().enumerate() {
        let extensions = json!({ "KHR_lights_punctual": { "light": index } });
        nodes.push(match light {
            Light::Directional { to_light, .. } => {
                let rotation = Quat::from_rotation_arc(Vec3::Z, *to_light).to_array();
                json!({ "rotation": rotation, "extensions": extensions })
            }
            Light::Point { position, .. } => {
                json!({ "translation": position.to_array(), "extensions": extensions })
            }
        });
    }
    for (index, camera) in scene.cameras.iter().enumerate() {
        let basis = camera.basis();
        let matrix = Mat4::from_cols(
            basis.right.extend(0.0),
            basis.up.extend(0.0),
            (-basis.forward).extend(0.0),
            camera.eye.extend(1.0),
        )
        .to_cols_array();
        nodes.push(json!({ "camera": index, "matrix": matrix }));
    }
    let mut document = json!({
        "asset": { "version": "2.0", "generator": concat!("eigentile ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": [MATERIAL_EXTENSION, ENVIRONMENT_EXTENSION, "KHR_lights_punctual"],
        "scene": 0,
        "scenes": [{
            "nodes": (0..nodes.len()).collect::<Vec<_>>(),
            "extensions": { ENVIRONMENT_EXTENSION: {
                "ambient": scene.ambient.to_array(), "background": scene.background.to_array(),
            } },
        }],
        "nodes": nodes,
        "materials": scene.materials.iter().map(|material| look(&material.name, &material.surface)).collect::<Vec<_>>(),
    });
    // glTF allows no empty lists.
    let mut add = |name: &str, list: Vec<Value>| {
        if !list.is_empty() {
            document[name] = list.into();
        }
    };
    add("meshes", meshes);
    add("accessors", std::mem::take(&mut binary.accessors));
    add("bufferViews", std::mem::take(&mut binary.views));
    add("cameras", scene.cameras.iter().map(lens).collect());
    if !binary.bytes.is_empty() {
        add(
            "buffers",
            vec![json!({ "uri": format!("{stem}.bin"), "byteLength": binary.bytes.len() })],
        );
    }
    if !scene.lights.is_empty() {
        let lights: Vec<Value> = scene.lights.iter().map(lamp).collect();
        document["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    }
    let text = serde_json::to_vec(&document).map_err(|error| Error::Invalid {
        path: path.into(),
        detail: error.to_string(),
    })?;
    file::write(&path.with_file_name(format!("{stem}.bin")), &binary.bytes)?;
    file::write(path, &text)
}

fn look(name: &str, surface: &Surface) -> Value {
    match surface {
        Surface::Btf {
            archive,
            uv_scale,
            uv_offset,
        } => json!({
            "name": name,
            "extensions": { MATERIAL_EXTENSION: {
                "archive": archive, "uvScale": uv_scale.to_array(), "uvOffset": uv_offset.to_array(),
            } },
        }),
        Surface::Diffuse { albedo } => json!({
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorFactor": albedo.extend(1.0).to_array(), "metallicFactor": 0.0, "roughnessFactor": 1.0,
            },
        }),
    }
}

fn lamp(light: &Light) -> Value {
    let (kind, strength) = match light {
        Light::Directional { irradiance, .. } => ("directional", irradiance),
        Light::Point { intensity, .. } => ("point", intensity),
    };
    // Colours are at most one; the intensity carries the rest.
    let intensity = strength.max_element();
    let colour = if intensity > 0.0 {
        *strength / intensity
    } else {
        Vec3::ONE
    };
    json!({ "type": kind, "color": colour.to_array(), "intensity": intensity })
}

fn lens(camera: &Camera) -> Value {
    json!({ "type": "perspective", "perspective": { "yfov": camera.fov_y, "znear": camera.near } })
}

/// Numbers behind each other, each list of them its own view and accessor.
#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

/// What glTF calls its types.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

impl Binary {
    fn mesh(&mut self, mesh: &Mesh) -> Value {
        let bounds = (mesh.positions.iter())
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), position| {
                (min.min(*position), max.max(*position))
            });
        let positions = self.floats("VEC3", mesh.positions.iter().map(|position| position.to_array()));
        self.accessors[positions]["min"] = json!(bounds.0.to_array());
        self.accessors[positions]["max"] = json!(bounds.1.to_array());
        let normals = self.floats("VEC3", mesh.normals.iter().map(|normal| normal.to_array()));
        let tangents = self.floats("VEC4", mesh.tangents.iter().map(|tangent| tangent.to_array()));
        let uvs = self.floats("VEC2", mesh.uvs.iter().map(|uv| uv.to_array()));
        let indices = mesh.indices.iter().flat_map(|index| index.to_le_bytes());
        let indices = self.list(
            indices,
            ELEMENT_ARRAY_BUFFER,
            UNSIGNED_INT,
            "SCALAR",
            mesh.indices.len(),
        );
        json!({ "primitives": [{
            "attributes": { "POSITION": positions, "NORMAL": normals, "TANGENT": tangents, "TEXCOORD_0": uvs },
            "indices": indices,
            "material": mesh.material,
        }] })
    }

    fn floats<const N: usize>(
        &mut self,
        kind: &str,
        values: impl ExactSizeIterator<Item = [f32; N]>,
    ) -> usize {
        let count = values.len();
        self.list(
            values.flatten().flat_map(f32::to_le_bytes),
            ARRAY_BUFFER,
            FLOAT,
            kind,
            count,
        )
    }

    fn list(
        &mut self,
        bytes: impl Iterator<Item = u8>,
        target: u32,
        number: u32,
        kind: &str,
        count: usize,
    ) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - start;
        self.views
            .push(json!({ "buffer": 0, "byteOffset": start, "byteLength": length, "target": target }));
        let view = self.views.len() - 1;
        self.accessors
            .push(json!({ "bufferView": view, "componentType": number, "type": kind, "count": count }));
        self.accessors.len() - 1
    }
}
