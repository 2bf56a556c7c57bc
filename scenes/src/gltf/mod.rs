//! Scenes from glTF 2.0 files (`.gltf` with external or embedded buffers, `.glb`), and scenes written as such.
//!
//! [`load()`] gives the scene alone, [`open`] also says what of the file is not shown, or was mended. [`parse`] does the same with what
//! is in memory.
//!
//! What is read: the default scene's nodes, triangle meshes, materials, perspective cameras, directional and
//! point lights (KHR_lights_punctual), and the extensions `EIGENTILE_materials_btf` and
//! `EIGENTILE_environment`; docs/scenes.md describes them. Textures, skins, morph targets and animations are
//! left out: meshes stand as they are.
//!
//! The JSON types are those of the `gltf` crate; every index, offset and value is checked here, because that
//! crate's own readers panic on files that do not hold what they say.
//!
//! Source: Khronos Group: glTF 2.0 Specification, 2021.

mod accessor;
mod container;
mod geometry;
mod load;
mod look;
mod notes;
#[cfg(test)]
mod tests;
mod write;

pub use load::{Loaded, externals, load, open, parse};
pub use notes::MAX_NOTES;
pub use write::save;

/// Largest accepted size of a scene's files together, bytes.
pub const MAX_BYTES: u64 = 2 << 30;
/// Most vertices and indices of all meshes together.
pub const MAX_ELEMENTS: usize = 1 << 25;
/// Most placed primitives.
pub const MAX_INSTANCES: usize = 1 << 20;

/// Name of the extension of materials that names a BTF.
pub const MATERIAL_EXTENSION: &str = "EIGENTILE_materials_btf";
/// Name of the extension of scenes that gives the surroundings.
pub const ENVIRONMENT_EXTENSION: &str = "EIGENTILE_environment";

/// What to do about meshes in a form that is not read.
const UNPACK: &str =
    "compressed meshes are not read: export the scene without compression, as Blender's exporter can";

/// What is wrong and where, before the file's name is added.
type Detail<T> = std::result::Result<T, String>;
