//! What the measurements of a scene have in common: where its archives are, and the way of the camera.

use std::path::{Path, PathBuf};

use ::benches::engine::{Archives, Subject, orbit};
use anyhow::{Context, Result};
use clap::Args;
use scenes::{Camera, CameraPath, Scene};

use crate::cache::CacheArguments;
use crate::render::own_folder;

/// Arguments beside a scene, whose own argument is called `scene`.
#[derive(Args)]
pub(super) struct Viewed {
    /// Tile server (http://HOST:PORT) or folder of archives of the scene; without it the scene's own folder.
    #[arg(long, value_name = "URL|DIR", requires = "scene")]
    tiles: Option<String>,
    #[command(flatten)]
    cache: CacheArguments,
    /// Camera path through the scene; without it a quarter of a circle around it.
    #[arg(long, visible_alias = "path", value_name = "PATH.json", requires = "scene")]
    camera: Option<PathBuf>,
    /// Prints what was measured as JSON, and no progress.
    #[arg(long)]
    pub(super) json: bool,
}

impl Viewed {
    /// A scene with so many views on its way, and in flight, for pictures of a size.
    pub(super) fn subject(
        &self,
        path: &Path,
        size: (u32, u32),
        frames: usize,
        flight_frames: usize,
    ) -> Result<Subject> {
        let scenes::gltf::Loaded { scene, notes } = scenes::gltf::open(path)?;
        if !self.json {
            notes.iter().for_each(|note| eprintln!("note: {note}"));
        }
        Ok(Subject {
            name: name(path),
            cameras: self.cameras(&scene, size, frames)?,
            flight: self.cameras(&scene, size, flight_frames)?,
            archives: self.archives(self.tiles.clone().map_or_else(|| own_folder(path), Ok)?)?,
            scene,
        })
    }

    /// Archives of a tile server or folder.
    pub(super) fn archives(&self, tiles: String) -> Result<Archives> {
        Ok(Archives::At(tiles, self.cache.open_options()?))
    }

    /// Where archives are, if that is given.
    pub(super) fn tiles(&self) -> Option<String> {
        self.tiles.clone()
    }

    /// Whether a camera path is given.
    pub(super) fn has_path(&self) -> bool {
        self.camera.is_some()
    }

    /// Views along the path, or around the scene.
    fn cameras(&self, scene: &Scene, size: (u32, u32), frames: usize) -> Result<Vec<Camera>> {
        match &self.camera {
            Some(path) => Ok(CameraPath::load(path)?.frames(frames).collect()),
            None => Ok(orbit(scene, size.0 as f32 / size.1 as f32, frames)),
        }
    }
}

/// The folder and the name of a scene: most are called "scene".
fn name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = path.parent().and_then(Path::file_name);
    folder.map_or_else(
        || stem.to_string(),
        |folder| format!("{}/{stem}", folder.to_string_lossy()),
    )
}

/// Bytes for pages and for columns, two to one, of so many mebibytes for both.
pub(super) fn cache_bytes(cache_mib: u64) -> Result<[u64; 2]> {
    let bytes = cache_mib
        .checked_mul(1 << 20)
        .context("--cache-mib is too large")?;
    Ok([bytes - bytes / 3, bytes / 3])
}
