//! The archives of a scene: what is there, and making what is not.

use std::fs::File;
use std::path::PathBuf;
use std::time::Instant;

use ::preprocess::{Btf, Factors, Settings, build as coder};
use anyhow::{Context, Result, ensure};
use scenes::paper::{PATCHES, Recipe};
use scenes::synth::{Sampling, Style, SynthOptions};
use serde::Serialize;
use serde_json::{Value, json};
use tileset::Archive;

use super::estimate::duration;
use super::{blend, traced};
use crate::{bytes, file, progress};

/// Version of the procedures: archives of an older one are made again.
const VERSION: u32 = 2;

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
        file::make_folder(&self.folder.join("tiles"))?;
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
        made.collect()
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
        let label = format!("{}: ", recipe.archive);
        let settings = Settings {
            components: self.components,
            ..Settings::default()
        };
        let (btf, factors) = match &recipe.worn {
            None => self.factorized(recipe, &recipe.style, recipe.size, &settings, &label)?,
            Some(worn) => {
                let patch = |style| self.factorized(recipe, style, recipe.size / PATCHES, &settings, &label);
                blend::factorized([patch(&recipe.style)?, patch(worn)?], &archive, &settings)?
            }
        };
        let phases = progress::Phases::new(&label, self.quiet);
        let show = |progress| phases.show(progress);
        coder::build(&btf, &factors, coder::DEFAULT_QUALITY, &archive, &show)?;
        phases.finish();
        file::write(&self.note(recipe), self.parameters(recipe).to_string().as_bytes())
    }

    fn factorized(
        &self,
        recipe: &Recipe,
        style: &Style,
        size: u32,
        settings: &Settings,
        label: &str,
    ) -> Result<(Btf, Factors)> {
        let directions = self.sampling.directions();
        let options = SynthOptions {
            size,
            views: directions.clone(),
            lights: directions,
            seed: recipe.seed,
            style: *style,
            ..SynthOptions::default()
        };
        traced::factorized(
            recipe.material,
            &options,
            &self.archive(recipe),
            settings,
            label,
            self.quiet,
        )
    }
}
