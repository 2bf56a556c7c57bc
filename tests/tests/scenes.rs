//! Scenes from elsewhere and the paper's are drawn as they are meant.

use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;

use engine::frame::{Budgets, Engine, Options};
use engine::gpu::Context;
use engine::metrics::Picture;
use engine::stream::MemorySource;
use scenes::gltf::{Loaded, open};
use scenes::paper::PaperScene;
use scenes::{Camera, Scene, showcase};
use serde_json::{Value, json};
use tests::Fixture;

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);
/// No adapter is a failure, not a reason to skip.
static CONTEXT: LazyLock<Context> = LazyLock::new(|| Context::headless().expect("a graphics adapter"));

const SIZE: (u32, u32) = (128, 96);
const LIMIT: Duration = Duration::from_secs(120);

/// The settled picture; every archive that the scene names is the fixture's leather.
fn picture(scene: &Scene, camera: &Camera) -> Picture {
    let leather = std::fs::read(FIXTURE.archive("leather")).unwrap();
    let mut source = MemorySource::new();
    for name in scene.archives() {
        source.insert(name, leather.clone()).unwrap();
    }
    let options = Options {
        size: SIZE,
        budgets: Budgets {
            page_cache_bytes: 32 << 20,
            column_cache_bytes: 8 << 20,
            ..Budgets::default()
        },
        ..Options::default()
    };
    let mut engine = Engine::new(CONTEXT.clone(), scene, Box::new(source), options).unwrap();
    engine.wait_for_materials(LIMIT).unwrap();
    assert!(engine.settle(camera, LIMIT).unwrap().last().unwrap().settled);
    let picture = engine.picture().unwrap();
    assert!(
        picture.pixels.iter().flatten().all(|value| value.is_finite()),
        "a pixel is not finite"
    );
    picture
}

/// One primitive in a file of its own, its numbers in one buffer.
#[derive(Default)]
struct Model {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    node: Value,
    mode: u32,
}

impl Model {
    fn list(
        &mut self,
        kind: &str,
        component: u32,
        count: usize,
        normalized: bool,
        bytes: impl IntoIterator<Item = u8>,
    ) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let start = self.bytes.len();
        self.bytes.extend(bytes);
        self.views
            .push(json!({ "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start }));
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": component, "type": kind, "count": count,
            "normalized": normalized,
        }));
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, kind: &str, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values
            .iter()
            .flatten()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        self.list(kind, 5126, values.len(), false, bytes)
    }

    /// Loads it, with the lights of the swatch.
    fn load(self, folder: &Path, attributes: Value, indices: usize) -> Loaded {
        let document = json!({
            "asset": { "version": "2.0" },
            "scenes": [{ "nodes": [0] }],
            "nodes": [self.node],
            "meshes": [{ "primitives": [
                { "attributes": attributes, "indices": indices, "material": 0, "mode": self.mode },
            ] }],
            "materials": [{ "extensions": { "EIGENTILE_materials_btf": { "archive": "leather" } } }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.bytes.len(), "uri": "model.bin" }],
        });
        std::fs::write(folder.join("model.bin"), &self.bytes).unwrap();
        std::fs::write(folder.join("model.gltf"), document.to_string()).unwrap();
        let mut loaded = open(&folder.join("model.gltf")).unwrap();
        let swatch = showcase::swatch("leather");
        loaded.scene.lights = swatch.lights;
        (loaded.scene.ambient, loaded.scene.background) = (swatch.ambient, swatch.background);
        loaded
    }
}

const SQUARE: [[f32; 3]; 4] = [
    [-0.5, -0.5, 0.0],
    [0.5, -0.5, 0.0],
    [0.5, 0.5, 0.0],
    [-0.5, 0.5, 0.0],
];
const UPRIGHT: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

fn plain(folder: &Path) -> Scene {
    let mut model = Model {
        node: json!({ "mesh": 0 }),
        mode: 4,
        ..Model::default()
    };
    let positions = model.floats("VEC3", &SQUARE);
    let normals = model.floats("VEC3", &[[0.0, 0.0, 1.0]; 4]);
    let tangents = model.floats("VEC4", &[[1.0, 0.0, 0.0, 1.0]; 4]);
    let uvs = model.floats("VEC2", &UPRIGHT);
    let indices = model.list("SCALAR", 5121, 6, false, [0, 1, 2, 0, 2, 3]);
    let attributes =
        json!({ "POSITION": positions, "NORMAL": normals, "TANGENT": tangents, "TEXCOORD_0": uvs });
    let Loaded { scene, notes } = model.load(folder, attributes, indices);
    assert!(notes.is_empty(), "{notes:?}");
    scene
}

/// A strip without normals and tangents, coordinates in 16 bits, indices in 16 bits, quantized positions, and a triangle
/// with a corner that is not a number.
fn sparse_and_broken(folder: &Path) -> Scene {
    let mut model = Model {
        node: json!({ "mesh": 0, "translation": [-0.5, -0.5, 0.0] }),
        mode: 5,
        ..Model::default()
    };
    let corners = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [f32::NAN, 0.2, 0.1],
    ];
    let positions = model.floats("VEC3", &corners);
    let coordinates = [0u16, 65535, 65535, 65535, 0, 0, 65535, 0, 9, 9]
        .map(u16::to_le_bytes)
        .concat();
    let uvs = model.list("VEC2", 5123, 5, true, coordinates);
    let indices = model.list(
        "SCALAR",
        5123,
        5,
        false,
        [0u16, 1, 2, 3, 4].map(u16::to_le_bytes).concat(),
    );
    let Loaded { scene, notes } = model.load(
        folder,
        json!({ "POSITION": positions, "TEXCOORD_0": uvs }),
        indices,
    );
    assert_eq!(notes.len(), 1);
    assert!(
        notes[0].contains("1 of its 3 triangles are left out"),
        "{notes:?}"
    );
    scene
}

/// Drawn in the mirror: the mesh's coordinates run mirrored, and the node mirrors it back; bad normals and tangents.
fn mirrored(folder: &Path) -> Scene {
    let mut model = Model {
        node: json!({ "mesh": 0, "scale": [-1, 1, 1] }),
        mode: 4,
        ..Model::default()
    };
    let positions = model.floats("VEC3", &SQUARE);
    let normals = model.floats(
        "VEC3",
        &[[0.0, 0.0, 1.0], [f32::NAN, 0.0, 0.0], [0.0; 3], [0.0, 0.0, 3e38]],
    );
    let tangents = model.floats("VEC4", &[[f32::INFINITY, 0.0, 0.0, f32::NAN]; 4]);
    let uvs = model.floats("VEC2", &UPRIGHT.map(|[u, v]| [1.0 - u, v]));
    let indices: Vec<u8> = [0u32, 1, 2, 0, 2, 3]
        .iter()
        .flat_map(|index| index.to_le_bytes())
        .collect();
    let indices = model.list("SCALAR", 5125, 6, false, indices);
    let attributes =
        json!({ "POSITION": positions, "NORMAL": normals, "TANGENT": tangents, "TEXCOORD_0": uvs });
    model.load(folder, attributes, indices).scene
}

/// Coordinates far outside of the unit square, and a triangle without area.
fn far_coordinates(folder: &Path) -> Scene {
    let mut model = Model {
        node: json!({ "mesh": 0 }),
        mode: 4,
        ..Model::default()
    };
    let positions = model.floats("VEC3", &SQUARE);
    let uvs = model.floats("VEC2", &UPRIGHT.map(|[u, v]| [u + 3.0, v - 8.0]));
    let indices = model.list("SCALAR", 5121, 12, false, [0, 1, 2, 0, 2, 3, 1, 1, 2, 0, 2, 0]);
    model
        .load(
            folder,
            json!({ "POSITION": positions, "TEXCOORD_0": uvs }),
            indices,
        )
        .scene
}

/// A name, and what writes and loads it.
type Form = (&'static str, fn(&Path) -> Scene);

#[test]
fn one_square_in_many_forms_is_one_picture() {
    let folder = tempfile::tempdir().unwrap();
    let camera = showcase::swatch("leather").cameras[0];
    let expected = picture(&plain(folder.path()), &camera);
    let values = || expected.pixels.iter().flatten().map(|value| f64::from(*value));
    let mean = values().sum::<f64>() / values().count() as f64;
    assert!(
        values().any(|value| value > 2.0 * mean) && mean > 0.03,
        "something is seen"
    );
    let forms: [Form; 3] = [
        ("strip with a broken triangle", sparse_and_broken),
        ("mirrored, bad frames", mirrored),
        ("far coordinates", far_coordinates),
    ];
    for (name, form) in forms {
        let found = picture(&form(folder.path()), &camera);
        let pairs = found
            .pixels
            .iter()
            .flatten()
            .zip(expected.pixels.iter().flatten());
        let error: f64 = pairs.map(|(a, b)| f64::from((a - b).powi(2))).sum();
        let rmse = (error / values().count() as f64).sqrt();
        assert!(rmse < 0.01 * mean, "{name}: {rmse} of {mean}");
    }
    // The comparison sees a mirrored material.
    let mut turned = plain(folder.path());
    turned.meshes[0].uvs.iter_mut().for_each(|uv| uv.x = 1.0 - uv.x);
    turned.meshes[0].compute_tangents();
    let found = picture(&turned, &camera);
    let pairs = found
        .pixels
        .iter()
        .flatten()
        .zip(expected.pixels.iter().flatten());
    let error: f64 = pairs.map(|(a, b)| f64::from((a - b).powi(2))).sum();
    assert!((error / values().count() as f64).sqrt() > 0.1 * mean);
}

#[test]
fn the_papers_scenes_are_drawn_from_both_their_cameras() {
    for (scene, detail) in [(PaperScene::Cylinders, 1.0), (PaperScene::Figure, 0.1)] {
        let built = scene.build(detail);
        for camera in &built.cameras {
            let found = picture(&built, camera);
            let background = built.background.to_array();
            let seen = found
                .pixels
                .iter()
                .filter(|pixel| pixel[..3] != background[..])
                .count();
            let share = seen as f64 / found.pixels.len() as f64;
            assert!(
                (0.1..0.95).contains(&share),
                "{}: {share} of the picture is covered",
                scene.name()
            );
        }
    }
}
