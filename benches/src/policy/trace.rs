//! Votes of a camera's way, on disk.

use std::io::{BufRead, Write};

use engine::residency::{MaterialId, MaterialInfo, Vote};
use serde::{Deserialize, Serialize};
use tileset::Pyramid;

use crate::{Error, Result};

/// What the first line says it is.
const FORMAT: &str = "eigentile votes 1";
/// Most pages of all materials: what is read is kept in memory.
const MOST_PAGES: u64 = 1 << 26;

/// A material as residency sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TraceMaterial {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Whether it repeats.
    pub wrap: bool,
    /// Component groups.
    pub groups: u16,
    /// w of each page, `[group][tile]`, in reflectance².
    pub weights: Vec<f32>,
}

impl TraceMaterial {
    /// For the engine.
    ///
    /// # Errors
    /// [`Error::Trace`] for a size that no material has, or another number of weights than of pages.
    pub fn info(&self) -> Result<MaterialInfo> {
        let pyramid = Pyramid::new(self.width, self.height, self.wrap).map_err(|error| {
            Error::Trace(format!(
                "a material of {}×{} texels: {error}",
                self.width, self.height
            ))
        })?;
        let pages = u64::from(pyramid.tile_count()) * u64::from(self.groups);
        if pages != self.weights.len() as u64 {
            let there = self.weights.len();
            return Err(Error::Trace(format!(
                "{there} weights of a material of {pages} pages: one each is expected"
            )));
        }
        Ok(MaterialInfo {
            pyramid,
            groups: self.groups,
            weights: self.weights.clone(),
            visibility: Vec::new(),
            page_bytes: Vec::new(),
            column_bytes: Vec::new(),
        })
    }
}

/// Votes by frame, and the materials that they are for.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// What it shows.
    pub name: String,
    /// Materials, by id.
    pub materials: Vec<TraceMaterial>,
    /// Votes of each frame.
    pub frames: Vec<Vec<Vote>>,
}

#[derive(Serialize, Deserialize)]
struct Head {
    format: String,
    name: String,
    materials: Vec<TraceMaterial>,
}

impl Trace {
    /// Writes the trace: a line of JSON with the materials, then one for each frame, `[[material, tile, pixels], …]`.
    ///
    /// # Errors
    /// [`Error::Trace`] if it cannot be written.
    pub fn write(&self, mut to: impl Write) -> Result<()> {
        let head = Head {
            format: FORMAT.into(),
            name: self.name.clone(),
            materials: self.materials.clone(),
        };
        let failed = |error: &dyn std::fmt::Display| Error::Trace(format!("cannot be written: {error}"));
        let head = serde_json::to_string(&head).map_err(|error| failed(&error))?;
        writeln!(to, "{head}").map_err(|error| failed(&error))?;
        for frame in &self.frames {
            let votes = frame.iter().map(|vote| (vote.material.0, vote.tile, vote.pixels));
            let votes: Vec<(u16, u32, u32)> = votes.collect();
            let line = serde_json::to_string(&votes).map_err(|error| failed(&error))?;
            writeln!(to, "{line}").map_err(|error| failed(&error))?;
        }
        Ok(())
    }

    /// Reads what [`Trace::write`] has written.
    ///
    /// # Errors
    /// [`Error::Trace`] if it cannot be read, and for anything else than a trace, with the line.
    pub fn read(from: impl BufRead) -> Result<Self> {
        let wrong =
            |line: usize, error: &dyn std::fmt::Display| Error::Trace(format!("line {}: {error}", line + 1));
        let mut lines = from.lines().enumerate();
        let (_, first) = lines
            .next()
            .ok_or_else(|| Error::Trace("an empty file: the first line tells the materials".into()))?;
        let head: Head = serde_json::from_str(&first.map_err(|error| wrong(0, &error))?)
            .map_err(|error| wrong(0, &error))?;
        if head.format != FORMAT {
            return Err(Error::Trace(format!(
                "the format is {:?}, {FORMAT:?} is expected",
                head.format
            )));
        }
        let mut pages = 0u64;
        for material in &head.materials {
            pages += material.info()?.weights.len() as u64;
        }
        if pages > MOST_PAGES {
            return Err(Error::Trace(format!(
                "{pages} pages: at most {MOST_PAGES} can be replayed"
            )));
        }
        let mut frames = Vec::new();
        for (at, line) in lines {
            let votes: Vec<(u16, u32, u32)> = serde_json::from_str(&line.map_err(|error| wrong(at, &error))?)
                .map_err(|error| wrong(at, &error))?;
            let vote = |(material, tile, pixels)| Vote {
                material: MaterialId(material),
                tile,
                pixels,
            };
            frames.push(votes.into_iter().map(vote).collect());
        }
        Ok(Self {
            name: head.name,
            materials: head.materials,
            frames,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace() -> Trace {
        crate::policy::generate(&crate::policy::Synthetic {
            materials: 4,
            side_texels: 128,
            groups: 2,
            frames: 3,
            seed: 1,
        })
    }

    #[test]
    fn what_is_written_is_read() {
        let mut bytes = Vec::new();
        trace().write(&mut bytes).unwrap();
        assert_eq!(Trace::read(&bytes[..]).unwrap(), trace());
    }

    #[test]
    fn what_is_wrong_is_named() {
        let mut bytes = Vec::new();
        trace().write(&mut bytes).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let says = |text: &str, what: &str| {
            let error = Trace::read(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        };
        says("", "an empty file");
        says(&text.replace("votes 1", "votes 2"), "votes 2");
        says(
            &text.replace("\"width\":128", "\"width\":64"),
            "weights of a material",
        );
        says(&text.replace("\"width\":128", "\"width\":0"), "0×128");
        says(&format!("{text}[[0,1]]\n"), "line 5");
    }
}
