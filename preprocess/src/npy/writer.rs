//! Writing arrays: streamed, and complete or not there.

use std::path::{Path, PathBuf};

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::header::Header;
use super::{Dtype, Sampling, sampling_path};
use crate::output::AtomicFile;
use crate::{Error, Result};

/// Streams one array to a `.npy` file that gets its name when it is complete.
pub struct NpyWriter {
    file: AtomicFile,
    path: PathBuf,
    dtype: Dtype,
    missing: u64,
}

impl NpyWriter {
    /// Begins an array in C order.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be created beside `path`.
    pub fn create(path: &Path, dtype: Dtype, shape: &[usize]) -> Result<Self> {
        let missing = shape
            .iter()
            .try_fold(1u64, |product, &axis| product.checked_mul(axis as u64));
        let missing = missing.filter(|samples| samples.checked_mul(dtype.bytes() as u64).is_some());
        let Some(missing) = missing else {
            return Err(Error::Invalid {
                what: "shape of the array",
                found: format!("{shape:?}"),
                expected: "less than 2^64 bytes",
            });
        };
        let mut file = AtomicFile::create(path)?;
        file.write_all(&Header::write(dtype.descr(), shape))?;
        Ok(Self {
            file,
            path: path.to_owned(),
            dtype,
            missing,
        })
    }

    /// Appends samples, rounding them to the array's type.
    ///
    /// # Errors
    /// [`Error::Format`] if they are more than the shape has, [`Error::Io`].
    pub fn write_f32(&mut self, samples: &[f32]) -> Result<()> {
        match self.dtype {
            Dtype::F32 => self.write_bytes(samples.len(), bytemuck::cast_slice(samples)),
            Dtype::F16 => {
                let mut halves = [f16::ZERO; 4096];
                for chunk in samples.chunks(halves.len()) {
                    let halves = &mut halves[..chunk.len()];
                    halves.convert_from_f32_slice(chunk);
                    self.write_bytes(chunk.len(), bytemuck::cast_slice(halves))?;
                }
                Ok(())
            }
        }
    }

    /// Appends samples of half floats, widening them where the array is f32.
    ///
    /// # Errors
    /// As [`NpyWriter::write_f32`].
    pub fn write_f16(&mut self, samples: &[f16]) -> Result<()> {
        match self.dtype {
            Dtype::F16 => self.write_bytes(samples.len(), bytemuck::cast_slice(samples)),
            Dtype::F32 => {
                let mut singles = [0f32; 4096];
                for chunk in samples.chunks(singles.len()) {
                    let singles = &mut singles[..chunk.len()];
                    chunk.convert_to_f32_slice(singles);
                    self.write_bytes(chunk.len(), bytemuck::cast_slice(singles))?;
                }
                Ok(())
            }
        }
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`Error::Format`] if samples are missing, [`Error::Io`]; the file is not there then.
    pub fn finish(self) -> Result<()> {
        if self.missing > 0 {
            return Err(Error::format(
                &self.path,
                format!("{} samples were not written", self.missing),
            ));
        }
        self.file.commit()
    }

    fn write_bytes(&mut self, samples: usize, bytes: &[u8]) -> Result<()> {
        self.missing = self.missing.checked_sub(samples as u64).ok_or_else(|| {
            Error::format(
                &self.path,
                format!("{samples} samples to write, {} fit the shape", self.missing),
            )
        })?;
        self.file.write_all(bytes)
    }
}

/// Writes a whole array of f32 in C order.
///
/// # Errors
/// [`Error::Format`] if `samples` does not fill `shape`, [`Error::Io`].
pub fn write_npy_f32(path: &Path, shape: &[usize], samples: &[f32]) -> Result<()> {
    let mut writer = NpyWriter::create(path, Dtype::F32, shape)?;
    writer.write_f32(samples)?;
    writer.finish()
}

/// Streams a BTF to `NAME.npy` and `NAME.json`: samples in the order `[view][light][rgb][y][x]`, in pieces of any
/// length.
pub struct BtfWriter {
    npy: NpyWriter,
    sampling: Sampling,
}

impl BtfWriter {
    /// Begins a BTF at `path`, which ends in `.npy`.
    ///
    /// # Errors
    /// [`Error::Format`] for directions or sides that [`crate::Btf::open`] would refuse, [`Error::Io`].
    pub fn create(path: &Path, sampling: Sampling, width: u32, height: u32, dtype: Dtype) -> Result<Self> {
        sampling
            .check()
            .map_err(|detail| Error::format(&sampling_path(path), detail))?;
        let sides = 1..=tileset::MAX_SIDE_TEXELS;
        if path.extension().is_none_or(|extension| extension != "npy") {
            return Err(Error::format(path, "must end in .npy"));
        }
        if !sides.contains(&width) || !sides.contains(&height) {
            let detail = format!(
                "{width} x {height} texels, accepted sides are 1 to {}",
                sides.end()
            );
            return Err(Error::format(path, detail));
        }
        let shape = [
            sampling.views.len(),
            sampling.lights.len(),
            3,
            height as usize,
            width as usize,
        ];
        Ok(Self {
            npy: NpyWriter::create(path, dtype, &shape)?,
            sampling,
        })
    }

    /// Appends samples; see [`NpyWriter::write_f32`].
    ///
    /// # Errors
    /// As [`NpyWriter::write_f32`].
    pub fn write_f32(&mut self, samples: &[f32]) -> Result<()> {
        self.npy.write_f32(samples)
    }

    /// Appends samples; see [`NpyWriter::write_f16`].
    ///
    /// # Errors
    /// As [`NpyWriter::write_f32`].
    pub fn write_f16(&mut self, samples: &[f16]) -> Result<()> {
        self.npy.write_f16(samples)
    }

    /// Completes both files.
    ///
    /// # Errors
    /// As [`NpyWriter::finish`].
    pub fn finish(self) -> Result<()> {
        let path = sampling_path(&self.npy.path);
        let mut json = AtomicFile::create(&path)?;
        json.write_all(self.sampling.to_json().as_bytes())?;
        self.npy.finish()?;
        json.commit()
    }
}
