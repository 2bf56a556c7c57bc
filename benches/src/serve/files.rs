//! The records of an archive as files, under the addresses that the tile server gives them.

use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

use tileset::{Archive, PageId};

use crate::{Error, Result};

/// A folder for nginx, one for us, and the addresses that both answer.
pub(super) struct Site {
    folder: tempfile::TempDir,
    /// Paths of pages, in an order that jumps through the archive.
    pub(super) targets: Vec<String>,
    pub(super) mean_bytes: f64,
}

impl Site {
    pub(super) fn write(archive: &Path) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(Error::io(&std::env::temp_dir(), "make a folder in"))?;
        readable(folder.path())?;
        let site = |name: &str| {
            let path = folder.path().join(name);
            fs::create_dir_all(&path).map_err(Error::io(&path, "make"))?;
            Ok::<_, Error>(path)
        };
        let (files, tiles) = (site("files")?, site("tiles")?);
        fs::copy(archive, tiles.join("load.bsvtf")).map_err(Error::io(archive, "copy"))?;
        let opened = File::open(archive).map_err(Error::io(archive, "open"))?;
        let opened = Archive::open(opened).map_err(Error::archive(archive))?;
        let index = &opened.index;
        let (mut targets, mut bytes) = (Vec::new(), 0);
        for group in 0..index.manifest.groups() as u16 {
            for tile in index.pyramid.tiles() {
                let record = opened
                    .page_record(PageId { group, tile })
                    .map_err(Error::archive(archive))?;
                // Pages that are not stored are an answer without a body, for which nginx needs no file.
                if record.is_empty() {
                    continue;
                }
                let target = format!(
                    "/v1/load/{:032x}/page/{group}/{}/{}/{}",
                    index.id, tile.mip, tile.x, tile.y
                );
                let path = files.join(&target[1..]);
                let parent = path.parent().unwrap_or(&files);
                fs::create_dir_all(parent).map_err(Error::io(parent, "make"))?;
                bytes += record.len();
                fs::write(&path, record).map_err(Error::io(&path, "write"))?;
                targets.push(target);
            }
        }
        if targets.is_empty() {
            return Err(Error::Invalid {
                what: "number of pages of the archive",
                found: "0".into(),
                expected: "1 or more",
            });
        }
        let mean_bytes = bytes as f64 / targets.len() as f64;
        // A step without a common divisor visits all.
        let count = targets.len();
        let step = (count * 5 / 8..).find(|step| coprime(*step, count)).unwrap_or(1);
        let targets = (0..count).map(|at| targets[at * step % count].clone()).collect();
        Ok(Self {
            folder,
            targets,
            mean_bytes,
        })
    }

    pub(super) fn files(&self) -> PathBuf {
        self.folder.path().join("files")
    }

    pub(super) fn tiles(&self) -> PathBuf {
        self.folder.path().join("tiles")
    }

    /// For what hosts and programs want in a file.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

fn coprime(a: usize, b: usize) -> bool {
    let (mut a, mut b) = (a, b);
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a == 1
}

/// nginx's workers are another user's if root starts it.
fn readable(folder: &Path) -> Result<()> {
    #[cfg(unix)]
    fs::set_permissions(folder, std::os::unix::fs::PermissionsExt::from_mode(0o755))
        .map_err(Error::io(folder, "open to others"))?;
    let _ = folder;
    Ok(())
}
