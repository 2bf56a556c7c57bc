//! The six scenes of the paper's evaluation, rebuilt with procedural materials.
//!
//! What is taken over: the numbers of triangles and of BTFs (table 2), the resolutions of the BTFs (table 1: 512² for the
//! hundred materials and most objects, 1024² and 2048² for the others), and how they are shown (figures 1 to 5, section
//! 7): tori on a grid, objects on a plane, cylinders, single dense objects. The measured objects themselves are not public;
//! shapes of code stand in for them. All is deterministic.
//!
//! Source: Schwartz, Ruiters, Klein: Level-of-Detail Streaming and Rendering using Bidirectional Sparse Virtual
//! Texture Functions, 2013, section 7.

mod figures;
mod flights;
mod layout;
mod objects;
mod recipe;

use std::path::{Path, PathBuf};

pub use recipe::{PATCHES, Recipe, wear};

use crate::{CameraPath, Result, Scene, Surface, gltf};

/// One of the six scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperScene {
    /// A hundred materials on a grid of tori.
    Tori,
    /// Fifteen objects on a ground.
    Objects,
    /// Four objects with materials of 2048² texels.
    Large,
    /// Five cylinders.
    Cylinders,
    /// One dense object.
    Figure,
    /// One very dense object.
    Dense,
}

impl PaperScene {
    /// All, in the paper's order.
    pub const ALL: [PaperScene; 6] = [
        PaperScene::Tori,
        PaperScene::Objects,
        PaperScene::Large,
        PaperScene::Cylinders,
        PaperScene::Figure,
        PaperScene::Dense,
    ];

    /// Name to ask for it.
    pub fn name(self) -> &'static str {
        match self {
            PaperScene::Tori => "tori",
            PaperScene::Objects => "objects",
            PaperScene::Large => "large",
            PaperScene::Cylinders => "cylinders",
            PaperScene::Figure => "figure",
            PaperScene::Dense => "dense",
        }
    }

    /// What it is, in one line.
    pub fn description(self) -> &'static str {
        match self {
            PaperScene::Tori => "100 materials of 512² on a grid of 10 × 10 tori, 180 thousand triangles",
            PaperScene::Objects => {
                "15 objects on a ground, 15 materials of 512² to 2048², 3.7 million triangles"
            }
            PaperScene::Large => "4 objects with materials of 2048², 2.3 million triangles",
            PaperScene::Cylinders => "5 materials of 512² on cylinders, 4.6 thousand triangles",
            PaperScene::Figure => "a seated figure with a material of 2048², 50 thousand triangles",
            PaperScene::Dense => "a soldier in scale armour, material of 2048², 1.1 million triangles",
        }
    }

    /// The scene of a name.
    pub fn find(name: &str) -> Option<PaperScene> {
        PaperScene::ALL.into_iter().find(|scene| scene.name() == name)
    }

    /// Triangles at full detail, as in the paper's table 2.
    pub fn triangles(self) -> usize {
        match self {
            PaperScene::Tori => 180_000,
            PaperScene::Objects => 3_700_000,
            PaperScene::Large => 2_300_000,
            PaperScene::Cylinders => 4_600,
            PaperScene::Figure => 50_000,
            PaperScene::Dense => 1_100_000,
        }
    }

    /// The materials that it shows, each once.
    pub fn recipes(self) -> Vec<Recipe> {
        recipe::recipes(self)
    }

    /// Builds the scene with `detail` times its triangles; a value from 0.001 to 1.
    pub fn build(self, detail: f32) -> Scene {
        let triangles = self.triangles() as f32 * detail.clamp(0.001, 1.0);
        let mut scene = layout::layout(self, triangles);
        scene.cameras = flights::views(self);
        scene
    }

    /// The recorded flight: from afar, close by, and at grazing angles.
    pub fn flight(self) -> CameraPath {
        flights::flight(self)
    }

    /// Writes `scene.gltf`, `scene.bin` and `camera.json` into a folder; the paths of scene and camera path. `archives` are names
    /// of the materials' archives in the order of [`PaperScene::recipes`], where they have others than these say.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(self, folder: &Path, detail: f32, archives: &[String]) -> Result<(PathBuf, PathBuf)> {
        let (scene_path, camera_path) = (folder.join("scene.gltf"), folder.join("camera.json"));
        let mut scene = self.build(detail);
        // Materials stand in the order of the recipes.
        for (material, name) in scene.materials.iter_mut().zip(archives) {
            if let Surface::Btf { archive, .. } = &mut material.surface {
                (*archive, material.name) = (name.clone(), name.clone());
            }
        }
        gltf::save(&scene, &scene_path)?;
        self.flight().save(&camera_path)?;
        Ok((scene_path, camera_path))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn full_scenes_have_the_papers_triangles_and_drafts_fewer() {
        for scene in [PaperScene::Tori, PaperScene::Cylinders, PaperScene::Figure] {
            let count = scene.build(1.0).triangle_count() as f64 / scene.triangles() as f64;
            assert!((0.97..1.03).contains(&count), "{}: {count}", scene.name());
        }
        for scene in PaperScene::ALL {
            let draft = scene.build(0.02).triangle_count();
            assert!(
                draft * 10 < scene.triangles() || scene.triangles() < 10_000,
                "{}",
                scene.name()
            );
        }
    }

    #[test]
    fn meshes_are_whole_upright_and_turned_outwards() {
        for scene in PaperScene::ALL {
            let built = scene.build(0.03);
            assert_eq!(
                built.archives().len(),
                scene.recipes().len(),
                "{}: each material is shown",
                scene.name()
            );
            for (at, mesh) in built.meshes.iter().enumerate() {
                let (name, count) = (format!("{} mesh {at}", scene.name()), mesh.positions.len());
                assert!(
                    mesh.positions.iter().all(|position| position.is_finite()),
                    "{name}"
                );
                assert_eq!(
                    (mesh.normals.len(), mesh.tangents.len(), mesh.uvs.len()),
                    (count, count, count)
                );
                assert!(
                    mesh.indices.iter().all(|index| (*index as usize) < count),
                    "{name}"
                );
                for (normal, tangent) in mesh.normals.iter().zip(&mesh.tangents) {
                    assert!((normal.length() - 1.0).abs() < 1e-4, "{name}");
                    assert!(normal.dot(tangent.truncate()).abs() < 1e-3, "{name}");
                }
                let mirrored = mesh.tangents.iter().filter(|tangent| tangent.w != 1.0).count();
                assert!(
                    mirrored * 25 <= count,
                    "{name}: {mirrored} of {count} are mirrored"
                );
                let inward = mesh.indices.chunks_exact(3).filter(|corners| {
                    let [a, b, c] = [0, 1, 2].map(|corner| mesh.positions[corners[corner] as usize]);
                    let shading: Vec3 = corners.iter().map(|corner| mesh.normals[*corner as usize]).sum();
                    (b - a).cross(c - a).dot(shading) < 0.0
                });
                let (inward, triangles) = (inward.count(), mesh.indices.len() / 3);
                assert!(
                    inward * 25 <= triangles,
                    "{name}: {inward} of {triangles} face inwards"
                );
            }
        }
    }

    #[test]
    fn flights_are_near_and_far_grazing_and_never_inside() {
        for scene in PaperScene::ALL {
            let (built, flight) = (scene.build(0.05), scene.flight());
            let points: Vec<Vec3> = built
                .instances
                .iter()
                .flat_map(|instance| {
                    let mesh = &built.meshes[instance.mesh];
                    mesh.positions
                        .iter()
                        .map(|position| instance.world_from_mesh.transform_point3(*position))
                })
                .collect();
            let distance = |eye: Vec3| {
                points
                    .iter()
                    .map(|p| p.distance_squared(eye))
                    .fold(f32::MAX, f32::min)
                    .sqrt()
            };
            let (mut nearest, mut lowest) = (f32::MAX, f32::MAX);
            for camera in flight.frames(60) {
                assert_eq!(camera.problem(), None);
                let view = camera.target - camera.eye;
                nearest = nearest.min(distance(camera.eye));
                lowest = lowest.min((-view.y / view.length()).abs());
            }
            let name = scene.name();
            assert!((0.08..0.8).contains(&nearest), "{name}: nearest {nearest}");
            assert!(lowest < 0.25, "{name}: never flatter than a sine of {lowest}");
            assert!(
                built.cameras.len() == 2 && built.cameras.iter().all(|camera| camera.problem().is_none())
            );
        }
    }

    #[test]
    fn the_same_scene_every_time_and_through_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let scene = PaperScene::Large;
        let names = ["a", "b", "c", "d"].map(String::from);
        let (path, _) = scene.save(folder.path(), 0.01, &names).unwrap();
        assert_eq!(gltf::load(&path).unwrap().archives(), ["a", "b", "c", "d"]);
        let (path, camera) = scene.save(folder.path(), 0.01, &[]).unwrap();
        let (built, loaded) = (scene.build(0.01), gltf::load(&path).unwrap());
        assert_eq!(built.meshes.len(), loaded.meshes.len());
        for (built, loaded) in built.meshes.iter().zip(&loaded.meshes) {
            assert!(built.positions == loaded.positions && built.uvs == loaded.uvs);
        }
        assert_eq!((loaded.archives(), loaded.cameras.len()), (built.archives(), 2));
        assert_eq!(
            CameraPath::load(&camera).unwrap().keys().len(),
            scene.flight().keys().len()
        );
        assert!(
            PaperScene::ALL
                .iter()
                .all(|scene| PaperScene::find(scene.name()) == Some(*scene))
        );
        assert_eq!(PaperScene::find("teapot"), None);
    }
}
