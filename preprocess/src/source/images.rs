//! What a format has to do.

use std::ops::Range;

use crate::Result;
use crate::npy::Samples;

/// The samples of a BTF, image by image. Implementations read what they are asked for, in any order, more than once
/// and from several threads, and keep no more than a bounded cache.
pub trait Images: Send + Sync + std::fmt::Debug {
    /// The format for people, such as "UBO 2003 zip of JPEG images".
    fn format(&self) -> String;

    /// Bytes that one pass over all samples reads from the disk.
    fn stored_bytes(&self) -> u64;

    /// Bytes of memory that a sample takes while it is worked on: 4 where it is decoded into the buffer, the size in
    /// the file where that is mapped.
    fn sample_bytes(&self) -> usize {
        4
    }

    /// Bytes of memory that each thread takes beside the samples while it makes them: an encoded image and what its
    /// decoder makes of it.
    fn decoding_bytes(&self) -> u64 {
        0
    }

    /// The samples of consecutive images, `[image][rgb][y][x]`, linear: from a map of the file, or decoded into
    /// `buffer`, which is resized as needed and keeps its capacity from call to call.
    ///
    /// # Errors
    /// [`crate::Error::Io`] and [`crate::Error::Format`], naming file, image and offset.
    ///
    /// # Panics
    /// If `images` ends beyond the last image.
    fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>>;

    /// Starts to fetch images that are needed soon.
    fn prefetch(&self, _images: Range<usize>) {}

    /// Says that these images are not needed any more for now.
    fn release(&self, _images: Range<usize>) {}

    /// Where an image stands, for errors: the name of its file, or its place in a file of many.
    fn place(&self, image: usize) -> String;

    /// What is worth knowing beside what [`crate::Btf`] says: files left out, assumptions made.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Looks at an image without decoding it: whether it is there, is what it should be, and has the right size.
    ///
    /// # Errors
    /// As [`Images::samples`].
    fn check(&self, _image: usize) -> Result<()> {
        Ok(())
    }

    /// The BTF as a product of factors where the file holds one, so that it need not be factorized again.
    ///
    /// # Errors
    /// As [`Images::samples`].
    fn low_rank(&self) -> Result<Option<LowRank>> {
        Ok(None)
    }
}

/// An exact product: `ρ[row][texel] = Σ_c u[c][row]·v[c][texel]`. The terms need not be orthogonal or sorted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LowRank {
    /// Terms.
    pub terms: usize,
    /// `[term][view][light][rgb]`.
    pub u: Vec<f32>,
    /// `[term][y][x]`.
    pub v: Vec<f32>,
}
