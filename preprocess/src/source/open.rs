//! Which format a path holds.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::decode::Color;
use super::image_set::survey;
use crate::npy::NpyBtf;
use crate::{Btf, Error, Result};

/// What the user knows better than the files, or what no file says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overrides {
    /// Whether the material repeats in both directions. Sets of images do not say; without this they do not repeat.
    pub wrap: Option<bool>,
    /// Whether the samples include the cosine of the light's polar angle. Sets of images do not say; without this it
    /// is taken as included in the databases of photographs of Bonn and UTIA, and as left out elsewhere.
    pub cosine: Option<bool>,
    /// What the numbers in images mean. Without this the encoding decides: see [`Color`].
    pub color: Option<Color>,
}

/// What a path holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Npy,
    /// An UBO `.btf` file.
    BtfFile,
    /// A folder, a zip, or a table of directions beside images.
    Images,
}

/// Tells the format by content, and by the name where that is the only hint.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] naming what is accepted.
pub(super) fn kind(path: &Path) -> Result<Kind> {
    let extension = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase();
    let metadata = std::fs::metadata(path).map_err(Error::io(path, "open"))?;
    if metadata.is_dir() {
        return Ok(Kind::Images);
    }
    if !metadata.is_file() {
        return Err(Error::format(path, "is neither a file nor a folder"));
    }
    let mut first = Vec::new();
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    file.take(8)
        .read_to_end(&mut first)
        .map_err(Error::io(path, "read"))?;
    let begins = |magic: &[u8]| first.starts_with(magic);
    if begins(b"PK\x03\x04") || begins(b"PK\x05\x06") || extension == "zip" || extension == "csv" {
        return Ok(Kind::Images);
    }
    if super::btf_file::is_btf_file(path) {
        return Ok(Kind::BtfFile);
    }
    if begins(b"\x93NUMPY") || extension == "npy" {
        return Ok(Kind::Npy);
    }
    if super::decode::is_image(&first) || ["jpg", "jpeg", "png", "exr", "hdr"].contains(&extension.as_str()) {
        return Err(Error::format(
            path,
            "is a single image: give the folder that holds all images of the BTF",
        ));
    }
    Err(Error::format(
        path,
        "is no BTF that is known: expected a .npy file with its .json, a .btf file, a folder or a zip of images, a \
         table of directions (.csv) beside images",
    ))
}

pub(super) fn open(path: &Path, overrides: &Overrides) -> Result<Btf> {
    let kind = kind(path)?;
    if kind != Kind::Images && overrides.color.is_some() {
        return Err(Error::Invalid {
            what: "the colour of images",
            found: format!("given for {}", path.display()),
            expected: "given for sets of images only: this file is linear RGB",
        });
    }
    let btf = match kind {
        Kind::BtfFile => super::btf_file::open(path)?,
        Kind::Images => survey(path)?.open(path, overrides)?,
        Kind::Npy => {
            let npy = NpyBtf::open(path)?;
            let (sampling, size) = (npy.sampling().clone(), (npy.width(), npy.height()));
            Btf::new(path, sampling, size, Box::new(npy))?
        }
    };
    Ok(btf.with(overrides))
}
