//! What a set of images holds, before any of them is decoded.

use std::collections::BTreeMap;
use std::path::Path;

use super::ImageSet;
use super::collection::{Collection, extension, has_extension};
use super::grid::{Grid, Placed, arrange};
use super::names::Scheme;
use super::placing::{Placing, READ, by_names, by_table};
use super::wording::{MAX_NAMES, count, list, list_of};
use crate::npy::Sampling;
use crate::source::Overrides;
use crate::source::decode::Reading;
use crate::{Btf, Error, Result};

/// Extensions of images that are not read.
const UNREAD: [&str; 14] = [
    "tif", "tiff", "bmp", "tga", "ppm", "pgm", "pfm", "gif", "webp", "jp2", "jxl", "avif", "dng", "raw",
];

/// A set of images in order, and what is wrong with it.
#[derive(Debug)]
pub(in crate::source) struct Survey {
    collection: Collection,
    pub(in crate::source) format: String,
    scheme: Scheme,
    grid: Grid,
    /// Images that have directions.
    pub(in crate::source) images: usize,
    /// What keeps it from being a BTF; empty if nothing does.
    pub(in crate::source) problems: Vec<String>,
    /// What is worth knowing.
    notes: Vec<String>,
}

/// Looks at a folder, a zip, or a table of directions in a folder. Only lists and tables are read.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] where there is no set of images at all. What is wrong with a set is in
/// [`Survey::problems`].
pub(in crate::source) fn survey(path: &Path) -> Result<Survey> {
    let is_table = has_extension(&path.to_string_lossy(), &["csv"]);
    let collection = if path.is_dir() {
        Collection::folder(path)?
    } else if is_table {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        Collection::folder(folder.unwrap_or(Path::new(".")))?
    } else {
        Collection::zip(path)?
    };
    let wanted = path
        .file_name()
        .filter(|_| is_table)
        .map(|name| name.to_string_lossy());
    let placing = match by_table(&collection, wanted.as_deref())? {
        Some(placing) => placing,
        None => by_names(&collection),
    };
    let Placing {
        images,
        scheme,
        problems,
        notes,
    } = placing;
    if images.is_empty() && problems.is_empty() {
        return Err(nothing(&collection));
    }
    let mut survey = Survey {
        format: describe(&collection, &images, scheme),
        scheme,
        grid: arrange(&images),
        images: images.len(),
        problems,
        notes,
        collection,
    };
    survey.judge();
    Ok(survey)
}

impl Survey {
    /// Finds what is missing, there twice, or too many.
    fn judge(&mut self) {
        let grid = &self.grid;
        let (views, lights) = (grid.views.len(), grid.lights.len());
        let most = tileset::MAX_DIRECTIONS as usize;
        for (what, directions) in [("views", views), ("lights", lights)] {
            if directions > most {
                self.problems.push(format!(
                    "{} images have {directions} different {what}, accepted are {most}: in a BTF all views share the \
                     same lights",
                    self.images
                ));
            }
        }
        let files = self.collection.files();
        let twice: Vec<String> = grid
            .duplicates
            .iter()
            .take(MAX_NAMES + 1)
            .map(|&(first, second)| format!("{} and {}", files[first].name, files[second].name))
            .collect();
        if !twice.is_empty() {
            self.problems.push(format!(
                "{} of images with the same view and light: {}",
                count(grid.duplicates.len(), "pair"),
                list(&twice)
            ));
        }
        let missing = grid.holes().count();
        if missing == 0 {
            return;
        }
        let holes: Vec<String> = grid
            .holes()
            .take(MAX_NAMES + 1)
            .map(|hole| grid.name(hole))
            .collect();
        let mut detail = format!(
            "{missing} of the {} images of {views} views x {lights} lights missing: {}",
            views * lights,
            list_of(missing, &holes)
        );
        let mut by_view: BTreeMap<usize, usize> = BTreeMap::new();
        grid.holes()
            .for_each(|(view, _)| *by_view.entry(view).or_default() += 1);
        if by_view.len() == views && views > 1 {
            // Nothing is complete: more likely a sampling that differs from view to view than lost files.
            let counts = by_view.values().map(|missing| lights - missing);
            detail += &format!(
                "; lights differ between views: of {lights} lights in all each view has {} to {}, expected the same \
                 lights for every view",
                counts.clone().min().unwrap_or(0),
                counts.max().unwrap_or(0)
            );
        } else {
            detail += &format!("; {} of the views incomplete", by_view.len());
        }
        self.problems.push(detail);
    }

    /// Directions, wrapping and cosine as far as they are known.
    pub(in crate::source) fn sampling(&self, overrides: &Overrides) -> Sampling {
        Sampling {
            views: self.grid.views.clone(),
            lights: self.grid.lights.clone(),
            wrap: overrides.wrap.unwrap_or(false),
            cosine: overrides.cosine.unwrap_or(self.scheme.cosine()),
        }
    }

    /// What is worth knowing.
    pub(in crate::source) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Pairs of view and light without an image, and the names of the first of them.
    pub(in crate::source) fn missing(&self) -> (usize, Vec<String>) {
        let names = self
            .grid
            .holes()
            .take(MAX_NAMES)
            .map(|hole| self.grid.name(hole))
            .collect();
        (self.grid.holes().count(), names)
    }

    /// The BTF.
    ///
    /// # Errors
    /// [`Error::Format`] with the problems of the set, or if the first image has no good header.
    pub(in crate::source) fn open(mut self, path: &Path, overrides: &Overrides) -> Result<Btf> {
        if !self.problems.is_empty() {
            return Err(Error::format(path, self.problems.join("; ")));
        }
        let sampling = self.sampling(overrides);
        let files: Vec<usize> = self.grid.files.iter().flatten().copied().collect();
        let header = self.collection.header(files[0])?;
        let size = header.size;
        let exr_rgb_is_xyz = self.scheme == Scheme::Utia;
        if exr_rgb_is_xyz && overrides.color.is_none() && self.format.contains("EXR") {
            self.notes.push(
                "channels R, G, B of OpenEXR images are taken as X, Y, Z, as in the UTIA database, unless they say \
                 their primaries"
                    .into(),
            );
        }
        if overrides.cosine.is_none() {
            let is = if sampling.cosine {
                "included, as in photographs"
            } else {
                "left out"
            };
            self.notes.push(format!(
                "the cosine of the light is taken as {is}; nothing in the files says it"
            ));
        }
        let color = overrides.color;
        let images = ImageSet {
            files,
            size,
            decoded_bytes: header.decoded_bytes,
            reading: Reading {
                color,
                exr_rgb_is_xyz,
            },
            format: self.format,
            notes: self.notes,
            collection: self.collection,
        };
        Btf::new(path, sampling, size, Box::new(images))
    }
}

/// The format for people.
fn describe(collection: &Collection, placed: &[Placed], scheme: Scheme) -> String {
    let files = collection.files();
    let mut extensions: Vec<String> = placed
        .iter()
        .map(|image| extension(&files[image.file].name).to_ascii_uppercase())
        .collect();
    extensions.sort();
    extensions.dedup();
    format!(
        "{} of {} images {}",
        collection.kind(),
        extensions.join(" and "),
        scheme.name()
    )
}

/// The error where no image has a direction.
fn nothing(collection: &Collection) -> Error {
    let files = collection.files();
    let images = files
        .iter()
        .filter(|file| has_extension(&file.name, &READ))
        .count();
    let unread = files
        .iter()
        .filter(|file| has_extension(&file.name, &UNREAD))
        .count();
    let mut detail = format!("holds {}, {images} of them images", count(files.len(), "file"));
    if unread > 0 {
        detail += &format!(" that are read and {unread} that are not: convert them to PNG or OpenEXR");
    }
    if images > 0 {
        detail += ", none with directions: name them as tv30_pv60_tl15_pl0.png (degrees), or add a table \
                   directions.csv with columns file,theta_view,phi_view,theta_light,phi_light";
    } else if unread == 0 {
        detail += "; expected JPEG, PNG, OpenEXR or Radiance HDR images";
    }
    Error::format(collection.path(), detail)
}
