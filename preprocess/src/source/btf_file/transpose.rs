//! From apparent BRDFs, one after the other, to a file in which an image can be read.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;

use bzip2::read::MultiBzDecoder;
use rayon::prelude::*;

use super::bytes::ByteFile;
use crate::{Error, Result};

/// Rows that a task transposes: a cache line of half floats.
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
    /// Samples of a texel: views × lights × 3.
    pub(super) samples: usize,
}

/// A chunk's bytes.
#[derive(Debug)]
pub(super) struct Chunk {
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Writes a scratch file: for each block of `block` texels `[view][light][rgb][texel]`, as the half floats are.
///
/// # Errors
/// Chunks that cannot be decompressed, and no room for the scratch file.
pub(super) fn transpose(abrdfs: &Abrdfs, block: usize) -> Result<File> {
    let path = abrdfs.file.path();
    let bytes = abrdfs.texels as u64 * abrdfs.samples as u64 * 2;
    let (mut scratch, folder) = scratch_file(path)?;
    let mut source = Source::new(abrdfs);
    let (mut texels, mut rows) = (Vec::<u16>::new(), Vec::<u16>::new());
    for first in (0..abrdfs.texels).step_by(block) {
        let count = block.min(abrdfs.texels - first);
        texels.resize(count * abrdfs.samples, 0);
        rows.resize(texels.len(), 0);
        source.read(&mut texels)?;
        rows.par_chunks_mut(TILE_ROWS * count)
            .enumerate()
            .for_each(|(tile, out)| transpose_tile(&texels, abrdfs.samples, tile * TILE_ROWS, out, count));
        scratch.write_all(bytemuck::cast_slice(&rows)).map_err(Error::io(
            path,
            format!("write its scratch file of {bytes} bytes in {folder}: make room there or copy the file elsewhere"),
        ))?;
    }
    Ok(scratch)
}

/// `out[row][texel] = texels[texel][first_row + row]`.
fn transpose_tile(texels: &[u16], samples: usize, first_row: usize, out: &mut [u16], count: usize) {
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

/// The apparent BRDFs as one stream of samples.
struct Source<'a> {
    abrdfs: &'a Abrdfs,
    /// The chunk that is read next.
    chunk: usize,
    /// What is left of the current chunk: samples, and where they come from.
    left: usize,
    reader: Option<Box<dyn Read + 'a>>,
}

impl<'a> Source<'a> {
    fn new(abrdfs: &'a Abrdfs) -> Self {
        Self {
            abrdfs,
            chunk: 0,
            left: 0,
            reader: None,
        }
    }

    /// Fills `out`, crossing from chunk to chunk.
    fn read(&mut self, mut out: &mut [u16]) -> Result<()> {
        while !out.is_empty() {
            if self.left == 0 {
                self.next_chunk();
            }
            let (now, later) = out.split_at_mut(self.left.min(out.len()));
            let chunk = self.chunk - 1;
            let reader = self.reader.as_mut().expect("a chunk is open");
            reader
                .read_exact(bytemuck::cast_slice_mut(now))
                .map_err(|error| self.error(chunk, &error))?;
            self.left -= now.len();
            if self.left == 0 && self.chunk < self.abrdfs.chunks.len() {
                self.expect_end(chunk)?;
            }
            out = later;
        }
        Ok(())
    }

    fn next_chunk(&mut self) {
        let abrdfs = self.abrdfs;
        let Chunk { offset, bytes } = abrdfs.chunks[self.chunk];
        let texels = abrdfs
            .chunk_texels
            .min(abrdfs.texels - self.chunk * abrdfs.chunk_texels);
        let part = Part {
            file: &abrdfs.file,
            at: offset,
            end: offset + bytes,
        };
        self.reader = Some(if abrdfs.bzip2 {
            Box::new(MultiBzDecoder::new(part))
        } else {
            Box::new(part)
        });
        self.left = texels * abrdfs.samples;
        self.chunk += 1;
    }

    /// An error if a chunk that is not the last holds more than its texels.
    fn expect_end(&mut self, chunk: usize) -> Result<()> {
        let reader = self.reader.as_mut().expect("a chunk is open");
        match reader.read(&mut [0]) {
            Ok(0) => Ok(()),
            Ok(_) => Err(self.abrdfs.file.error(format!(
                "has a chunk {chunk} (byte {}) that unpacks to more than the {} samples of its texels",
                self.abrdfs.chunks[chunk].offset,
                self.abrdfs.chunk_texels * self.abrdfs.samples
            ))),
            Err(error) => Err(self.error(chunk, &error)),
        }
    }

    fn error(&self, chunk: usize, error: &std::io::Error) -> Error {
        let Chunk { offset, bytes } = self.abrdfs.chunks[chunk];
        self.abrdfs.file.error(format!(
            "has a chunk {chunk} of {bytes} bytes (byte {offset}) that does not unpack to the samples of its texels: \
             {error}; fetch the file again"
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
