//! BDI: all samples as half floats, apparent BRDF by apparent BRDF, in chunks of scan lines.
//!
//! After the directions: u32 width, u32 height, u32 scan lines of a chunk, u8 compression, u8 `mask[height][width]`,
//! local frames. Then chunks of u32 bytes and as many bytes: the samples of `width·scan lines` texels in reading
//! order, each `[view][light][rgb]`, or `[view][light][channel]` of a spectrum; with compression 2 of the next so many texels that the mask holds. The last
//! chunk may be filled up to the size of the others.
//!
//! btflib, the one public reader, declares the mask as `[width][height]` but numbers the texels in reading order when it
//! looks them up in it; reading order is what its writer writes and what is read here.

use std::fs::File;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use super::bytes::{ByteFile, Cursor, read_at};
use super::header::Header;
use super::pieces::pieces;
use super::transpose::{self, Abrdfs, Chunk};
use crate::npy::Samples;
use crate::source::Images;
use crate::{Error, Result};

/// Samples that all threads together transpose at a time, in bytes; each has them twice, and those of a spectrum besides.
const BLOCK_BYTES: usize = 64 << 20;
/// Most times that bzip2 is believed to shrink samples. It bounds the scratch file that a small file can ask for; bzip2
/// itself can shrink a run of equal bytes by far more. Not derived from measured BTFs, of which none was at hand.
const MAX_BZIP2_RATIO: u64 = 1000;

/// The images of a BDI file.
#[derive(Debug)]
pub(super) struct Bdi {
    format: String,
    notes: Vec<String>,
    abrdfs: Abrdfs,
    /// Texels of an image.
    texels: usize,
    /// Which texels are stored, ascending; `None` if all are.
    positions: Option<Vec<u32>>,
    /// Where the stored texels of each block of the scratch file begin, and their number. Blocks end where chunks do.
    starts: Vec<usize>,
    /// Where the texels of each block begin in an image.
    bounds: Vec<usize>,
    lights: usize,
    scratch: OnceLock<File>,
    /// Held while the scratch file is made.
    making: Mutex<()>,
}

/// Reads what follows the directions and the list of chunks.
pub(super) fn open(cursor: &mut Cursor<'_>, file: &Arc<ByteFile>, header: &mut Header) -> Result<Bdi> {
    let at = cursor.at();
    let scan_lines = cursor.u32("the scan lines of a chunk")?;
    if scan_lines == 0 {
        return Err(file.error(format!(
            "has chunks of 0 scan lines (byte {at}), expected at least 1"
        )));
    }
    let at = cursor.at();
    let compression = cursor.u8("the compression")?;
    let compressions = ["plain", "bzip2", "sparse"];
    let Some(name) = compressions.get(usize::from(compression)) else {
        return Err(file.error(format!(
            "has compression {compression} (byte {at}), expected 0 plain, 1 bzip2 or 2 sparse"
        )));
    };
    let sparse = compression == 2;
    let texels = header.texels();
    let (held, positions) = read_mask(cursor, texels, sparse)?;
    if held < texels {
        let meaning = if sparse {
            "are not stored and read as 0"
        } else {
            "are masked out"
        };
        header
            .notes
            .push(format!("{} of {texels} texels {meaning}", texels - held));
    }
    header.skip_frames(cursor)?;
    let stored = if sparse { held } else { texels };
    if stored == 0 {
        return Err(file.error("masks out every texel: there are no samples in it"));
    }
    let rows = header.channels() * header.images();
    // At most 2^48 before the minimum, and then no more than the texels.
    let chunk_texels = (u64::from(header.width) * u64::from(scan_lines)).min(stored as u64) as usize;
    let full_chunk_texels = u64::from(header.width) * u64::from(scan_lines);
    let mut chunks = Vec::new();
    for first in (0..stored).step_by(chunk_texels) {
        let index = chunks.len();
        let at = cursor.at();
        let bytes = cursor.u32(format_args!("the size of chunk {index}"))?;
        let count = chunk_texels.min(stored - first);
        let expected = (count * rows) as u64 * 2;
        let full = full_chunk_texels.saturating_mul(rows as u64 * 2);
        let last = first + count == stored;
        if compression != 1 && u64::from(bytes) != expected && !(last && u64::from(bytes) == full) {
            return Err(file.error(format!(
                "has a chunk {index} of {bytes} bytes (byte {at}), expected {expected} for {count} texels of {rows} \
                 samples"
            )));
        }
        chunks.push(Chunk {
            offset: cursor.at(),
            bytes: bytes.into(),
        });
        cursor.skip(format_args!("chunk {index}"), bytes.into())?;
    }
    cursor.finish("the last chunk")?;
    let packed: u64 = chunks.iter().map(|chunk| chunk.bytes).sum();
    let samples_bytes = stored as u128 * rows as u128 * 2;
    let scratch_bytes = stored as u64 * header.images() as u64 * 6;
    if samples_bytes > u128::from(packed) * u128::from(MAX_BZIP2_RATIO) {
        return Err(file.error(format!(
            "claims {samples_bytes} bytes of samples in {packed} bytes of bzip2: more than {MAX_BZIP2_RATIO} times \
             as many, so its header is not believed"
        )));
    }
    header.notes.push(format!(
        "the samples are transposed when the first image is read, into a scratch file of {scratch_bytes} bytes beside \
         the file or in the folder for temporary files"
    ));
    Ok(Bdi {
        format: format!("UBO .btf, all samples as f16, {name} chunks"),
        notes: std::mem::take(&mut header.notes),
        abrdfs: Abrdfs {
            file: file.clone(),
            chunks,
            bzip2: compression == 1,
            chunk_texels,
            texels: stored,
            samples: rows,
            spectrum: header.spectrum.take(),
        },
        texels,
        positions,
        starts: Vec::new(),
        bounds: Vec::new(),
        lights: header.sampling.lights.len(),
        scratch: OnceLock::new(),
        making: Mutex::new(()),
    }
    .with_block((BLOCK_BYTES / rayon::current_num_threads() / (2 * rows)).clamp(1, stored)))
}

/// How many texels the mask holds, and if asked for which.
fn read_mask(cursor: &mut Cursor<'_>, texels: usize, list: bool) -> Result<(usize, Option<Vec<u32>>)> {
    const PART: usize = 1 << 14;
    let (mut held, mut positions) = (0, Vec::new());
    for first in (0..texels).step_by(PART) {
        let part = cursor.take("the mask", PART.min(texels - first))?;
        for (texel, _) in (first..).zip(part).filter(|&(_, &byte)| byte != 0) {
            held += 1;
            if list {
                // Texels are at most 2^32.
                positions.push(texel as u32);
            }
        }
    }
    Ok((held, list.then_some(positions).filter(|_| held < texels)))
}

impl Bdi {
    /// Makes blocks of the scratch file hold `block` stored texels at most.
    fn with_block(mut self, block: usize) -> Self {
        let begin = |stored: usize| match &self.positions {
            Some(positions) if stored > 0 => positions[stored] as usize,
            _ => stored,
        };
        let chunks = 0..self.abrdfs.chunks.len();
        let starts = chunks.flat_map(|chunk| self.abrdfs.texels_of(chunk).step_by(block));
        self.starts = starts.chain([self.abrdfs.texels]).collect();
        let blocks = &self.starts[..self.starts.len() - 1];
        self.bounds = blocks
            .iter()
            .map(|&start| begin(start))
            .chain([self.texels])
            .collect();
        self
    }

    /// The transposed samples: blocks of texels, each `[row][texel of the block]`.
    fn scratch(&self) -> Result<&File> {
        if let Some(scratch) = self.scratch.get() {
            return Ok(scratch);
        }
        let _making = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(scratch) = self.scratch.get() {
            return Ok(scratch);
        }
        let scratch = transpose::transpose(&self.abrdfs, &self.starts)?;
        Ok(self.scratch.get_or_init(|| scratch))
    }

    fn bytes(&self) -> u64 {
        (self.abrdfs.texels * self.abrdfs.rows()) as u64 * 2
    }
}

impl Images for Bdi {
    fn format(&self) -> String {
        self.format.clone()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn stored_bytes(&self) -> u64 {
        self.bytes()
    }

    fn samples<'a>(&'a self, images: Range<usize>, buffer: &'a mut Vec<f32>) -> Result<Samples<'a>> {
        let scratch = self.scratch()?;
        buffer.resize(images.len() * 3 * self.texels, 0.0);
        if self.positions.is_some() {
            buffer.fill(0.0);
        }
        pieces(buffer, &self.bounds)
            .into_par_iter()
            .enumerate()
            .try_for_each_init(Vec::new, |halves, (index, mut rows)| {
                let first = self.starts[index];
                let count = self.starts[index + 1] - first;
                halves.resize(rows.len() * count, f16::ZERO);
                let offset = (first * self.abrdfs.rows() + 3 * images.start * count) as u64 * 2;
                read_at(scratch, offset, bytemuck::cast_slice_mut(halves))
                    .map_err(Error::io(self.abrdfs.file.path(), "read its scratch file back"))?;
                for (row, halves) in rows.iter_mut().zip(halves.chunks_exact(count)) {
                    let Some(positions) = &self.positions else {
                        halves.convert_to_f32_slice(row);
                        continue;
                    };
                    let positions = &positions[first..first + count];
                    for (&position, half) in positions.iter().zip(halves) {
                        row[position as usize - self.bounds[index]] = half.to_f32();
                    }
                }
                Ok(())
            })?;
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        let (view, light) = (image / self.lights, image % self.lights);
        let from = self.abrdfs.chunks[0].offset;
        format!("view {view} and light {light} of every apparent BRDF, from byte {from}")
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use tileset::Direction;

    use super::*;
    use crate::npy::Sampling;

    /// Five by three texels under two views and three lights; the samples count up. `mask` says what is stored.
    fn read(mask: &[u8; 15], sparse: bool, block: usize) -> Vec<f32> {
        let rows = 2 * 3 * 3;
        let mut bytes = 2u32.to_le_bytes().to_vec();
        bytes.push(if sparse { 2 } else { 0 });
        bytes.extend(mask);
        bytes.extend(0u32.to_le_bytes());
        let stored: Vec<usize> = (0..15).filter(|&texel| !sparse || mask[texel] != 0).collect();
        for chunk in stored.chunks(10) {
            bytes.extend((chunk.len() as u32 * rows * 2).to_le_bytes());
            for texel in chunk {
                let samples = (0..rows).map(|row| f16::from_f32((*texel as u32 * rows + row) as f32));
                samples.for_each(|sample| bytes.extend(sample.to_le_bytes()));
            }
        }
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&bytes).unwrap();
        let file = Arc::new(ByteFile::open(file.path()).unwrap());
        let direction = Direction { theta: 0.0, phi: 0.0 };
        let sampling = Sampling {
            views: vec![direction; 2],
            lights: vec![direction; 3],
            wrap: false,
            cosine: false,
        };
        let mut header = Header {
            sampling,
            width: 5,
            height: 3,
            notes: Vec::new(),
            spectrum: None,
        };
        let bdi = open(&mut Cursor::new(&file), &file, &mut header)
            .unwrap()
            .with_block(block);
        let mut buffer = vec![7.0; 3];
        bdi.samples(1..6, &mut buffer).unwrap();
        buffer
    }

    #[test]
    fn blocks_of_any_size_give_the_same_images() {
        let holes = [0, 1, 1, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0];
        for (mask, sparse) in [([1; 15], false), (holes, false), ([1; 15], true), (holes, true)] {
            let expected: Vec<f32> = (3..18)
                .flat_map(|row| (0..15).map(move |texel| (texel, (texel * 18 + row) as f32)))
                .map(|(texel, sample)| if sparse && mask[texel] == 0 { 0.0 } else { sample })
                .collect();
            for block in 1..17 {
                assert_eq!(
                    read(&mask, sparse, block),
                    expected,
                    "sparse {sparse}, blocks of {block}"
                );
            }
        }
    }
}
