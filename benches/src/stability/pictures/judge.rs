//! What is right, in f64: samples, the decoded archive, and how far they are apart.

use engine::metrics::Picture;
use engine::reference::{FactorReflectance, Mipped, Reflectance, Samples, shade};
use preprocess::npy::Sampling;
use scenes::{Camera, Scene};
use tileset::{Archive, Direction, Ledger};

use super::super::Input;
use super::views::SIZE;
use crate::Result;

/// Memory of mips that are kept: far more than any case has.
const CACHE_BYTES: u64 = 256 << 20;

/// The samples of a case, as the reference reads them.
struct OfInput {
    input: Input,
    sampling: Sampling,
}

impl Samples for OfInput {
    fn size(&self) -> (u32, u32) {
        (self.input.shape.width as u32, self.input.shape.height as u32)
    }

    fn wrap(&self) -> bool {
        self.sampling.wrap
    }

    fn cosine(&self) -> bool {
        self.sampling.cosine
    }

    fn views(&self) -> &[Direction] {
        &self.sampling.views
    }

    fn lights(&self) -> &[Direction] {
        &self.sampling.lights
    }

    fn texel(&self, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        let shape = self.input.shape;
        let image = view as usize * shape.lights + light as usize;
        let at = y as usize * shape.width + x as usize;
        [0, 1, 2].map(|rgb| f64::from(self.input.samples[(3 * image + rgb) * shape.columns() + at]))
    }
}

/// Squared differences of samples and archive, in squares of the unit: a BTF as any other.
struct SquaredError<'a> {
    samples: &'a Mipped<OfInput>,
    factors: &'a FactorReflectance,
    unit: f64,
}

impl Reflectance for SquaredError<'_> {
    fn size(&self) -> (u32, u32) {
        self.samples.size()
    }

    fn wrap(&self) -> bool {
        self.samples.wrap()
    }

    fn cosine(&self) -> bool {
        self.samples.cosine()
    }

    fn views(&self) -> &[Direction] {
        self.samples.views()
    }

    fn lights(&self) -> &[Direction] {
        self.samples.lights()
    }

    fn texel(&self, mip: u8, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        let right = self.samples.texel(mip, x, y, view, light);
        let found = self.factors.texel(mip, x, y, view, light);
        std::array::from_fn(|rgb| ((found[rgb] - right[rgb]) / self.unit).powi(2))
    }
}

/// What is known of a case.
pub(super) struct Judge {
    samples: Mipped<OfInput>,
    factors: FactorReflectance,
    /// Root mean square of the BTF, or 1 if it is zero: what errors are relative to.
    pub(super) unit: f64,
    /// Pages without a record.
    pub(super) pages_not_stored: usize,
    /// What the archive states, in units.
    pub(super) ledger: f64,
    /// Root mean square error of the decoded archive over all samples, in units.
    pub(super) archive_error: f64,
    /// Largest decoded value, in units.
    pub(super) largest: f64,
}

/// Three pictures of one view.
pub(super) struct Verdict {
    /// From the samples.
    pub(super) samples: Picture,
    /// From the decoded archive.
    pub(super) factors: Picture,
    /// Most of the squared error that the archive explains, in squared units.
    pub(super) explained: Picture,
}

impl Judge {
    /// # Errors
    /// If the archive cannot be decoded, and those of [`Mipped::new`].
    pub(super) fn new(input: &Input, sampling: &Sampling, archive: &Archive<Vec<u8>>) -> Result<Self> {
        let Ledger {
            btf_rms,
            measured_rms,
            ..
        } = archive.index.manifest.errors;
        let unit = if btf_rms > 0.0 { btf_rms } else { 1.0 };
        let of_input = OfInput {
            input: input.clone(),
            sampling: sampling.clone(),
        };
        let mut judge = Self {
            samples: Mipped::new(of_input, CACHE_BYTES)?,
            factors: FactorReflectance::new(archive)?,
            unit,
            pages_not_stored: archive
                .index
                .pages()
                .iter()
                .filter(|page| page.length == 0)
                .count(),
            ledger: measured_rms / unit,
            archive_error: 0.0,
            largest: 0.0,
        };
        let (mut squares, mut largest) = (0.0, 0f64);
        let error = judge.error();
        let shape = input.shape;
        for image in 0..shape.views * shape.lights {
            let (view, light) = ((image / shape.lights) as u32, (image % shape.lights) as u32);
            for at in 0..shape.columns() {
                let (x, y) = ((at % shape.width) as u32, (at / shape.width) as u32);
                squares += error.texel(0, x, y, view, light).iter().sum::<f64>();
                let found = judge.factors.texel(0, x, y, view, light);
                largest = found.iter().fold(largest, |most, value| most.max(value.abs()));
            }
        }
        judge.archive_error = (squares / shape.samples() as f64).sqrt();
        judge.largest = largest / unit;
        Ok(judge)
    }

    fn error(&self) -> SquaredError<'_> {
        SquaredError {
            samples: &self.samples,
            factors: &self.factors,
            unit: self.unit,
        }
    }

    /// Shades the pixels that the engine has seen; the scene shows the material with this index and no other.
    pub(super) fn shade(
        &self,
        scene: &Scene,
        camera: &Camera,
        material: usize,
        visibility: &[[u32; 2]],
    ) -> Verdict {
        let by = |reflectance: &dyn Reflectance| {
            let mut of_material = vec![None; scene.materials.len()];
            of_material[material] = Some(reflectance);
            shade(scene, camera, SIZE, visibility, &of_material)
        };
        Verdict {
            samples: by(&self.samples),
            factors: by(&self.factors),
            explained: by(&self.error()),
        }
    }
}
