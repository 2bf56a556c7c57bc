//! The materials of the demo: synthesized, factorized, and kept for the next time.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ::preprocess::npy::NpyBtf;
use anyhow::Result;
use scenes::synth::SynthOptions;
use serde::Serialize;
use tileset::Archive;

use crate::{inspect, preprocess, synth};

/// A material of the demo, and what it took. Seconds are zero for what was there already.
#[derive(Serialize)]
pub(crate) struct Made {
    pub(crate) name: String,
    pub(crate) synth_seconds: f64,
    pub(crate) preprocess_seconds: f64,
    /// Uncompressed samples.
    pub(crate) btf_bytes: u64,
    pub(crate) archive_bytes: u64,
    /// Stated error relative to the root mean square of the BTF.
    pub(crate) total_relative: f64,
    pub(crate) total_rms: f64,
}

/// How all materials are made.
pub(crate) struct Recipe {
    pub(crate) size: u32,
    pub(crate) job: preprocess::Job,
}

/// Where a material's samples and its archive are.
pub(crate) fn paths(folder: &Path, name: &str) -> (PathBuf, PathBuf) {
    (
        folder.join("npy").join(format!("{name}.npy")),
        folder.join("tiles").join(format!("{name}.bsvtf")),
    )
}

/// Makes a material, or what of it is missing. Files get their names when they are complete, so what is there
/// is whole; it is used again if it has the size asked for.
pub(crate) fn make(folder: &Path, name: &str, recipe: &Recipe, quiet: bool) -> Result<Made> {
    let (npy, archive) = paths(folder, name);
    let mut made = Made {
        name: name.into(),
        synth_seconds: 0.0,
        preprocess_seconds: 0.0,
        btf_bytes: 0,
        archive_bytes: 0,
        total_relative: 0.0,
        total_rms: 0.0,
    };
    let usable = |btf: &NpyBtf| (btf.width(), btf.height()) == (recipe.size, recipe.size);
    let mut fresh = false;
    if !NpyBtf::open(&npy).is_ok_and(|btf| usable(&btf)) {
        let options = SynthOptions {
            size: recipe.size,
            ..SynthOptions::default()
        };
        made.synth_seconds = synth::synthesize_to(name, &options, &npy, quiet)?.seconds;
        fresh = true;
    }
    if fresh || !is_archive_of(&archive, recipe) {
        let start = Instant::now();
        preprocess::build(&npy, &archive, &recipe.job, &format!("{name}: "), quiet)?;
        made.preprocess_seconds = start.elapsed().as_secs_f64();
    }
    made.btf_bytes = NpyBtf::open(&npy)?.sample_bytes();
    let contents = inspect::read(&archive)?;
    made.archive_bytes = contents.file_bytes;
    (made.total_relative, made.total_rms) = (contents.errors.total_relative, contents.errors.total_rms);
    Ok(made)
}

fn is_archive_of(path: &Path, recipe: &Recipe) -> bool {
    let archive = File::open(path).ok().and_then(|file| Archive::open(file).ok());
    archive.is_some_and(|archive| {
        let manifest = &archive.index.manifest;
        (manifest.width, manifest.height) == (recipe.size, recipe.size)
            && manifest.components == recipe.job.components
    })
}
