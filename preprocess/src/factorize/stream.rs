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
pub(super) const PANEL_ROWS: usize = 128;
const PANEL_TEXELS: usize = 2048;
/// Distance of rows in scratch memory beyond their length: rows whole powers of two apart share cache sets.
const PADDING: usize = 16;
/// Tasks of a block at most: bounds the memory of their partial sums.
const MAX_TASKS: usize = 64;

/// Bytes of scratch memory of each thread.
pub(super) const SCRATCH_BYTES: usize = PANEL_ROWS * (PANEL_TEXELS + PADDING) * size_of::<f32>();

/// What is summed over all samples while they are read for the first time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Totals {
    /// Sum of squares of each row; as long as rows were read.
    pub(super) energies: Vec<f64>,
    /// Sums of the red, green and blue samples.
    pub(super) sums: [f64; 3],
}

impl Totals {
    /// Totals of rows of zeros.
    fn zero(rows: usize) -> Self {
        Self {
            energies: vec![0.0; rows],
            sums: [0.0; 3],
        }
    }

    /// ‖B‖².
    pub(super) fn energy(&self) -> f64 {
        self.energies.iter().sum()
    }

    /// ‖D·B‖² for D = diag(√w).
    pub(super) fn weighted_energy(&self, weights: &[f32]) -> f64 {
        weigh(&self.energies, weights)
    }

    /// The same sums over samples `scale` times as large.
    pub(super) fn multiply(&mut self, scale: f64) {
        self.energies
            .iter_mut()
            .for_each(|energy| *energy *= scale * scale);
        self.sums.iter_mut().for_each(|sum| *sum *= scale);
    }

    /// Adds what was summed over other texels of the same rows.
    fn add(&mut self, other: &Totals) {
        for (sum, other) in self.energies.iter_mut().zip(&other.energies) {
            *sum += other;
        }
        for (sum, other) in self.sums.iter_mut().zip(other.sums) {
            *sum += other;
        }
    }

    /// Appends what was summed over the rows that follow.
    pub(super) fn append(&mut self, next: Totals) {
        self.energies.extend(next.energies);
        for (sum, next) in self.sums.iter_mut().zip(next.sums) {
            *sum += next;
        }
    }
}

/// Consecutive rows of a BTF.
pub(super) struct Block<'a> {
    /// Which rows of the matrix.
    pub(super) rows: Range<usize>,
    btf: &'a Btf,
    columns: usize,
    samples: Samples<'a>,
    /// Power of two that samples are multiplied by.
    scale: f32,
    /// Time that threads spent on conversion, all together.
    read_nanoseconds: &'a AtomicU64,
}

impl Block<'_> {
    /// Checks the samples that gave these totals.
    ///
    /// # Errors
    /// [`crate::Error::BadSample`] for the first sample that is not finite or too large.
    pub(super) fn check(&self, totals: &Totals) -> Result<()> {
        // A NaN or infinity anywhere makes the sum of squares one, and a sample above the limit makes it exceed the
        // limit's square.
        let energy = totals.energy();
        if energy.is_finite() && energy <= MAX_SAMPLE * MAX_SAMPLE {
            return Ok(());
        }
        self.btf
            .bad_sample(self.rows.start / 3, &self.samples)
            .map_or(Ok(()), Err)
    }

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
                    if self.scale != 1.0 {
                        out[..texels].iter_mut().for_each(|sample| *sample *= self.scale);
                    }
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

    /// Sums over the whole block, from those of its tasks.
    pub(super) fn sum_of<'t>(&self, tasks: impl IntoIterator<Item = &'t Totals>) -> Totals {
        let mut sum = Totals::zero(self.rows.len());
        tasks.into_iter().for_each(|totals| sum.add(totals));
        sum
    }

    /// Nothing, for a task to start from.
    pub(super) fn no_totals(&self) -> Totals {
        Totals::zero(self.rows.len())
    }

    /// Adds the sums over a panel of this block.
    pub(super) fn add_totals(&self, first_row: usize, panel: MatMut<'_, f32>, totals: &mut Totals) {
        for (index, row) in panel.as_ref().row_iter().enumerate() {
            let samples = row.try_as_row_major().map_or(&[][..], |row| row.as_slice());
            let (sum, energy) = sum_in_f64(samples);
            totals.energies[first_row + index] += energy;
            totals.sums[(self.rows.start + first_row + index) % 3] += sum;
        }
    }
}

/// A BTF as a sequence of blocks of rows.
pub(super) struct Stream<'a> {
    btf: &'a Btf,
    block_rows: usize,
    progress: ProgressFn<'a>,
    /// Power of two that samples are multiplied by.
    pub(super) scale: f32,
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
            scale: 1.0,
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

    /// One pass over the rows from `first_row` on: `work` gets every block, in order.
    ///
    /// # Errors
    /// Those of the format, and of `work`.
    pub(super) fn pass(
        &mut self,
        phase: Phase,
        first_row: usize,
        mut work: impl FnMut(&Block<'_>) -> Result<()>,
    ) -> Result<()> {
        let (rows, columns) = (self.rows(), self.columns());
        let mut buffer = Vec::new();
        let read_nanoseconds = AtomicU64::new(0);
        let began = Instant::now();
        for start in (first_row..rows).step_by(self.block_rows) {
            let range = start..(start + self.block_rows).min(rows);
            (self.progress)(Progress {
                phase,
                done: start as u64,
                total: rows as u64,
            });
            let images = start / 3..range.end / 3;
            self.btf
                .prefetch(images.end..(images.end + self.block_rows / 3).min(self.btf.image_count()));
            let reading = Instant::now();
            let samples = self.btf.samples(images.clone(), &mut buffer)?;
            // Decoding is on all threads or on one with nothing else to do: counted as if on all.
            let nanoseconds = reading.elapsed().as_nanos() as u64 * rayon::current_num_threads() as u64;
            read_nanoseconds.fetch_add(nanoseconds, Ordering::Relaxed);
            work(&Block {
                btf: self.btf,
                rows: range.clone(),
                columns,
                samples,
                scale: self.scale,
                read_nanoseconds: &read_nanoseconds,
            })?;
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
        self.statistics.passes += 1;
        self.statistics.bytes_read +=
            (self.btf.stored_bytes() as f64 * (rows - first_row) as f64 / rows as f64) as u64;
        self.statistics.resumed_rows += first_row as u64;
        Ok(())
    }

    /// Counts the operations of products of the whole matrix with `width` vectors.
    pub(super) fn count_products(&mut self, width: usize) {
        self.statistics.product_flops += 2.0 * self.rows() as f64 * self.columns() as f64 * width as f64;
    }
}

/// Σ w·e.
pub(super) fn weigh(energies: &[f64], weights: &[f32]) -> f64 {
    let pairs = energies.iter().zip(weights);
    pairs.map(|(energy, &weight)| energy * f64::from(weight)).sum()
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
