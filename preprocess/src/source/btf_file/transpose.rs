//! From apparent BRDFs, one after the other, to a file in which an image can be read.
//!
//! Chunks do not depend on each other: each thread takes one, unpacks it piece by piece, and writes the transposed pieces to
//! where they belong.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use bzip2::read::MultiBzDecoder;
use half::f16;
use rayon::prelude::*;

use super::bytes::ByteFile;
use crate::{Error, Result};

/// Rows that are transposed at a time: a cache line of half floats.
const TILE_ROWS: usize = 32;

/// Where the apparent BRDFs of a BDI file lie.
#[derive(Debug)]
pub(super) struct Abrdfs {
    pub(super) file: Arc<ByteFile>,
    pub(super) chunks: Vec<Chunk>,
    /// Whether chunks are compressed.
    pub(super) bzip2: bool,
    /// Texels of a chunk but the last.
    pub(super) chunk_texels: usize,
    /// Texels stored.
    pub(super) texels: usize,
    /// Samples of a texel as they are stored: views × lights × channels.
    pub(super) samples: usize,
    /// What the channels add to red, green and blue, if they are those of a spectrum.
    pub(super) spectrum: Option<Vec<[f32; 3]>>,
}

/// A chunk's bytes.
#[derive(Debug)]
pub(super) struct Chunk {
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Writes a scratch file: for each block of texels, which are those between two of `starts` and lie within a chunk,
/// `[view][light][rgb][texel]`, as half floats.
///
/// # Errors
/// Chunks that cannot be decompressed, and no room for the scratch file.
pub(super) fn transpose(abrdfs: &Abrdfs, starts: &[usize]) -> Result<File> {
    let path = abrdfs.file.path();
    let bytes = abrdfs.texels as u64 * abrdfs.rows() as u64 * 2;
    let (scratch, folder) = scratch_file(path)?;
    let scratch = Mutex::new(scratch);
    let failed = || {
        format!(
            "write its scratch file of {bytes} bytes in {folder}: make room there or copy the file elsewhere"
        )
    };
    let chunks = 0..abrdfs.chunks.len();
    chunks
        .into_par_iter()
        .try_for_each_init(Buffers::default, |buffers, chunk| {
            let all = abrdfs.texels_of(chunk);
            let blocks = starts.partition_point(|&start| start < all.start)
                ..starts.partition_point(|&start| start < all.end);
            let mut source = Source::new(abrdfs, chunk);
            for block in blocks {
                let (first, count) = (starts[block], starts[block + 1] - starts[block]);
                buffers.read(&mut source, count)?;
                buffers.transpose(count);
                let offset = first as u64 * abrdfs.rows() as u64 * 2;
                let mut scratch = scratch.lock().unwrap_or_else(PoisonError::into_inner);
                scratch
                    .seek(SeekFrom::Start(offset))
                    .and_then(|_| scratch.write_all(bytemuck::cast_slice(&buffers.rows)))
                    .map_err(Error::io(path, failed()))?;
            }
            source.expect_end()
        })?;
    Ok(scratch.into_inner().unwrap_or_else(PoisonError::into_inner))
}

impl Abrdfs {
    /// The stored texels of a chunk.
    pub(super) fn texels_of(&self, chunk: usize) -> Range<usize> {
        let end = self.texels.min((chunk + 1).saturating_mul(self.chunk_texels));
        chunk * self.chunk_texels..end
    }

    /// Samples of a texel in the scratch file: views × lights × 3.
    pub(super) fn rows(&self) -> usize {
        match &self.spectrum {
            None => self.samples,
            Some(spectrum) => self.samples / spectrum.len() * 3,
        }
    }
}

/// What a thread works on.
#[derive(Default)]
struct Buffers {
    /// As stored, if that is a spectrum: `[texel][view][light][channel]`.
    spectra: Vec<f16>,
    /// `[texel][view][light][rgb]`.
    texels: Vec<f16>,
    /// `[view][light][rgb][texel]`.
    rows: Vec<f16>,
}

impl Buffers {
    /// Reads the next texels.
    fn read(&mut self, source: &mut Source<'_>, count: usize) -> Result<()> {
        let abrdfs = source.abrdfs;
        self.texels.resize(count * abrdfs.rows(), f16::ZERO);
        let Some(rgb) = &abrdfs.spectrum else {
            return source.read(&mut self.texels);
        };
        self.spectra.resize(count * abrdfs.samples, f16::ZERO);
        source.read(&mut self.spectra)?;
        let spectra = self.spectra.chunks_exact(rgb.len());
        for (to, spectrum) in self.texels.as_chunks_mut::<3>().0.iter_mut().zip(spectra) {
            let mut sum = [0f32; 3];
            for (value, rgb) in spectrum.iter().zip(rgb) {
                let value = value.to_f32();
                sum = std::array::from_fn(|colour| sum[colour] + value * rgb[colour]);
            }
            *to = sum.map(f16::from_f32);
        }
        Ok(())
    }

    /// Rows of `count` texels from texels.
    fn transpose(&mut self, count: usize) {
        let samples = self.texels.len() / count;
        self.rows.resize(self.texels.len(), f16::ZERO);
        for (tile, out) in self.rows.chunks_mut(TILE_ROWS * count).enumerate() {
            transpose_tile(&self.texels, samples, tile * TILE_ROWS, out, count);
        }
    }
}

/// `out[row][texel] = texels[texel][first_row + row]`.
fn transpose_tile(texels: &[f16], samples: usize, first_row: usize, out: &mut [f16], count: usize) {
    let rows = out.len() / count;
    for (texel, samples) in texels.chunks_exact(samples).enumerate() {
        for (row, &sample) in samples[first_row..first_row + rows].iter().enumerate() {
            out[row * count + texel] = sample;
        }
    }
}

/// A file without a name beside `path`, or else in the folder for temporary files; and which folder it is.
fn scratch_file(path: &Path) -> Result<(File, String)> {
    let beside = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => Path::new(".").to_owned(),
    };
    let temporary = std::env::temp_dir();
    let made = match tempfile::tempfile_in(&beside) {
        Ok(file) => Ok((file, beside)),
        Err(_) => tempfile::tempfile_in(&temporary).map(|file| (file, temporary.clone())),
    };
    let (file, folder) = made.map_err(Error::io(
        path,
        format!("make a scratch file beside it or in {}", temporary.display()),
    ))?;
    Ok((file, folder.display().to_string()))
}

/// The apparent BRDFs of a chunk as a stream of samples.
struct Source<'a> {
    abrdfs: &'a Abrdfs,
    chunk: usize,
    reader: Box<dyn Read + 'a>,
}

impl<'a> Source<'a> {
    fn new(abrdfs: &'a Abrdfs, chunk: usize) -> Self {
        let Chunk { offset, bytes } = abrdfs.chunks[chunk];
        let part = Part {
            file: &abrdfs.file,
            at: offset,
            end: offset + bytes,
        };
        let reader: Box<dyn Read + 'a> = if abrdfs.bzip2 {
            Box::new(MultiBzDecoder::new(part))
        } else {
            Box::new(part)
        };
        Self {
            abrdfs,
            chunk,
            reader,
        }
    }

    fn read(&mut self, out: &mut [f16]) -> Result<()> {
        self.reader
            .read_exact(bytemuck::cast_slice_mut(out))
            .map_err(|error| self.error(&error))
    }

    /// An error if the chunk holds more than its texels. The last may be filled up.
    fn expect_end(&mut self) -> Result<()> {
        if self.chunk + 1 == self.abrdfs.chunks.len() {
            return Ok(());
        }
        match self.reader.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(self.abrdfs.file.error(format!(
                "has a chunk {} (byte {}) that unpacks to more than the {} samples of its texels",
                self.chunk,
                self.abrdfs.chunks[self.chunk].offset,
                self.abrdfs.chunk_texels * self.abrdfs.samples
            ))),
            Err(error) => Err(self.error(&error)),
        }
    }

    fn error(&self, error: &std::io::Error) -> Error {
        let Chunk { offset, bytes } = self.abrdfs.chunks[self.chunk];
        self.abrdfs.file.error(format!(
            "has a chunk {} of {bytes} bytes (byte {offset}) that does not unpack to the samples of its texels: \
             {error}; fetch the file again",
            self.chunk
        ))
    }
}

/// A part of the file as a reader.
struct Part<'a> {
    file: &'a ByteFile,
    at: u64,
    end: u64,
}

impl Read for Part<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = (out.len() as u64).min(self.end - self.at) as usize;
        self.file.read_raw(self.at, &mut out[..count])?;
        self.at += count as u64;
        Ok(count)
    }
}
