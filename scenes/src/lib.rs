//! Scenes to draw and materials to draw them with.
//!
//! - [`scene`]: what a picture is made of: meshes, instances, materials, lights.
//! - [`gltf`]: scenes from glTF 2.0 files, and scenes written as such.
//! - [`camera`] and [`camera_path`]: cameras and recorded camera paths.
//! - [`tangents`]: normals and tangents for meshes that lack them.
//! - [`showcase`]: the scene of the demo, built in code and written as glTF.
//! - [`lone`]: one material on a plane, a ball, a roll or a cloth.
//! - [`paper`] (feature `synth`): the six scenes that the paper measures, rebuilt.
//! - [`synth`] (feature `synth`): procedural materials with real meso-geometry, ray traced to BTFs.
//!
//! Nothing here draws: the engine does.

mod builder;
pub mod camera;
pub mod camera_path;
mod error;
mod file;
pub mod gltf;
pub mod lone;
#[cfg(feature = "synth")]
pub mod paper;
pub mod scene;
mod shapes;
pub mod showcase;
#[cfg(feature = "synth")]
pub mod synth;
pub mod tangents;

pub use camera::Camera;
pub use camera_path::CameraPath;
pub use error::{Error, Result};
pub use lone::Shape;
pub use scene::{Instance, Light, Material, Mesh, Scene, Surface};
