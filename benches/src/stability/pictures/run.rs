//! All cases in all views.

use std::time::Duration;

use engine::frame::{Budgets, Engine, Options};
use engine::gpu::{Context, PageFormat};
use engine::metrics::Picture;
use engine::stream::MemorySource;
use glam::Vec2;
use preprocess::build::{DEFAULT_QUALITY, build};
use preprocess::factorize::factorize;
use scenes::{Material, Scene, Surface};
use serde::Serialize;
use tileset::Archive;

use super::super::suite::{prepared, settings};
use super::super::{Bounds, Case};
use super::judge::{Judge, Verdict};
use super::views::{SIZE, View, light, views};
use crate::{Error, Result};

/// Longest time until a view has settled.
const LIMIT: Duration = Duration::from_secs(60);
/// What a pixel may be off by rounding, in parts of the largest of the BTF's root mean square and the brightest pixel. The GPU
/// interpolates and sums in f32, some 2⁻²⁰ after a few dozen sums, from texture coordinates that are off by 2⁻²⁴ of a material, which is up to
/// 2⁻¹² of a texel of 4096 across, and by as much of the difference of two texels.
const ROUNDING: f64 = 1.0 / 2048.0;
/// The same in views that show nothing but the edge of a material. Texels of the pages on its other side are half of what the filter reads there, and no
/// pixel asks for these pages, so that the decoder's guess of the border stands in for them. How far it is off depends on what is in
/// them; 0.0145 was seen, in the smooth texture of 346 × 335 texels.
const EDGE: f64 = 1.0 / 64.0;
/// f32 has no value between this and zero on a GPU.
const DENORMAL: f64 = f32::MIN_POSITIVE as f64;
/// How far a coarser mip, which is a band of a cosine transform, may swing beyond the largest texel of the finest.
const OVERSHOOT: f64 = 1.5;

/// One case in one view. Errors are in root mean squares of the BTF, or absolute where it is zero.
#[derive(Clone, Debug, Serialize)]
pub struct PictureRow {
    /// The case.
    pub case: &'static str,
    /// The view.
    pub view: &'static str,
    /// Pixels that show the material.
    pub pixels: usize,
    /// Pixels with a value that is not finite.
    pub not_finite: usize,
    /// Pages of the archive that have no record.
    pub pages_not_stored: usize,
    /// What the archive states of itself.
    pub ledger: f64,
    /// The same, measured.
    pub archive_error: f64,
    /// Root mean square error of the picture's pixels against the samples in f64; `None` where the reference cannot tell.
    pub error: Option<f64>,
    /// The largest error of a pixel, in parts of what the archive's own error explains, and rounding.
    pub of_bound: Option<f64>,
    /// What that may be beside it: rounding.
    pub rounding_bound: f64,
    /// The largest difference of a pixel to the decoded archive in f64, in parts of the largest of the BTF's root mean square and
    /// the brightest pixel.
    pub rounding: Option<f64>,
    /// What is broken, for people; empty if nothing is.
    pub broken: Vec<String>,
}

/// Draws the given cases in all views; `progress` gets the name of each before it begins.
///
/// # Errors
/// [`Error::Preprocess`], [`Error::Archive`], [`Error::Io`] and [`Error::Engine`] for what should not fail. A broken bound is no
/// error: [`PictureRow::broken`] says so.
pub fn pictures(cases: &[Case], progress: &dyn Fn(&str)) -> Result<Vec<PictureRow>> {
    let folder =
        tempfile::tempdir().map_err(|source| Error::io(&std::env::temp_dir(), "make a folder in")(source))?;
    let views = views();
    let (mut source, mut judges, mut scene) = (MemorySource::new(), Vec::new(), empty_scene());
    for (number, case) in cases.iter().enumerate() {
        progress(case.name);
        let (input, btf) = prepared(case)?;
        let factors = factorize(&btf, &settings(case.components), &|_| ())?;
        let path = folder.path().join("case.bsvtf");
        build(&btf, &factors, DEFAULT_QUALITY, &path, &|_| ())?;
        let bytes = std::fs::read(&path).map_err(Error::io(&path, "read"))?;
        let name = format!("case-{number}");
        source.insert(&name, bytes.clone())?;
        let archive = Archive::open(bytes).map_err(Error::archive(&path))?;
        judges.push(Judge::new(&input, btf.sampling(), &archive)?);
        scene.materials.push(Material {
            name: name.clone(),
            surface: Surface::Btf {
                archive: name,
                uv_scale: Vec2::ONE,
                uv_offset: Vec2::ZERO,
            },
        });
    }
    if let Some(first) = views.first() {
        first.show(&mut scene, 0);
    }
    let mut engine = Engine::new(Context::headless()?, &scene, Box::new(source), options())?;
    engine.wait_for_materials(LIMIT)?;
    let mut rows = Vec::new();
    for (material, (case, judge)) in cases.iter().zip(&judges).enumerate() {
        progress(case.name);
        for view in &views {
            view.show(&mut scene, material);
            engine.set_geometry(&scene)?;
            let frames = engine.settle(&view.camera, LIMIT)?;
            let mut row = judged(case, view, material, judge, &scene, &engine)?;
            if !frames.last().is_some_and(|stats| stats.settled) {
                row.broken.push("does not settle".to_owned());
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

/// All component groups are drawn, so that nothing but rounding is between the archive and the picture.
fn options() -> Options {
    Options {
        size: SIZE,
        budgets: Budgets {
            page_cache_bytes: 32 << 20,
            column_cache_bytes: 16 << 20,
            ..Budgets::default()
        },
        component_error: 0.0,
        page_format: Some(PageFormat::Half),
        ..Options::default()
    }
}

fn empty_scene() -> Scene {
    Scene {
        lights: vec![light()],
        ..Scene::default()
    }
}

fn judged(
    case: &Case,
    view: &View,
    material: usize,
    judge: &Judge,
    scene: &Scene,
    engine: &Engine,
) -> Result<PictureRow> {
    let picture = engine.picture()?;
    let visibility = engine.visibility()?;
    let verdict = judge.shade(scene, &view.camera, material, &visibility);
    let seen: Vec<usize> = (0..visibility.len())
        .filter(|at| visibility[*at][0] != 0)
        .collect();
    let finite = |pixel: &&[f32; 3]| !pixel.iter().all(|value| value.is_finite());
    let mut row = PictureRow {
        case: case.name,
        view: view.name,
        pixels: seen.len(),
        not_finite: picture.pixels.iter().filter(finite).count(),
        pages_not_stored: judge.pages_not_stored,
        ledger: judge.ledger,
        archive_error: judge.archive_error,
        error: None,
        of_bound: None,
        rounding_bound: if view.on_edge { EDGE } else { ROUNDING },
        rounding: None,
        broken: Vec::new(),
    };
    if view.compared {
        compare(&mut row, judge.unit, &seen, &picture, &verdict);
    } else {
        let most = values(&picture, &seen).fold(0.0, |most: f64, value| most.max(value.abs()));
        if most > OVERSHOOT * judge.largest * judge.unit + DENORMAL {
            row.broken
                .push(format!("a pixel is {most:.3e}, more than any texel"));
        }
    }
    row.broken.extend(broken(&row, &case.bounds));
    Ok(row)
}

fn values<'a>(picture: &'a Picture, seen: &'a [usize]) -> impl Iterator<Item = f64> + 'a {
    seen.iter().flat_map(|at| picture.pixels[*at]).map(f64::from)
}

fn compare(row: &mut PictureRow, unit: f64, seen: &[usize], picture: &Picture, verdict: &Verdict) {
    let brightest = values(&verdict.factors, seen).fold(0.0, |most: f64, value| most.max(value.abs()));
    let scale = unit.max(brightest);
    let (mut squares, mut of_bound, mut rounding) = (0.0, 0f64, 0f64);
    // `max` would pass over NaN.
    let most = |a: f64, b: f64| if b <= a { a } else { b };
    let found = values(picture, seen).zip(values(&verdict.samples, seen));
    let decoded = values(&verdict.factors, seen).zip(values(&verdict.explained, seen));
    for ((found, right), (decoded, explained)) in found.zip(decoded) {
        let error = (found - right).abs();
        squares += (error / unit).powi(2);
        let bound = explained.max(0.0).sqrt() * unit + row.rounding_bound * scale + DENORMAL;
        of_bound = most(of_bound, error / bound);
        rounding = most(rounding, ((found - decoded).abs() - DENORMAL).max(0.0) / scale);
    }
    row.error = Some((squares / (3 * seen.len().max(1)) as f64).sqrt());
    row.of_bound = Some(of_bound);
    row.rounding = Some(rounding);
}

fn broken(row: &PictureRow, bounds: &Bounds) -> Vec<String> {
    let mut broken = Vec::new();
    if row.pixels == 0 {
        broken.push("nothing is seen".to_owned());
    }
    if row.not_finite > 0 {
        broken.push(format!("{} pixels are not finite", row.not_finite));
    }
    let mut at_most = |what: &str, value: f64, bound: f64| {
        let within = value <= bound; // false for NaN
        if !within {
            broken.push(format!("{what} is {value:.3e}, more than {bound:.3e}"));
        }
    };
    at_most(
        "ledger minus error of the archive",
        (row.ledger - row.archive_error).abs(),
        bounds.ledger_share * row.archive_error + bounds.ledger_floor,
    );
    if let (Some(of_bound), Some(rounding)) = (row.of_bound, row.rounding) {
        at_most("error of a pixel in parts of its bound", of_bound, 1.0);
        at_most("rounding", rounding, row.rounding_bound);
    }
    broken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_with_a_picture_is_named() {
        let picture = |value: f32| Picture {
            width: 2,
            height: 1,
            pixels: vec![[value; 3], [1.0; 3]],
        };
        let right = || PictureRow {
            case: "case",
            view: "view",
            pixels: 1,
            not_finite: 0,
            pages_not_stored: 0,
            ledger: 0.01,
            archive_error: 0.01,
            error: None,
            of_bound: None,
            rounding_bound: ROUNDING,
            rounding: None,
            broken: Vec::new(),
        };
        // The archive shows 1.01 where samples are 1, and states so.
        let verdict = Verdict {
            samples: picture(1.0),
            factors: picture(1.01),
            explained: picture(1e-4),
        };
        let found = |value: f32| {
            let mut row = right();
            compare(&mut row, 1.0, &[0], &picture(value), &verdict);
            broken(&row, &Bounds::DEFAULT).join("; ")
        };
        assert_eq!(found(1.01), "");
        assert!(found(1.011).starts_with("error of a pixel"), "{}", found(1.011));
        assert!(found(0.999).starts_with("rounding is"), "{}", found(0.999));
        assert!(found(f32::NAN).contains("NaN"), "{}", found(f32::NAN));
        let with = |change: fn(&mut PictureRow)| {
            let mut row = right();
            change(&mut row);
            broken(&row, &Bounds::DEFAULT).join("; ")
        };
        assert_eq!(with(|row| row.pixels = 0), "nothing is seen");
        assert_eq!(with(|row| row.not_finite = 2), "2 pixels are not finite");
        assert!(with(|row| row.ledger = 0.011).starts_with("ledger minus error"));
        let rounded = |row: &mut PictureRow| (row.of_bound, row.rounding) = (Some(0.1), Some(0.01));
        assert!(with(rounded).starts_with("rounding is"));
    }
}
