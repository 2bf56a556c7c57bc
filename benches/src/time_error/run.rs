//! All knobs.

use std::path::{Path, PathBuf};

use preprocess::build::{DEFAULT_QUALITY, build};
use preprocess::{Btf, Settings};
use scenes::Surface;
use serde::Serialize;

use super::codes::codes;
use super::factors::factors;
use super::pictures::{Plan, pictures};
use super::{Family, Knob, Point, Results};
use crate::engine::{Archives, Subject, built_in};
use crate::{Error, KeptFactors, Result, factorize, sparse_cloth};

/// What to measure with.
#[derive(Debug)]
pub enum Input {
    /// A grid of tori with a cloth of so many texels along a side, made in a moment, and so many views of it.
    Made {
        /// Texels along a side of the cloth.
        texels: u32,
        /// Views, two or more.
        frames: usize,
    },
    /// A scene, and perhaps a BTF (or a folder of factors that [`KeptFactors`] has written), without which only pictures are
    /// measured.
    Given(Box<Subject>, Option<PathBuf>),
}

/// Measures all knobs; with `settings`, whose passes are the knob, the BTF is factorized. `progress` gets words on what is next.
///
/// # Errors
/// Those of drawing, of reading and factorizing the BTF, and of coding its factors.
pub fn measure(input: Input, plan: &Plan, settings: &Settings, progress: &dyn Fn(&str)) -> Result<Results> {
    let folder = tempfile::tempdir().map_err(Error::io(&std::env::temp_dir(), "make a folder in"))?;
    let folder = folder.path();
    progress("the scene");
    let (subject, btf) = match input {
        Input::Made { texels, frames } => made(folder, texels, settings, frames)?,
        Input::Given(subject, btf) => (*subject, btf),
    };
    let (mut families, skipped) = pictures(&subject, plan, progress)?;
    if let Some(path) = btf {
        families.extend(of_btf(&path, settings, plan.rounds, folder, progress)?);
    }
    Ok(Results {
        name: subject.name,
        rounds: plan.rounds,
        families,
        skipped,
    })
}

/// The grid of tori with one material, which is factorized and coded as always; and its BTF.
fn made(
    folder: &Path,
    texels: u32,
    settings: &Settings,
    frames: usize,
) -> Result<(Subject, Option<PathBuf>)> {
    let btf = sparse_cloth(folder, texels)?;
    let made = preprocess::factorize::factorize(&btf, settings, &|_| ())?;
    let archive = folder.join("made.bsvtf");
    build(&btf, &made, DEFAULT_QUALITY, &archive, &|_| ())?;
    let bytes = std::fs::read(&archive).map_err(Error::io(&archive, "read"))?;
    let mut subject = built_in(1, frames, 0)?;
    for material in &mut subject.scene.materials {
        if let Surface::Btf { archive, .. } = &mut material.surface {
            *archive = "cloth".into();
        }
    }
    subject.archives = Archives::Made(vec![("cloth".into(), bytes)]);
    subject.name = format!("tori with a cloth of {texels}² texels");
    Ok((subject, Some(folder.join("cloth.npy"))))
}

/// Coding and factorizing. Of kept factors there is no BTF to factorize.
fn of_btf(
    path: &Path,
    settings: &Settings,
    rounds: usize,
    folder: &Path,
    progress: &dyn Fn(&str),
) -> Result<Vec<Family>> {
    if KeptFactors::is_kept(path) {
        progress(Knob::Quantizer.title());
        return Ok(vec![codes(&KeptFactors::load(path)?, rounds, folder, &|_| ())?]);
    }
    progress(Knob::Passes.title());
    let passes = factors(&Btf::open(path)?, settings, rounds, &|_| ())?;
    progress(Knob::Quantizer.title());
    let (btf, made, factorized) = factorize::run(path, settings, &|_| ())?;
    let kept = KeptFactors::new(&btf, made, Some(factorized));
    Ok(vec![codes(&kept, rounds, folder, &|_| ())?, passes])
}

/// A setting by itself.
#[derive(Clone, Debug, Serialize)]
pub struct Row<'a> {
    knob: Knob,
    is_default: bool,
    #[serde(flatten)]
    point: &'a Point,
}

impl Results {
    /// All settings of all knobs.
    pub fn settings(&self) -> Vec<Row<'_>> {
        let of = |family: &Family, at: usize, point| Row {
            knob: family.knob,
            is_default: at == family.default,
            point,
        };
        self.families
            .iter()
            .flat_map(|family| {
                family
                    .points
                    .iter()
                    .enumerate()
                    .map(move |(at, point)| of(family, at, point))
            })
            .collect()
    }
}
