//! A matrix inside the file, read by rows and converted to f32.

use std::fmt::Display;
use std::ops::Range;
use std::sync::Arc;

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::bytes::{ByteFile, Cursor};
use crate::Result;

/// Scalars that are converted at a time.
const CHUNK: usize = 1 << 14;

/// Type of the scalars.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    F16,
    F32,
    F64,
}

impl Scalar {
    /// Reads the byte that tells it.
    pub(super) fn read(cursor: &mut Cursor<'_>, what: impl Display) -> Result<Self> {
        let at = cursor.at();
        match cursor.u8(format_args!("the size of scalars of {what}"))? {
            2 => Ok(Scalar::F16),
            4 => Ok(Scalar::F32),
            8 => Ok(Scalar::F64),
            other => Err(cursor.file().error(format!(
                "has scalars of {other} bytes in {what} (byte {at}), expected 2, 4 or 8"
            ))),
        }
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Scalar::F16 => 2,
            Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Scalar::F16 => "f16",
            Scalar::F32 => "f32",
            Scalar::F64 => "f64",
        }
    }
}

/// A row-major matrix at a place of the file.
#[derive(Clone, Debug)]
pub(super) struct Matrix {
    file: Arc<ByteFile>,
    offset: u64,
    rows: usize,
    columns: usize,
    scalar: Scalar,
}

impl Matrix {
    /// The matrix that comes next, of which the cursor then stands behind. Its size is compared with the file's.
    pub(super) fn next(
        cursor: &mut Cursor<'_>,
        file: &Arc<ByteFile>,
        what: impl Display,
        (rows, columns): (usize, usize),
        scalar: Scalar,
    ) -> Result<Self> {
        let offset = cursor.at();
        // In u128: both come from u32 fields, times three and eight at most.
        let bytes = rows as u128 * columns as u128 * scalar.bytes() as u128;
        let bytes = u64::try_from(bytes).unwrap_or(u64::MAX);
        cursor.skip(
            format_args!("{what} of {rows} x {columns} {}", scalar.name()),
            bytes,
        )?;
        let file = file.clone();
        Ok(Self {
            file,
            offset,
            rows,
            columns,
            scalar,
        })
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    pub(super) fn scalar(&self) -> Scalar {
        self.scalar
    }

    /// Bytes that it takes in the file.
    pub(super) fn bytes(&self) -> u64 {
        self.rows as u64 * self.row_bytes()
    }

    /// Where a row begins in the file.
    pub(super) fn row_offset(&self, row: usize) -> u64 {
        self.offset + row as u64 * self.row_bytes()
    }

    fn row_bytes(&self) -> u64 {
        self.columns as u64 * self.scalar.bytes() as u64
    }

    /// Appends rows to `out`.
    pub(super) fn read(&self, rows: Range<usize>, out: &mut Vec<f32>) -> Result<()> {
        assert!(
            rows.start <= rows.end && rows.end <= self.rows,
            "rows of the matrix"
        );
        let start = out.len();
        out.resize(start + rows.len() * self.columns, 0.0);
        let out = &mut out[start..];
        let offset = self.row_offset(rows.start);
        match self.scalar {
            Scalar::F32 => self.file.read(offset, bytemuck::cast_slice_mut(out)),
            Scalar::F16 => {
                let mut halves = vec![f16::ZERO; out.len()];
                self.file.read(offset, bytemuck::cast_slice_mut(&mut halves))?;
                halves.convert_to_f32_slice(out);
                Ok(())
            }
            Scalar::F64 => {
                let mut doubles = vec![0f64; out.len().min(CHUNK)];
                for (index, out) in out.chunks_mut(CHUNK).enumerate() {
                    let doubles = &mut doubles[..out.len()];
                    let place = offset + (index * CHUNK * size_of::<f64>()) as u64;
                    self.file.read(place, bytemuck::cast_slice_mut(doubles))?;
                    for (out, &double) in out.iter_mut().zip(doubles.iter()) {
                        *out = double as f32;
                    }
                }
                Ok(())
            }
        }
    }
}
