//! Materials, lights, cameras and surroundings.

use glam::{Affine3A, Vec2, Vec3};
use gltf::json::Root;
use gltf::json::camera::Perspective;
use gltf::json::extensions::scene::khr_lights_punctual::{Light as LightForm, Type};
use gltf::json::validation::Checked;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::{Detail, ENVIRONMENT_EXTENSION, MATERIAL_EXTENSION};
use crate::{Camera, Light, Material, Scene, Surface};

/// Longest accepted name of an archive, bytes.
const MAX_NAME: usize = 200;

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
struct BtfForm {
    archive: String,
    #[serde(default = "one")]
    uv_scale: [f32; 2],
    #[serde(default)]
    uv_offset: [f32; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvironmentForm {
    #[serde(default)]
    ambient: [f32; 3],
    #[serde(default)]
    background: [f32; 3],
}

fn one() -> [f32; 2] {
    [1.0; 2]
}

pub(super) fn materials(root: &Root) -> Detail<Vec<Material>> {
    let material = |(at, material): (usize, &gltf::json::Material)| {
        let named = |detail| format!("materials[{at}]: {detail}");
        let name = material.name.clone().unwrap_or_else(|| format!("material {at}"));
        let extension = material
            .extensions
            .as_ref()
            .and_then(|all| all.others.get(MATERIAL_EXTENSION));
        let surface = match extension {
            Some(value) => btf(value).map_err(named)?,
            None => {
                let [red, green, blue, _] = material.pbr_metallic_roughness.base_color_factor.0;
                Surface::Diffuse {
                    albedo: colour("baseColorFactor", [red, green, blue]).map_err(named)?,
                }
            }
        };
        Ok(Material { name, surface })
    };
    root.materials.iter().enumerate().map(material).collect()
}

/// Index of the material of primitives that name none: white and diffuse, behind the file's `count` own ones.
pub(super) fn default_material(count: usize, materials: &mut Vec<Material>) -> usize {
    if materials.len() == count {
        materials.push(Material {
            name: "default".into(),
            surface: Surface::Diffuse { albedo: Vec3::ONE },
        });
    }
    count
}

fn btf(value: &serde_json::Value) -> Detail<Surface> {
    let BtfForm {
        archive,
        uv_scale,
        uv_offset,
    } = parse(MATERIAL_EXTENSION, value)?;
    let plain = |c: char| c.is_alphanumeric() || "-_. ".contains(c);
    let named = !archive.is_empty() && archive.len() <= MAX_NAME && !archive.starts_with('.');
    if !named || !archive.chars().all(plain) {
        return Err(format!(
            "{MATERIAL_EXTENSION}: {archive:?} is no name of an archive: letters, digits, spaces and -_. without extension"
        ));
    }
    let usable = uv_scale.iter().chain(&uv_offset).all(|value| value.is_finite());
    if !usable || uv_scale.contains(&0.0) {
        return Err(format!(
            "{MATERIAL_EXTENSION}: uvScale must be finite and not zero, uvOffset finite"
        ));
    }
    Ok(Surface::Btf {
        archive,
        uv_scale: Vec2::from(uv_scale),
        uv_offset: Vec2::from(uv_offset),
    })
}

pub(super) fn environment(form: &gltf::json::Scene, scene: &mut Scene) -> Detail<()> {
    let extension = form
        .extensions
        .as_ref()
        .and_then(|all| all.others.get(ENVIRONMENT_EXTENSION));
    if let Some(value) = extension {
        let EnvironmentForm { ambient, background } = parse(ENVIRONMENT_EXTENSION, value)?;
        scene.ambient = colour("ambient", ambient)?;
        scene.background = colour("background", background)?;
    }
    Ok(())
}

/// `None` for spot lights, which are not drawn.
pub(super) fn light(form: &LightForm, world_from_node: Affine3A) -> Detail<Option<Light>> {
    let strength = colour("its light", form.color.map(|channel| channel * form.intensity))?;
    match form.type_ {
        Checked::Valid(Type::Directional) => {
            // Shines along -z of the node, whatever its scale.
            let to_light = world_from_node.transform_vector3(Vec3::Z).try_normalize();
            let to_light = to_light.ok_or("its light has no direction: the node's scale is zero")?;
            Ok(Some(Light::Directional {
                to_light,
                irradiance: strength,
            }))
        }
        Checked::Valid(Type::Point) => Ok(Some(Light::Point {
            position: world_from_node.translation.into(),
            intensity: strength,
        })),
        Checked::Valid(Type::Spot) => Ok(None),
        Checked::Invalid => {
            Err("its light has an unknown type: only directional and point lights are drawn".into())
        }
    }
}

/// The target lies along the view at the distance of the middle of the scene, if that is in front.
pub(super) fn camera(form: &Perspective, world: Affine3A, bounds: Option<(Vec3, Vec3)>) -> Detail<Camera> {
    let axis = |axis: Vec3| {
        world
            .transform_vector3(axis)
            .try_normalize()
            .ok_or("its camera has no direction")
    };
    let (forward, up, eye) = (axis(Vec3::NEG_Z)?, axis(Vec3::Y)?, Vec3::from(world.translation));
    let middle = bounds.map_or(eye, |(min, max)| (min + max) * 0.5);
    let ahead = (middle - eye).dot(forward);
    let distance = if ahead.is_finite() && ahead > form.znear {
        ahead
    } else {
        form.znear.max(1.0)
    };
    let camera = Camera {
        eye,
        target: eye + forward * distance,
        up,
        fov_y: form.yfov,
        near: form.znear,
    };
    match camera.problem() {
        Some(problem) => Err(format!("its camera {problem}")),
        None => Ok(camera),
    }
}

fn colour(what: &str, rgb: [f32; 3]) -> Detail<Vec3> {
    match rgb.iter().all(|channel| channel.is_finite() && *channel >= 0.0) {
        true => Ok(rgb.into()),
        false => Err(format!(
            "{what} is {rgb:?}; colours must be finite and not negative"
        )),
    }
}

fn parse<T: DeserializeOwned>(name: &str, value: &serde_json::Value) -> Detail<T> {
    T::deserialize(value).map_err(|error| format!("{name}: {error}; docs/scenes.md gives the format"))
}
