//! The archives of a scene: what is there, and making what is not.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ::preprocess::npy::NpyBtf;
use anyhow::{Context, Result, ensure};
use scenes::paper::{PATCHES, Recipe};
use scenes::synth::{Sampling, Style, SynthOptions};
use serde::Serialize;
use serde_json::{Value, json};
use tileset::Archive;

use super::blend;
use super::estimate::duration;
use crate::{bytes, file, preprocess, synth};

/// Version of the procedures: archives of an older one are made again.
const VERSION: u32 = 1;

/// What to make, where, and how.
pub(super) struct Plan {
    pub(super) folder: PathBuf,
    pub(super) recipes: Vec<Recipe>,
    pub(super) sampling: Sampling,
    pub(super) components: u32,
    pub(super) quiet: bool,
}

/// An archive, and what it took; no seconds for what was there already.
#[derive(Serialize)]
pub(super) struct Made {
    archive: String,
    size: u32,
    pub(super) archive_bytes: u64,
    seconds: f64,
}

/// A material as it is traced: all of a small one, a patch of a large one.
struct Trace<'a> {
    recipe: &'a Recipe,
    style: Style,
    size: u32,
}

impl Plan {
    /// Refuses what cannot be made, before anything is begun.
    pub(super) fn check(&self) -> Result<()> {
        let directions = self.sampling.directions().len() as u64;
        let rows = directions * directions * 3;
        ensure!(
            (1..=rows).contains(&u64::from(self.components)) && self.components <= tileset::MAX_COMPONENTS,
            "--components is {}; choose 1 to {}",
            self.components,
            rows.min(tileset::MAX_COMPONENTS.into())
        );
        Ok(())
    }

    /// What is not there yet.
    pub(super) fn missing(&self) -> Vec<&Recipe> {
        self.recipes
            .iter()
            .filter(|recipe| !self.is_there(recipe))
            .collect()
    }

    /// Makes what is not there; all of it.
    pub(super) fn make(&self) -> Result<Vec<Made>> {
        for part in ["tiles", "work"] {
            file::make_folder(&self.folder.join(part))?;
        }
        let (start, mut left) = (Instant::now(), self.missing().len());
        let mut fresh = 0;
        let made = self.recipes.iter().map(|recipe| {
            let began = Instant::now();
            let missing = !self.is_there(recipe);
            if missing {
                self.make_one(recipe)
                    .with_context(|| format!("cannot make {}", recipe.archive))?;
                (left, fresh) = (left.saturating_sub(1), fresh + 1);
            }
            let archive = self.archive(recipe);
            let made = Made {
                archive: recipe.archive.clone(),
                size: recipe.size,
                archive_bytes: std::fs::metadata(&archive).map_or(0, |metadata| metadata.len()),
                seconds: if missing {
                    began.elapsed().as_secs_f64()
                } else {
                    0.0
                },
            };
            if missing && !self.quiet {
                let ahead = start.elapsed().as_secs_f64() / f64::from(fresh) * left as f64;
                eprintln!(
                    "{:16} {}² in {:.1} s, {}; {left} to make, about {}",
                    made.archive,
                    made.size,
                    made.seconds,
                    bytes::text(made.archive_bytes),
                    duration(ahead)
                );
            }
            Ok(made)
        });
        let made = made.collect::<Result<_>>()?;
        // Empty unless something else was put there.
        let _ = std::fs::remove_dir(self.folder.join("work"));
        Ok(made)
    }

    fn archive(&self, recipe: &Recipe) -> PathBuf {
        self.folder
            .join("tiles")
            .join(format!("{}.bsvtf", recipe.archive))
    }

    /// Stands beside the archive and says how it was made.
    fn note(&self, recipe: &Recipe) -> PathBuf {
        self.archive(recipe).with_extension("recipe.json")
    }

    /// Everything on which an archive depends.
    fn parameters(&self, recipe: &Recipe) -> Value {
        let style = |style: &Style| {
            json!({
                "pattern": style.pattern, "hue": style.hue, "saturation": style.saturation,
                "brightness": style.brightness, "roughness": style.roughness, "relief": style.relief,
            })
        };
        json!({
            "version": VERSION,
            "material": recipe.material,
            "seed": recipe.seed,
            "size": recipe.size,
            "style": style(&recipe.style),
            "worn": recipe.worn.as_ref().map(style),
            "directions": self.sampling.directions().len(),
            "components": self.components,
        })
    }

    fn is_there(&self, recipe: &Recipe) -> bool {
        let noted = std::fs::read(self.note(recipe)).ok();
        // Numbers go through text, so that they are compared as they are stored.
        let same = noted.is_some_and(|noted| noted == self.parameters(recipe).to_string().into_bytes());
        let archive = File::open(self.archive(recipe))
            .ok()
            .and_then(|file| Archive::open(file).ok());
        same && archive.is_some_and(|archive| archive.index.manifest.width == recipe.size)
    }

    fn make_one(&self, recipe: &Recipe) -> Result<()> {
        let archive = self.archive(recipe);
        // The note first goes, and comes back last: a note never stands beside another archive.
        let _ = std::fs::remove_file(self.note(recipe));
        match &recipe.worn {
            None => {
                let trace = Trace {
                    recipe,
                    style: recipe.style,
                    size: recipe.size,
                };
                let npy = self.traced(&trace)?;
                let job = preprocess::Job {
                    components: self.components,
                    quality: None,
                    memory: None,
                };
                preprocess::build(&npy, &archive, &job, &format!("{}: ", recipe.archive), self.quiet)?;
                discard(&npy);
            }
            Some(worn) => {
                let size = recipe.size / PATCHES;
                let patch = |style| Trace { recipe, style, size };
                let (fresh, worn) = (patch(recipe.style), patch(*worn));
                let npys = [self.traced(&fresh)?, self.traced(&worn)?];
                blend::build(&npys, &archive, self.components, &recipe.archive, self.quiet)?;
                npys.iter().for_each(|npy| discard(npy));
            }
        }
        file::write(&self.note(recipe), self.parameters(recipe).to_string().as_bytes())
    }

    /// The samples of a material. A file gets its name when it is complete, and the name says what is in it: what an
    /// interrupted run has traced is used again.
    fn traced(&self, trace: &Trace<'_>) -> Result<PathBuf> {
        let Trace { recipe, style, size } = trace;
        let directions = self.sampling.directions();
        let identity = format!(
            "{VERSION} {} {} {style:?} {size} {}",
            recipe.material,
            recipe.seed,
            directions.len()
        );
        let name = format!("{}-{:016x}.npy", recipe.archive, fnv(identity.as_bytes()));
        let path = self.folder.join("work").join(name);
        if NpyBtf::open(&path).is_err() {
            let options = SynthOptions {
                size: *size,
                views: directions.clone(),
                lights: directions,
                seed: recipe.seed,
                style: *style,
                ..SynthOptions::default()
            };
            synth::synthesize_to(recipe.material, &options, &path, self.quiet)?;
        }
        Ok(path)
    }
}

/// Removes samples and directions. What cannot be removed is in nobody's way.
fn discard(npy: &Path) {
    let _ = std::fs::remove_file(npy);
    let _ = std::fs::remove_file(npy.with_extension("json"));
}

/// Fowler, Noll and Vo's hash, FNV-1a.
fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
