//! Archives of the same factors with several steps: decoding over error.

use std::path::Path;

use preprocess::ProgressFn;
use preprocess::build::{ArchiveBytes, DEFAULT_QUALITY, build};

use super::rounds::alternate;
use super::{Family, Knob, Point};
use crate::codec::Pages;
use crate::{KeptFactors, Result};

/// Steps in parts of the default.
const STEPS: [f64; 7] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// Times that pages are decoded for one time.
const RUNS: usize = 9;

/// Codes factors with several steps into `folder`, and decodes by turns.
///
/// # Errors
/// Those of coding, reading and decoding archives.
pub(super) fn codes(
    kept: &KeptFactors,
    rounds: usize,
    folder: &Path,
    progress: ProgressFn<'_>,
) -> Result<Family> {
    let btf = kept.btf()?;
    let factors = &kept.factors;
    let make = |step: f64| -> Result<(Pages, ArchiveBytes)> {
        let path = folder.join(format!("quality-{step}.bsvtf"));
        let built = build(&btf, factors, step, &path, progress)?;
        Ok((Pages::read(&path)?, built.bytes))
    };
    let square = |values: &[f32]| values.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>();
    let energy = square(&factors.v);
    let (default, _) = make(DEFAULT_QUALITY)?;
    let mut points = Vec::new();
    for part in STEPS {
        let (pages, bytes) = make(part * DEFAULT_QUALITY)?;
        let squared = pages.squared_error(&factors.v)?;
        // Decoding takes milliseconds, in which a system does other things too: the median of some runs is one time.
        let times = alternate(rounds, |which| {
            let pages = if which { &pages } else { &default };
            Ok(pages.speed(RUNS)?.seconds * 1e3)
        })?;
        // A squared difference in V' is the mean over the rows.
        let left_out = factors.residual_energy + factors.rows as f64 * squared;
        points.push(Point {
            setting: format!("{}", part * DEFAULT_QUALITY),
            ms: times.ms,
            ratio: times.ratio,
            noise: times.noise,
            work: bytes.page_bytes as f64,
            bytes: Some(bytes.archive_bytes),
            error: relative(squared, energy),
            error_of_btf: Some(relative(left_out, factors.energy)),
            beaten_by: None,
        });
    }
    let default = STEPS.iter().position(|part| *part == 1.0).unwrap_or(0);
    Ok(Family::new(Knob::Quantizer, default, points))
}

fn relative(squared: f64, energy: f64) -> f64 {
    if energy > 0.0 {
        (squared / energy).sqrt()
    } else {
        0.0
    }
}
