//! A BTF of any format.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tileset::Direction;

use super::repair::Repaired;
use super::{Images, LowRank, Overrides, Repairs};
use crate::npy::{CHANNELS, MAX_SAMPLE, Samples, Sampling};
use crate::{Error, Result};

/// A BTF: samples `[view][light][rgb][y][x]`, linear; radiance factors with the cosine left out or in, as
/// [`Sampling::cosine`] says.
///
/// As a matrix it has one row for every (view, light, rgb) and one column for every texel.
#[derive(Debug)]
pub struct Btf {
    path: PathBuf,
    name: String,
    sampling: Sampling,
    width: u32,
    height: u32,
    images: Box<dyn Images>,
}

impl Btf {
    /// Opens a BTF of any known format; which one is told by its content. Nothing of the samples is read yet.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] saying which part of which file contradicts what.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_with(path, &Overrides::default())
    }

    /// [`Btf::open`], but what the user says counts more than the files.
    ///
    /// # Errors
    /// As [`Btf::open`]; [`Error::Invalid`] for an override that the format has no use for.
    pub fn open_with(path: &Path, overrides: &Overrides) -> Result<Self> {
        super::open::open(path, overrides)
    }

    /// The same BTF with another opinion about wrapping and cosine.
    pub(super) fn with(mut self, overrides: &Overrides) -> Self {
        self.sampling.wrap = overrides.wrap.unwrap_or(self.sampling.wrap);
        self.sampling.cosine = overrides.cosine.unwrap_or(self.sampling.cosine);
        self
    }

    /// A BTF from its parts; its name is that of the file or folder without extension.
    ///
    /// # Errors
    /// [`Error::Format`] for directions or sides that no archive accepts.
    pub fn new(
        path: &Path,
        sampling: Sampling,
        (width, height): (u32, u32),
        images: Box<dyn Images>,
    ) -> Result<Self> {
        sampling.check().map_err(|detail| Error::format(path, detail))?;
        let sides = 1..=tileset::MAX_SIDE_TEXELS;
        if !sides.contains(&width) || !sides.contains(&height) {
            let detail = format!(
                "{width}x{height} texels, accepted are 1 to {} a side",
                sides.end()
            );
            return Err(Error::format(path, detail));
        }
        let name = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        Ok(Self {
            path: path.to_owned(),
            name,
            sampling,
            width,
            height,
            images,
        })
    }

    /// The same BTF with its bad samples filled while they are read: NaN, infinities, and values beyond
    /// [`MAX_SAMPLE`]. A hole takes the mean of what surrounds it; a channel of an image without any good sample that of
    /// the image under the angularly nearest light, or of the nearest view. The second value counts what was repaired.
    ///
    /// Reading such a BTF fails with [`Error::Format`] where no image of it has a good sample in some channel.
    pub fn repaired(self) -> (Self, Arc<Repairs>) {
        let images = Repaired::new(&self.path, &self.sampling, (self.width, self.height), self.images);
        let repairs = images.repairs();
        let images = Box::new(images);
        (Self { images, ..self }, repairs)
    }

    /// The file or folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's name without its extension.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The format for people.
    pub fn format(&self) -> String {
        self.images.format()
    }

    /// Directions, wrapping, cosine.
    pub fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    /// View directions ωo.
    pub fn views(&self) -> &[Direction] {
        &self.sampling.views
    }

    /// Light directions ωi.
    pub fn lights(&self) -> &[Direction] {
        &self.sampling.lights
    }

    /// Whether the material repeats in both directions.
    pub fn wrap(&self) -> bool {
        self.sampling.wrap
    }

    /// Whether the samples include the cosine of the light's polar angle.
    pub fn cosine(&self) -> bool {
        self.sampling.cosine
    }

    /// Texels in a row of the picture.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows of the picture.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Images: views × lights.
    pub fn image_count(&self) -> usize {
        self.views().len() * self.lights().len()
    }

    /// Rows of the matrix: views × lights × 3.
    pub fn rows(&self) -> usize {
        self.image_count() * 3
    }

    /// Columns of the matrix: texels, width × height.
    pub fn columns(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Bytes that one pass over all samples reads from the disk.
    pub fn stored_bytes(&self) -> u64 {
        self.images.stored_bytes()
    }

    /// Bytes of memory that a sample takes while it is worked on.
    pub fn sample_bytes(&self) -> usize {
        self.images.sample_bytes()
    }

    /// Bytes of memory that each thread takes beside the samples while it makes them.
    pub fn decoding_bytes(&self) -> u64 {
        self.images.decoding_bytes()
    }

    /// The samples of consecutive images, `[image][rgb][y][x]`; see [`Images::samples`]. Not checked for NaN and
    /// infinity.
    ///
    /// # Errors
    /// Those of the format.
    ///
    /// # Panics
    /// If `images` ends beyond the last image.
    pub fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        assert!(images.end <= self.image_count(), "images of the BTF");
        self.images.samples(images, buffer)
    }

    /// The BTF as a product of factors, where its file holds one.
    ///
    /// # Errors
    /// Those of the format.
    pub fn low_rank(&self) -> Result<Option<LowRank>> {
        self.images.low_rank()
    }

    /// Starts to fetch images that are needed soon.
    pub(crate) fn prefetch(&self, images: Range<usize>) {
        self.images.prefetch(images);
    }

    /// Says that these images are not needed any more for now.
    pub(crate) fn release(&self, images: Range<usize>) {
        self.images.release(images);
    }

    /// What is worth knowing beside all this: files left out, assumptions made.
    pub fn notes(&self) -> Vec<String> {
        self.images.notes()
    }

    /// Looks at an image without decoding it; see [`Images::check`].
    ///
    /// # Errors
    /// Those of the format.
    pub fn check_image(&self, image: usize) -> Result<()> {
        self.images.check(image)
    }

    /// Where an image stands, for errors.
    pub fn place(&self, image: usize) -> String {
        self.images.place(image)
    }

    /// The error for the first sample in `samples`, those of the images from `first` on, that is not finite or too
    /// large, if there is one.
    pub(crate) fn bad_sample(&self, first: usize, samples: &Samples<'_>) -> Option<Error> {
        let bad = |value: f64| !value.is_finite() || value.abs() > MAX_SAMPLE;
        let index = (0..samples.len()).find(|&index| bad(samples.get(index)))?;
        let (row, texel) = (first * 3 + index / self.columns(), index % self.columns());
        let image = row / 3;
        Some(Error::BadSample {
            path: self.path.clone(),
            place: self.place(image),
            view: image / self.lights().len(),
            light: image % self.lights().len(),
            channel: CHANNELS[row % 3],
            x: texel % self.width as usize,
            y: texel / self.width as usize,
            value: samples.get(index),
        })
    }
}
