//! Two small materials, as samples and as archives, and a scene that shows both.

use std::path::{Path, PathBuf};

use glam::{Affine3A, Quat, Vec3};
use preprocess::npy::{BtfWriter, Dtype, Sampling};
use scenes::synth::{SynthOptions, synthesize};
use scenes::{Scene, showcase};
use tileset::Direction;

/// Texels along a side: two tiles, and mips.
pub const SIZE: u32 = 96;

/// Names of the materials.
const NAMES: [&str; 2] = ["leather", "studs"];

/// A folder with samples in `npy` and archives in `tiles`.
pub struct Fixture {
    folder: tempfile::TempDir,
}

impl Fixture {
    /// Makes both materials; a few seconds.
    ///
    /// # Panics
    /// If anything fails: this is a test.
    pub fn new() -> Self {
        let fixture = Self {
            folder: tempfile::tempdir().expect("a folder for temporary files"),
        };
        std::fs::create_dir_all(fixture.npy()).expect("a folder");
        std::fs::create_dir_all(fixture.tiles()).expect("a folder");
        for name in NAMES {
            fixture.make(name);
        }
        fixture
    }

    /// Folder of the samples.
    pub fn npy(&self) -> PathBuf {
        self.folder.path().join("npy")
    }

    /// Folder of the archives.
    pub fn tiles(&self) -> PathBuf {
        self.folder.path().join("tiles")
    }

    /// An archive, by name.
    pub fn archive(&self, name: &str) -> PathBuf {
        self.tiles().join(format!("{name}.bsvtf"))
    }

    /// Names of the archives.
    pub fn names(&self) -> [&'static str; 2] {
        NAMES
    }

    /// A folder of the test's own with copies of the archives.
    ///
    /// # Panics
    /// If they cannot be copied.
    pub fn site(&self) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        for name in NAMES {
            let to = folder.path().join(format!("{name}.bsvtf"));
            std::fs::copy(self.archive(name), to).expect("a copy");
        }
        folder
    }

    fn make(&self, name: &str) {
        let options = SynthOptions {
            size: SIZE,
            views: directions(),
            lights: directions(),
            samples_per_texel: 2,
            interreflection: false,
            ..SynthOptions::default()
        };
        let npy = self.npy().join(format!("{name}.npy"));
        let sampling = Sampling {
            views: options.views.clone(),
            lights: options.lights.clone(),
            wrap: true,
            cosine: true,
        };
        let mut writer = BtfWriter::create(&npy, sampling, SIZE, SIZE, Dtype::F16).expect("a writer");
        let mut sink = |_: usize, block: &[half::f16]| writer.write_f16(block).map_err(std::io::Error::other);
        synthesize(name, &options, &mut sink, &|_, _| ()).expect("a material");
        writer.finish().expect("all samples");
        self.preprocess(&npy, &self.archive(name));
    }

    fn preprocess(&self, input: &Path, output: &Path) {
        let mut options = preprocess::Options::new(input, output);
        options.settings.components = 16;
        preprocess::run(&options, &|_| ()).expect("an archive");
    }
}

impl Default for Fixture {
    fn default() -> Self {
        Self::new()
    }
}

/// The normal and rings at 30, 55 and 75 degrees.
fn directions() -> Vec<Direction> {
    let rings = [(0.0f64, 1), (30.0, 6), (55.0, 8), (75.0, 10)];
    let ring = |(theta, count): (f64, u32)| {
        (0..count).map(move |step| Direction {
            theta: theta.to_radians(),
            phi: std::f64::consts::TAU * f64::from(step) / f64::from(count),
        })
    };
    rings.into_iter().flat_map(ring).collect()
}

/// A square of each material, one of them tilted away.
pub fn scene() -> Scene {
    let mut scene = showcase::swatch(NAMES[0]);
    let other = showcase::swatch(NAMES[1]);
    scene.materials.extend(other.materials);
    for (mut mesh, mut instance) in other.meshes.into_iter().zip(other.instances) {
        mesh.material += 1;
        instance.mesh += scene.meshes.len();
        let tilted = Quat::from_rotation_x(-0.9) * Quat::from_rotation_z(0.4);
        instance.world_from_mesh = Affine3A::from_rotation_translation(tilted, Vec3::new(0.1, -0.75, 0.3))
            * instance.world_from_mesh;
        scene.meshes.push(mesh);
        scene.instances.push(instance);
    }
    scene
}
