//! BTFs as sets of images, one for every view and light: folders and zips.
//!
//! - `collection`: named files in a folder or a zip.
//! - `names`, `table`: directions from the names, or from a table beside the images.
//! - `placing`: which image shows which directions.
//! - `grid`: the images in order, and what is missing or there twice.
//! - [`survey`](fn@survey): all that can be known without decoding an image.
//! - [`ImageSet`]: the samples.
//!
//! Each image is read and decoded whenever its samples are asked for, on all threads; nothing is kept.

mod collection;
mod grid;
mod names;
mod placing;
mod survey;
mod table;
mod wording;

use std::ops::Range;

use rayon::prelude::*;

use self::collection::Collection;
pub(super) use self::grid::degrees;
pub(super) use self::survey::survey;
use super::Images;
use super::decode::{self, Reading};
use crate::Result;
use crate::npy::Samples;

/// Where the header of an image ends at the latest, as a rule; where it does not, the whole image is read.
const HEADER_BYTES: u64 = 64 << 10;

/// The images of a BTF.
#[derive(Debug)]
pub(super) struct ImageSet {
    collection: Collection,
    /// `[view][light]`: index of the file.
    files: Vec<usize>,
    /// Width and height of all images.
    size: (u32, u32),
    /// Of its decoded samples as they stand in the first image.
    decoded_bytes: u64,
    reading: Reading,
    format: String,
    notes: Vec<String>,
}

impl ImageSet {
    fn decode(&self, image: usize, out: &mut [f32]) -> Result<()> {
        let file = self.files[image];
        let bytes = self.collection.read(file)?;
        decode::decode(&bytes, self.size, self.reading, out)
            .map_err(|detail| self.collection.error(file, detail))
    }
}

impl Images for ImageSet {
    fn format(&self) -> String {
        self.format.clone()
    }

    fn stored_bytes(&self) -> u64 {
        let files = self.collection.files();
        self.files.iter().map(|&file| files[file].stored_bytes).sum()
    }

    /// The largest file, its samples as its decoder has them, and a copy of these in another type.
    fn decoding_bytes(&self) -> u64 {
        let files = self.collection.files();
        let largest = self.files.iter().map(|&file| files[file].stored_bytes).max();
        largest.unwrap_or(0) + 2 * self.decoded_bytes
    }

    fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        assert!(images.end <= self.files.len(), "images of the set");
        let length = 3 * self.size.0 as usize * self.size.1 as usize;
        buffer.resize(images.len() * length, 0.0);
        let first = images.start;
        // The error of the first bad image, whichever thread is first.
        let errors = buffer
            .par_chunks_exact_mut(length)
            .enumerate()
            .map(|(index, out)| self.decode(first + index, out))
            .find_first(Result::is_err);
        errors.unwrap_or(Ok(()))?;
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        self.collection.files()[self.files[image]].name.clone()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn check(&self, image: usize) -> Result<()> {
        let file = self.files[image];
        let header = self.collection.header(file)?;
        header
            .check(self.size)
            .map_err(|detail| self.collection.error(file, detail))
    }
}

impl Collection {
    /// The header of an image, compared with the length of its file.
    fn header(&self, file: usize) -> Result<decode::Header> {
        let bytes = self.read_first(file, HEADER_BYTES)?;
        let (header, length) = match decode::header(&bytes) {
            Ok(header) => (Ok(header), bytes.len() as u64),
            Err(_) if bytes.len() as u64 == HEADER_BYTES => {
                let bytes = self.read(file)?;
                (decode::header(&bytes), bytes.len() as u64)
            }
            Err(detail) => (Err(detail), 0),
        };
        let stored = self.files()[file].stored_bytes;
        header
            .and_then(|header| header.check_length(length.max(stored)).map(|()| header))
            .map_err(|detail| self.error(file, detail))
    }
}
