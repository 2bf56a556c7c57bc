//! The scene of the demo, built in code and written as glTF: objects on a ground, a BTF on each, and a
//! flight past them. No number here is random: the same scene every time.

mod drape;
mod flight;
mod surfaces;

use std::path::{Path, PathBuf};

use glam::Vec3;

pub use flight::flight;

use crate::builder::{Builder, at, direction};
use crate::{Camera, Light, Result, Scene, gltf};

/// Archives that the scene names, each also the name of the procedural material that fills it.
pub const ARCHIVES: [&str; 4] = ["cloth", "wool", "leather", "gravel"];

/// Side of the ground, metres, and how often its material repeats over it.
const GROUND_METRES: f32 = 8.0;
const GROUND_REPEATS: f32 = 14.0;

/// Writes `scene.gltf`, `scene.bin` and `camera.json` into a folder; the paths of scene and camera path.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn save(folder: &Path) -> Result<(PathBuf, PathBuf)> {
    let (scene_path, camera_path) = (folder.join("scene.gltf"), folder.join("camera.json"));
    gltf::save(&scene(), &scene_path)?;
    flight().save(&camera_path)?;
    Ok((scene_path, camera_path))
}

/// A cloth over a ball, a knitted knot, a leather cushion and a leather vase on gravel; a warm light from the
/// left, low enough to show relief, and a cool one from behind.
pub fn scene() -> Scene {
    let mut builder = Builder::default();
    let [cloth, wool, leather, gravel] = ARCHIVES.map(|archive| builder.material(archive, 1.0));
    let ground = builder.material(ARCHIVES[3], GROUND_REPEATS);

    builder.place(surfaces::ground(GROUND_METRES), ground, at(Vec3::ZERO, 0.0));
    let draped = at(Vec3::new(-0.55, 0.0, -0.1), 0.0);
    builder.place(drape::cloth(), cloth, draped);
    builder.place(
        surfaces::ball(drape::BALL_CENTRE, drape::BALL_RADIUS),
        leather,
        draped,
    );
    builder.place(surfaces::vase(), leather, at(Vec3::new(0.12, 0.0, -0.85), 0.4));
    builder.place(surfaces::knot(), wool, at(Vec3::new(0.78, 0.0, -0.25), 0.3));
    for part in surfaces::cushion() {
        builder.place(part, leather, at(Vec3::new(0.22, 0.0, 0.52), -0.45));
    }
    for part in surfaces::stone() {
        builder.place(part, gravel, at(Vec3::new(-0.62, 0.0, 0.78), 0.9));
    }

    let mut scene = builder.scene;
    scene.lights = vec![
        // 35 degrees above the horizon, from the left and a little from the front.
        Light::Directional {
            to_light: direction(35.0, 35.0),
            irradiance: Vec3::new(4.6, 4.1, 3.4),
        },
        Light::Point {
            position: Vec3::new(1.3, 1.1, -1.7),
            intensity: Vec3::new(2.2, 2.8, 3.8),
        },
    ];
    scene.ambient = Vec3::new(0.16, 0.18, 0.21);
    scene.background = Vec3::splat(0.02);
    scene.cameras = vec![flight().sample(0.0)];
    scene
}

/// One upright square metre of a material with its middle at the origin, lit by a directional and a point
/// light: the smallest scene that shows everything, for tests.
pub fn swatch(archive: &str) -> Scene {
    let mut builder = Builder::default();
    let material = builder.material(archive, 2.0);
    builder.place(surfaces::square(1.0), material, at(Vec3::ZERO, 0.0));
    let mut scene = builder.scene;
    scene.lights = vec![
        Light::Directional {
            to_light: Vec3::new(-0.5, 0.3, 0.8).normalize(),
            irradiance: Vec3::splat(2.0),
        },
        Light::Point {
            position: Vec3::new(0.6, 0.5, 0.7),
            intensity: Vec3::new(0.9, 0.8, 0.6),
        },
    ];
    scene.ambient = Vec3::splat(0.1);
    scene.background = Vec3::splat(0.02);
    scene.cameras = vec![Camera {
        eye: Vec3::new(0.35, -0.2, 1.5),
        target: Vec3::ZERO,
        up: Vec3::Y,
        fov_y: 0.75,
        near: 0.05,
    }];
    scene
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use super::*;

    /// The cloth takes a second or two to fall.
    static SCENE: LazyLock<Scene> = LazyLock::new(scene);

    #[test]
    fn meshes_are_complete_and_the_scene_has_its_size() {
        let scene = scene();
        assert!(
            (20_000..60_000).contains(&scene.triangle_count()),
            "{}",
            scene.triangle_count()
        );
        assert_eq!(scene.archives().len(), 4);
        for mesh in &scene.meshes {
            let count = mesh.positions.len();
            assert_eq!(
                (mesh.normals.len(), mesh.tangents.len(), mesh.uvs.len()),
                (count, count, count)
            );
            assert!(mesh.indices.iter().all(|index| (*index as usize) < count));
            for (normal, tangent) in mesh.normals.iter().zip(&mesh.tangents) {
                assert!(
                    (normal.length() - 1.0).abs() < 1e-4 && (tangent.truncate().length() - 1.0).abs() < 1e-4
                );
                assert!(normal.dot(tangent.truncate()).abs() < 1e-3);
            }
            // None is mirrored; in the sharpest folds of the cloth some triangles may turn over.
            let mirrored = mesh.tangents.iter().filter(|tangent| tangent.w != 1.0).count();
            assert!(mirrored * 500 <= count, "{mirrored} of {count}");
        }
    }

    #[test]
    fn normals_point_to_the_side_that_windings_call_the_outside() {
        for (at, mesh) in SCENE.meshes.iter().enumerate() {
            let wrong = mesh.indices.chunks_exact(3).filter(|corners| {
                let [a, b, c] = [0, 1, 2].map(|corner| mesh.positions[corners[corner] as usize]);
                let shading: Vec3 = corners.iter().map(|corner| mesh.normals[*corner as usize]).sum();
                (b - a).cross(c - a).dot(shading) < 0.0
            });
            // Folds of the cloth may be sharper than its grid.
            assert!(wrong.count() * 500 <= mesh.indices.len() / 3, "mesh {at}");
        }
    }

    #[test]
    fn objects_stand_on_the_ground() {
        let scene = &*SCENE;
        for instance in &scene.instances[1..] {
            let heights = scene.meshes[instance.mesh].positions.iter();
            let heights = heights.map(|position| instance.world_from_mesh.transform_point3(*position).y);
            let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), y| (low.min(y), high.max(y)));
            assert!(
                low > -0.03 && low < 0.2 && high > 0.04 && high < 1.0,
                "{low} {high}"
            );
        }
    }

    #[test]
    fn the_written_files_hold_the_same_scene() {
        let folder = tempfile::tempdir().unwrap();
        let (scene_path, camera_path) = save(folder.path()).unwrap();
        let (built, loaded) = (&*SCENE, gltf::load(&scene_path).unwrap());
        assert_eq!(loaded.meshes.len(), built.meshes.len());
        for (loaded, built) in loaded.meshes.iter().zip(&built.meshes) {
            assert!(loaded.positions == built.positions && loaded.indices == built.indices);
            assert!(loaded.uvs == built.uvs && loaded.material == built.material);
            for (loaded, built) in loaded.tangents.iter().zip(&built.tangents) {
                assert!((*loaded - *built).length() < 1e-5);
            }
        }
        assert_eq!(
            (loaded.lights.len(), loaded.ambient, loaded.archives()),
            (2, built.ambient, built.archives())
        );
        assert!((loaded.cameras[0].eye - built.cameras[0].eye).length() < 1e-5);
        assert_eq!(
            crate::CameraPath::load(&camera_path).unwrap().keys().len(),
            flight().keys().len()
        );
    }
}
