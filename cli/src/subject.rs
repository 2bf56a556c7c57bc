//! What is shown: a scene, or one archive alone.

use std::path::Path;

use anyhow::{Context as _, Result};
use viewer::Subject;

use crate::render::own_folder;

/// What was named on the command line.
pub(crate) struct Named {
    /// A scene, or the name of an archive.
    pub(crate) subject: Subject,
    /// The name of the file, without its extension.
    pub(crate) name: String,
    /// Where the archives are.
    pub(crate) tiles: String,
    /// What of the scene is not shown as it was written.
    pub(crate) notes: Vec<String>,
}

/// Reads the scene at `path`, or takes it for an archive: a `.bsvtf` file, or just the name of one among `tiles`. Without `tiles` archives are
/// looked for in the folder of `path`.
///
/// # Errors
/// If the file is not there or is no scene, or the name is not UTF-8.
pub(crate) fn open(path: &Path, tiles: Option<&str>) -> Result<Named> {
    let name = path
        .file_stem()
        .and_then(|name| name.to_str())
        .with_context(|| format!("{}: not a name in UTF-8", path.display()))?
        .to_owned();
    let is_archive = match path.extension() {
        Some(extension) => extension.eq_ignore_ascii_case("bsvtf"),
        None => tiles.is_some(),
    };
    let there = tiles.map_or_else(|| own_folder(path), |tiles| Ok(tiles.to_owned()))?;
    let (subject, notes) = if is_archive {
        if tiles.is_none() {
            std::fs::File::open(path)
                .with_context(|| format!("{}: give an archive, or --tiles and its name", path.display()))?;
        }
        (Subject::Archive(name.clone()), Vec::new())
    } else {
        let scenes::gltf::Loaded { scene, notes } = scenes::gltf::open(path)?;
        (Subject::Scene(scene), notes)
    };
    Ok(Named {
        subject,
        name,
        tiles: there,
        notes,
    })
}
