//! The same pixels from the uncompressed BTFs, and how far the picture is from them.

use std::collections::BTreeMap;
use std::path::Path;

use ::preprocess::npy::NpyBtf;
use anyhow::{Context, Result};
use engine::frame::Engine;
use engine::metrics::{Comparison, Picture, compare as compare_pictures, flip::mean_flip};
use engine::reference::{Mipped, Reflectance, Samples, shade};
use scenes::{Camera, Scene, Surface};
use serde::Serialize;
use tileset::Direction;

use super::{Ledgers, picture};
use crate::progress;

/// Memory for the mips of all uncompressed BTFs together.
const CACHE_BYTES: u64 = 1 << 30;

/// An uncompressed BTF in the memory map of its file.
struct Mapped(NpyBtf);

impl Samples for Mapped {
    fn size(&self) -> (u32, u32) {
        (self.0.width(), self.0.height())
    }

    fn wrap(&self) -> bool {
        self.0.wrap()
    }

    fn cosine(&self) -> bool {
        self.0.cosine()
    }

    fn views(&self) -> &[Direction] {
        self.0.views()
    }

    fn lights(&self) -> &[Direction] {
        self.0.lights()
    }

    fn texel(&self, x: u32, y: u32, view: u32, light: u32) -> [f64; 3] {
        self.0.texel(view as usize, light as usize, x, y)
    }
}

/// The uncompressed BTFs of a scene.
pub(crate) struct References {
    by_archive: BTreeMap<String, Mipped<Mapped>>,
}

impl References {
    /// Opens FOLDER/ARCHIVE.npy for all archives that a scene names.
    pub(crate) fn open(scene: &Scene, folder: &Path) -> Result<Self> {
        let archives = scene.archives();
        let cache_bytes = CACHE_BYTES / archives.len().max(1) as u64;
        let open = |archive: &&str| {
            let btf = NpyBtf::open(&folder.join(format!("{archive}.npy")))?;
            Ok((archive.to_string(), Mipped::new(Mapped(btf), cache_bytes)?))
        };
        Ok(Self {
            by_archive: archives.iter().map(open).collect::<Result<_>>()?,
        })
    }

    /// Shades the pixels of a visibility pass.
    pub(crate) fn shade(
        &self,
        scene: &Scene,
        camera: &Camera,
        size: (u32, u32),
        visibility: &[[u32; 2]],
    ) -> Picture {
        let of = |surface: &Surface| match surface {
            Surface::Btf { archive, .. } => self
                .by_archive
                .get(archive)
                .map(|reflectance| reflectance as &dyn Reflectance),
            Surface::Diffuse { .. } => None,
        };
        let materials: Vec<_> = scene
            .materials
            .iter()
            .map(|material| of(&material.surface))
            .collect();
        shade(scene, camera, size, visibility, &materials)
    }
}

/// What to compare.
pub(crate) struct Request<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) camera: &'a Camera,
    pub(crate) exposure_stops: f32,
    /// Error of reflectance that the engine predicts for what is not resident.
    pub(crate) residency_rms: f64,
    pub(crate) quiet: bool,
}

/// The reference, and the pixels that count: those that show a BTF.
pub(crate) struct Truth {
    pub(crate) picture: Picture,
    pub(crate) covered: Vec<bool>,
}

/// How far a picture is from the uncompressed BTFs, and how far it was said to be.
#[derive(Serialize)]
pub(crate) struct Quality {
    #[serde(flatten)]
    pub(crate) measured: Comparison,
    /// Mean FLIP of what the screen shows.
    pub(crate) flip: f64,
    /// Root mean square error of radiance that the ledgers and the residency predict.
    pub(crate) predicted_rmse: f64,
    /// Whether the measured error is at most the predicted one.
    pub(crate) within_prediction: bool,
    /// Stated errors of reflectance, by archive.
    ledger_rms: BTreeMap<String, f64>,
    /// Error of reflectance for what is not resident.
    residency_rms: f64,
    pub(crate) error_map: ErrorMap,
}

/// How to read the picture of errors.
#[derive(Serialize)]
pub(crate) struct ErrorMap {
    file: &'static str,
    quantity: &'static str,
    /// Error of the darkest colour, and of the brightest; larger ones look like it.
    from: f64,
    pub(crate) to: f64,
}

/// Shades the reference of the engine's last picture, and writes reference.png, reference.exr and error.png
/// into a folder.
pub(crate) fn compare(
    engine: &Engine,
    request: &Request,
    ledgers: &Ledgers,
    references: &References,
    output: &Path,
) -> Result<(Quality, Truth)> {
    let picture = engine.picture()?;
    let visibility = engine.visibility()?;
    let size = (picture.width, picture.height);
    let bar = progress::spinner("reference", request.quiet);
    let reference = references.shade(request.scene, request.camera, size, &visibility);
    bar.finish_and_clear();
    picture::write_shown(&output.join("reference.png"), &reference, request.exposure_stops)?;
    picture::write_exr(&output.join("reference.exr"), &reference)?;
    let error_map = write_error_map(&output.join("error.png"), &picture, &reference)?;
    let covered = covered(request.scene, &visibility);
    let measured = compare_pictures(&picture, &reference, Some(&covered), request.exposure_stops)
        .context("no pixel shows a material: is the camera turned away?")?;
    let flip = mean_flip(&picture, &reference, Some(&covered), request.exposure_stops)
        .context("the reference has another size than the picture")?;
    let predicted_rmse = ledgers.predict(
        request.scene,
        request.camera,
        size,
        &visibility,
        request.residency_rms,
    );
    let quality = Quality {
        measured,
        flip,
        predicted_rmse,
        within_prediction: measured.rmse <= predicted_rmse,
        ledger_rms: ledgers.rms(),
        residency_rms: request.residency_rms,
        error_map,
    };
    Ok((
        quality,
        Truth {
            picture: reference,
            covered,
        },
    ))
}

/// Pixels that show a BTF.
fn covered(scene: &Scene, visibility: &[[u32; 2]]) -> Vec<bool> {
    let is_btf = |instance: u32| {
        let instance = scene.instances.get((instance as usize).checked_sub(1)?)?;
        let material = scene.materials.get(scene.meshes.get(instance.mesh)?.material)?;
        Some(matches!(material.surface, Surface::Btf { .. }))
    };
    visibility
        .iter()
        .map(|[instance, _]| is_btf(*instance).unwrap_or(false))
        .collect()
}

fn write_error_map(path: &Path, picture: &Picture, reference: &Picture) -> Result<ErrorMap> {
    let error = |(a, b): (&[f32; 3], &[f32; 3])| {
        let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
        (squares.sum::<f64>() / 3.0).sqrt()
    };
    let errors: Vec<f64> = picture.pixels.iter().zip(&reference.pixels).map(error).collect();
    // The brightest colour is for the half percent of largest errors: single highlights do not set the scale.
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let to = sorted
        .get(sorted.len() * 995 / 1000)
        .copied()
        .unwrap_or(0.0)
        .max(1e-6);
    let pixels: Vec<u8> = errors
        .iter()
        .flat_map(|error| picture::heat(error / to))
        .collect();
    picture::write_png(path, (picture.width, picture.height), &pixels)?;
    Ok(ErrorMap {
        file: "error.png",
        quantity: "root mean square error of linear radiance over the channels",
        from: 0.0,
        to,
    })
}

impl Quality {
    /// For people.
    pub(crate) fn text(&self) -> String {
        let Comparison {
            rmse,
            relative_rmse,
            psnr_db,
            ssim,
            delta_e_2000,
            ..
        } = self.measured;
        format!(
            "against the reference: RMSE {rmse:.5} ({:.2} %), predicted {:.5}; PSNR {psnr_db:.1} dB, SSIM {ssim:.4}, FLIP {:.4}, ΔE2000 {delta_e_2000:.2}\n",
            100.0 * relative_rmse,
            self.predicted_rmse,
            self.flip,
        )
    }
}
