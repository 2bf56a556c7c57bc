//! Passes over a BTF in blocks of rows, each read once, converted to f32, used, and released.
//!
//! The resident memory of a pass is one block: as mapped samples and as f32.

use std::ops::Range;
use std::time::Instant;

use faer::{MatMut, MatRef};
use rayon::prelude::*;

use super::Statistics;
use crate::npy::{MAX_SAMPLE, Samples};
use crate::progress::{Phase, Progress, ProgressFn};
use crate::{Btf, Result};

/// Samples converted at a time, so that they are summed while they are in the first-level cache.
const CHUNK_SAMPLES: usize = 4096;

/// What is summed over all samples while they are read for the first time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Totals {
    /// Sum of squares, ‖B‖².
    pub(super) energy: f64,
    /// Sums of the red, green and blue samples.
    pub(super) sums: [f64; 3],
}

/// A BTF as a sequence of blocks of rows.
pub(super) struct Stream<'a> {
    btf: &'a Btf,
    block_rows: usize,
    /// [row of the block][texel].
    block: Vec<f32>,
    progress: ProgressFn<'a>,
    /// Known after the first pass.
    totals: Option<Totals>,
    pub(super) statistics: Statistics,
}

impl<'a> Stream<'a> {
    pub(super) fn new(btf: &'a Btf, block_rows: usize, progress: ProgressFn<'a>) -> Self {
        Self {
            btf,
            block_rows,
            block: vec![0.0; block_rows * btf.columns()],
            progress,
            totals: None,
            statistics: Statistics {
                block_rows,
                ..Statistics::default()
            },
        }
    }

    /// Rows of the matrix.
    pub(super) fn rows(&self) -> usize {
        self.btf.rows()
    }

    /// Columns of the matrix.
    pub(super) fn columns(&self) -> usize {
        self.btf.columns()
    }

    /// Counts the operations of `count` products of the whole matrix with `width` vectors.
    pub(super) fn count_products(&mut self, count: u32, width: usize) {
        self.statistics.product_flops +=
            f64::from(count) * 2.0 * self.rows() as f64 * self.columns() as f64 * width as f64;
    }

    /// Sums over the whole BTF; zero before the first pass.
    pub(super) fn totals(&self) -> Totals {
        self.totals.unwrap_or_default()
    }

    /// One pass: `work` gets the range of rows and their samples, rows × texels, row-major, which it may
    /// overwrite.
    ///
    /// The first pass checks every sample.
    pub(super) fn pass(
        &mut self,
        phase: Phase,
        mut work: impl FnMut(Range<usize>, MatMut<'_, f32>),
    ) -> Result<()> {
        let (rows, columns) = (self.btf.rows(), self.btf.columns());
        let first_pass = self.totals.is_none();
        let mut totals = Totals::default();
        for start in (0..rows).step_by(self.block_rows) {
            let end = (start + self.block_rows).min(rows);
            (self.progress)(Progress {
                phase,
                done: start as u64,
                total: rows as u64,
            });
            self.btf.prefetch(end..(end + self.block_rows).min(rows));

            let began = Instant::now();
            let block = &mut self.block[..(end - start) * columns];
            let samples = self.btf.row_block(start..end);
            if first_pass {
                let sums = convert_and_sum(samples, block, columns);
                for (row, &(sum, energy)) in (start..end).zip(&sums) {
                    // A NaN or infinity anywhere makes the sum of squares one, and a sample above the limit
                    // makes it exceed the limit's square.
                    if !(energy <= MAX_SAMPLE * MAX_SAMPLE)
                        && let Some(error) = self.btf.find_bad_sample(row..row + 1)
                    {
                        return Err(error);
                    }
                    totals.energy += energy;
                    totals.sums[row % 3] += sum;
                }
            } else {
                convert(samples, block);
            }
            self.btf.release(start..end);
            self.statistics.read_seconds += began.elapsed().as_secs_f64();

            let began = Instant::now();
            work(
                start..end,
                MatMut::from_row_major_slice_mut(block, end - start, columns),
            );
            self.statistics.product_seconds += began.elapsed().as_secs_f64();
            self.statistics.sample_memory();
        }
        (self.progress)(Progress {
            phase,
            done: rows as u64,
            total: rows as u64,
        });
        self.totals.get_or_insert(totals);
        self.statistics.passes += 1;
        self.statistics.bytes_read += self.btf.sample_bytes();
        Ok(())
    }
}

/// Converts samples to f32, on all threads.
fn convert(samples: Samples<'_>, out: &mut [f32]) {
    let chunk = CHUNK_SAMPLES * 16; // large enough that scheduling costs nothing
    out.par_chunks_mut(chunk).enumerate().for_each(|(index, out)| {
        samples
            .slice(index * chunk..index * chunk + out.len())
            .to_f32(out);
    });
}

/// Converts rows of samples to f32, and gives sum and sum of squares of each row.
fn convert_and_sum(samples: Samples<'_>, out: &mut [f32], columns: usize) -> Vec<(f64, f64)> {
    let convert_row = |(row, out): (usize, &mut [f32])| {
        let mut totals = (0.0, 0.0);
        for (index, out) in out.chunks_mut(CHUNK_SAMPLES).enumerate() {
            let start = row * columns + index * CHUNK_SAMPLES;
            samples.slice(start..start + out.len()).to_f32(out);
            let (sum, energy) = sum_in_f64(out);
            totals.0 += sum;
            totals.1 += energy;
        }
        totals
    };
    // Collected in order and summed by the caller in order: the same bits whatever the threads do.
    out.par_chunks_mut(columns).enumerate().map(convert_row).collect()
}

/// Sum and sum of squares, in eight lanes that the compiler keeps in vector registers.
fn sum_in_f64(samples: &[f32]) -> (f64, f64) {
    let (mut sums, mut energies) = ([0f64; 8], [0f64; 8]);
    let lanes = samples.chunks_exact(8);
    for &sample in lanes.remainder() {
        sums[0] += f64::from(sample);
        energies[0] += f64::from(sample).powi(2);
    }
    for lane in lanes {
        for ((&sample, sum), energy) in lane.iter().zip(&mut sums).zip(&mut energies) {
            let sample = f64::from(sample);
            *sum += sample;
            *energy += sample * sample;
        }
    }
    (sums.iter().sum(), energies.iter().sum())
}

/// Sum of squares of a block whose rows are contiguous.
pub(super) fn energy(block: MatRef<'_, f32>) -> f64 {
    let rows: Vec<f64> = (0..block.nrows())
        .into_par_iter()
        .map(|row| {
            let row = block.row(row).try_as_row_major().map(|row| row.as_slice());
            row.map_or(f64::NAN, |row| {
                row.chunks(CHUNK_SAMPLES).map(|chunk| sum_in_f64(chunk).1).sum()
            })
        })
        .collect();
    rows.iter().sum()
}
