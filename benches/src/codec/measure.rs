//! One material at several errors or steps.

use std::path::{Path, PathBuf};

use preprocess::{Btf, ProgressFn, build};
use serde::Serialize;
use tileset::Codec;

use super::search::{Trial, search};
use super::{DecodeSpeed, Pages};
use crate::factorize::Factorized;
use crate::{KeptFactors, Result};

/// What to measure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Relative errors for which steps are searched.
    pub targets: Vec<f64>,
    /// Steps in root mean squares of the BTF that are measured as they are.
    pub steps: Vec<f64>,
    /// Times that all pages are decoded.
    pub runs: usize,
}

/// What was measured of a material.
#[derive(Clone, Debug, Serialize)]
pub struct Material {
    /// Name.
    pub name: String,
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Terms.
    pub components: usize,
    /// Samples of the finest mip: texels × components. Bits per sample are related to them.
    pub samples: u64,
    /// What the rank leaves out of the BTF, relative.
    pub rank_relative_error: f64,
    /// How the factors were made, where that was measured.
    pub factorized: Option<Factorized>,
    /// One for each target, then for each step.
    pub points: Vec<Point>,
}

/// An archive.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// The relative error asked for; `None` where a step was.
    pub target: Option<f64>,
    /// The relative error measured.
    pub relative_error: f64,
    /// Quantizer step in root mean squares of the BTF.
    pub quality: f64,
    /// The codec as the manifest has it.
    pub codec: Codec,
    /// The whole file.
    pub archive_bytes: u64,
    /// All pages of all mips.
    pub page_bytes: u64,
    /// Eigen-ABRDF columns.
    pub column_bytes: u64,
    /// The rest: header, manifest, directory, tables.
    pub table_bytes: u64,
    /// Bits of pages and tables for each sample of the finest mip.
    pub bits_per_sample: f64,
    /// Bits of the whole file for each sample of the finest mip.
    pub archive_bits_per_sample: f64,
    /// Seconds of coding pages and columns, on all cores.
    pub encode_seconds: f64,
    /// Seconds from factors to the finished file, on all cores: coding, measuring for the ledger, writing.
    pub archive_seconds: f64,
    /// On one core.
    pub decode: DecodeSpeed,
    /// Archives that were coded until the error was met.
    pub trials: usize,
    /// Where the archive is kept.
    pub archive: PathBuf,
}

/// Measures `kept` as `plan` says. Archives stay in `folder`, which must exist, named by target or step.
///
/// # Errors
/// [`crate::Error::Unreachable`] for a target that no step meets; those of coding, reading and writing archives.
pub fn measure(kept: &KeptFactors, plan: &Plan, folder: &Path, progress: ProgressFn<'_>) -> Result<Material> {
    let btf = kept.btf()?;
    let factors = &kept.factors;
    let energy: f64 = factors.v.iter().map(|&value| f64::from(value).powi(2)).sum();
    let coder = Coder {
        kept,
        btf: &btf,
        energy,
        runs: plan.runs,
        progress,
    };
    let mut points = Vec::new();
    let mut trials = Vec::new();
    for &target in &plan.targets {
        let path = folder.join(format!("target-{target}.bsvtf"));
        let before = trials.len();
        let found = search(target, &mut trials, |quality| {
            coder.build(quality, &path)?;
            coder.relative_error(&Pages::read(&path)?)
        })?;
        let tried = trials.len() - before;
        points.push(coder.point(Some(target), &found, tried, path)?);
    }
    for &quality in &plan.steps {
        let path = folder.join(format!("step-{quality}.bsvtf"));
        let trial = Trial { quality, error: 0.0 };
        points.push(coder.point(None, &trial, 0, path)?);
    }
    Ok(Material {
        name: kept.name.clone(),
        width: kept.width,
        height: kept.height,
        components: factors.components,
        samples: coder.samples(),
        rank_relative_error: factors.relative_error(),
        factorized: kept.factorized,
        points,
    })
}

/// Makes archives of one material.
struct Coder<'a> {
    kept: &'a KeptFactors,
    btf: &'a Btf,
    /// ΣV'².
    energy: f64,
    runs: usize,
    progress: ProgressFn<'a>,
}

impl Coder<'_> {
    fn build(&self, quality: f64, path: &Path) -> Result<build::Built> {
        let factors = &self.kept.factors;
        Ok(build::build(self.btf, factors, quality, path, self.progress)?)
    }

    fn relative_error(&self, pages: &Pages) -> Result<f64> {
        let squared = pages.squared_error(&self.kept.factors.v)?;
        Ok(if self.energy > 0.0 {
            (squared / self.energy).sqrt()
        } else {
            0.0
        })
    }

    fn samples(&self) -> u64 {
        self.kept.factors.v.len() as u64
    }

    /// The archive again, timed, and all that is told of it.
    fn point(&self, target: Option<f64>, trial: &Trial, trials: usize, archive: PathBuf) -> Result<Point> {
        let built = self.build(trial.quality, &archive)?;
        let pages = Pages::read(&archive)?;
        let bytes = built.bytes;
        let table_bytes = bytes.archive_bytes - bytes.page_bytes - bytes.column_bytes;
        let bits = |bytes: u64| 8.0 * bytes as f64 / self.samples() as f64;
        Ok(Point {
            target,
            relative_error: self.relative_error(&pages)?,
            quality: trial.quality,
            codec: pages.index().manifest.codec,
            archive_bytes: bytes.archive_bytes,
            page_bytes: bytes.page_bytes,
            column_bytes: bytes.column_bytes,
            table_bytes,
            bits_per_sample: bits(bytes.page_bytes + table_bytes),
            archive_bits_per_sample: bits(bytes.archive_bytes),
            encode_seconds: built.seconds[0],
            archive_seconds: built.seconds.iter().sum(),
            decode: pages.speed(self.runs)?,
            trials,
            archive,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kept::tests::example;

    #[test]
    fn targets_are_met_and_bytes_add_up() {
        let folder = tempfile::tempdir().unwrap();
        // Six components: the last group is half empty, which must count neither as samples nor as error.
        let kept = example(6, 72);
        let plan = Plan {
            targets: vec![0.1, 0.02],
            steps: vec![0.05],
            runs: 1,
        };
        let material = measure(&kept, &plan, folder.path(), &|_| ()).unwrap();
        assert_eq!(material.samples, 6 * 72 * 72);
        assert_eq!(material.points.len(), 3);
        for point in &material.points {
            let file = std::fs::metadata(&point.archive).unwrap().len();
            assert_eq!(point.archive_bytes, file);
            assert_eq!(point.page_bytes + point.column_bytes + point.table_bytes, file);
            assert!(point.bits_per_sample < point.archive_bits_per_sample);
            assert_eq!(point.decode.finest_samples, material.samples);
            assert!(point.decode.samples > material.samples && point.decode.mb_per_s > 0.0);
            if let Some(target) = point.target {
                let met = 0.99 * target..=target;
                assert!(met.contains(&point.relative_error), "{}", point.relative_error);
            }
        }
        let [coarse, fine, _] = &material.points[..] else {
            panic!("three points")
        };
        assert!(coarse.page_bytes < fine.page_bytes && coarse.quality > fine.quality);
    }

    /// Against the product that `export` gives: another way to the same decoded finest mips.
    #[test]
    fn the_error_is_that_of_the_exported_textures() {
        let folder = tempfile::tempdir().unwrap();
        let kept = example(5, 40);
        let plan = Plan {
            steps: vec![0.08],
            runs: 1,
            ..Plan::default()
        };
        let material = measure(&kept, &plan, folder.path(), &|_| ()).unwrap();
        let point = &material.points[0];
        let exported = folder.path().join("exported");
        preprocess::export(&point.archive, &exported, &|_| ()).unwrap();
        let decoded = crate::npy::read_f32(&exported.join("v.npy"), &[5, 40, 40]).unwrap();
        let (mut error, mut energy) = (0.0, 0.0);
        for (&decoded, &wanted) in decoded.iter().zip(&kept.factors.v) {
            error += f64::from(decoded - wanted).powi(2);
            energy += f64::from(wanted).powi(2);
        }
        let expected = (error / energy).sqrt();
        assert!(
            (point.relative_error / expected - 1.0).abs() < 1e-3,
            "{} and {expected}",
            point.relative_error
        );
    }
}
