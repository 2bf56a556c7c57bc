//! Passes over a BTF in blocks of rows, straight from its memory map.
//!
//! A block is never held as f32: each thread converts a panel of it into its own scratch memory,
//! which stays in the second-level cache, and multiplies them there. Converting twice in a pass that needs two
//! products is cheaper than writing f32 to memory and reading it again. Blocks that are done are released, so
//! that a pass keeps one block of mapped samples resident.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use faer::MatMut;
use rayon::prelude::*;

use super::Statistics;
use crate::npy::{MAX_SAMPLE, Samples};
use crate::progress::{Phase, Progress, ProgressFn};
use crate::{Btf, Result};

/// Rows and texels converted at a time. As f32 they take 1 MiB, a second-level cache; as halves each row is one page
/// of memory, so that reading them is not a search for pages.
const PANEL_ROWS: usize = 128;
const PANEL_TEXELS: usize = 2048;
/// Distance of rows in scratch memory beyond their length: rows whole powers of two apart share cache sets.
const PADDING: usize = 16;
/// Tasks of a block at most: bounds the memory of their partial sums.
const MAX_TASKS: usize = 64;

/// Bytes of scratch memory of each thread.
pub(super) const SCRATCH_BYTES: usize = PANEL_ROWS * (PANEL_TEXELS + PADDING) * size_of::<f32>();

/// What is summed over all samples while they are read for the first time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Totals {
    /// Sum of squares, ‖B‖².
    pub(super) energy: f64,
    /// Sums of the red, green and blue samples.
    pub(super) sums: [f64; 3],
}

impl Totals {
    pub(super) fn add(&mut self, other: Totals) {
        self.energy += other.energy;
        for (sum, other) in self.sums.iter_mut().zip(other.sums) {
            *sum += other;
        }
    }
}

/// Consecutive rows of a BTF.
pub(super) struct Block<'a> {
    /// Which rows of the matrix.
    pub(super) rows: Range<usize>,
    /// Whether these samples are read for the first time and must be summed.
    pub(super) first_time: bool,
    columns: usize,
    samples: Samples<'a>,
    /// Time that threads spent on conversion, all together.
    read_nanoseconds: &'a AtomicU64,
}

impl Block<'_> {
    /// Splits the texels into tasks, which run on all threads; their results come in the order of the texels.
    /// The split depends only on the number of texels, so that sums have the same bits on every machine.
    pub(super) fn tasks<T: Send>(&self, work: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
        let texels = task_texels(self.columns);
        (0..self.columns.div_ceil(texels))
            .into_par_iter()
            .map(|task| work(task * texels..self.columns.min((task + 1) * texels)))
            .collect()
    }

    /// Calls `work` with panels that together are the texels of `range`: the first row within the block, the first
    /// texel, and the samples in f32, rows × texels, row-major, which may be overwritten.
    pub(super) fn panels(&self, range: Range<usize>, mut work: impl FnMut(usize, usize, MatMut<'_, f32>)) {
        let stride = PANEL_TEXELS.min(range.len()) + PADDING;
        let mut scratch = vec![0f32; PANEL_ROWS.min(self.rows.len()) * stride];
        for start in range.clone().step_by(PANEL_TEXELS) {
            let texels = PANEL_TEXELS.min(range.end - start);
            for first_row in (0..self.rows.len()).step_by(PANEL_ROWS) {
                let rows = PANEL_ROWS.min(self.rows.len() - first_row);
                let began = Instant::now();
                for (row, out) in scratch.chunks_exact_mut(stride).enumerate().take(rows) {
                    let from = (first_row + row) * self.columns + start;
                    self.samples.slice(from..from + texels).to_f32(&mut out[..texels]);
                }
                self.read_nanoseconds
                    .fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
                // Not `from_row_major_slice_with_stride_mut`, which in faer 0.24.4 takes the stride for that of
                // columns.
                let panel =
                    MatMut::from_column_major_slice_with_stride_mut(&mut scratch, texels, rows, stride);
                work(first_row, start, panel.transpose_mut());
            }
        }
    }

    /// Sums over a panel of this block.
    pub(super) fn totals(&self, first_row: usize, panel: MatMut<'_, f32>) -> Totals {
        let mut totals = Totals::default();
        for (index, row) in panel.as_ref().row_iter().enumerate() {
            let samples = row.try_as_row_major().map_or(&[][..], |row| row.as_slice());
            let (sum, energy) = sum_in_f64(samples);
            totals.energy += energy;
            totals.sums[(self.rows.start + first_row + index) % 3] += sum;
        }
        totals
    }
}

/// A BTF as a sequence of blocks of rows.
pub(super) struct Stream<'a> {
    btf: &'a Btf,
    block_rows: usize,
    progress: ProgressFn<'a>,
    /// Known after the first pass.
    totals: Option<Totals>,
    pub(super) statistics: Statistics,
}

impl<'a> Stream<'a> {
    pub(super) fn new(btf: &'a Btf, block_rows: usize, progress: ProgressFn<'a>) -> Self {
        let statistics = Statistics {
            block_rows,
            ..Statistics::default()
        };
        Self {
            btf,
            block_rows,
            progress,
            totals: None,
            statistics,
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
        let multiplications = self.rows() as f64 * self.columns() as f64 * width as f64;
        self.statistics.product_flops += f64::from(count) * 2.0 * multiplications;
    }

    /// Sums over the whole BTF; zero before the first pass.
    pub(super) fn totals(&self) -> Totals {
        self.totals.unwrap_or_default()
    }

    /// One pass: `work` gets every block, and returns sums over it if it is there for the first time.
    pub(super) fn pass(&mut self, phase: Phase, mut work: impl FnMut(&Block<'_>) -> Totals) -> Result<()> {
        let (rows, columns) = (self.rows(), self.columns());
        let first_time = self.totals.is_none();
        let mut totals = Totals::default();
        let mut buffer = Vec::new();
        let read_nanoseconds = AtomicU64::new(0);
        let began = Instant::now();
        for start in (0..rows).step_by(self.block_rows) {
            let range = start..(start + self.block_rows).min(rows);
            (self.progress)(Progress {
                phase,
                done: start as u64,
                total: rows as u64,
            });
            let images = start / 3..range.end / 3;
            self.btf
                .prefetch(images.end..(images.end + self.block_rows / 3).min(self.btf.image_count()));
            let samples = self.btf.samples(images.clone(), &mut buffer)?;
            let read_nanoseconds = &read_nanoseconds;
            let sums = work(&Block {
                rows: range.clone(),
                first_time,
                columns,
                samples,
                read_nanoseconds,
            });
            // A NaN or infinity anywhere makes the sum of squares one, and a sample above the limit makes it exceed
            // the limit's square.
            let suspicious = !sums.energy.is_finite() || sums.energy > MAX_SAMPLE * MAX_SAMPLE;
            if first_time
                && suspicious
                && let Some(error) = self.btf.bad_sample(images.start, &samples)
            {
                return Err(error);
            }
            totals.add(sums);
            self.btf.release(images);
            self.statistics.sample_memory();
        }
        (self.progress)(Progress {
            phase,
            done: rows as u64,
            total: rows as u64,
        });
        let read = read_nanoseconds.into_inner() as f64 * 1e-9 / rayon::current_num_threads() as f64;
        self.statistics.read_seconds += read;
        self.statistics.product_seconds += (began.elapsed().as_secs_f64() - read).max(0.0);
        self.totals.get_or_insert(totals);
        self.statistics.passes += 1;
        self.statistics.bytes_read += self.btf.stored_bytes();
        Ok(())
    }
}

/// Texels of one task.
pub(super) fn task_texels(columns: usize) -> usize {
    columns.div_ceil(MAX_TASKS).max(PANEL_TEXELS)
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
