//! How large the blocks may be.

use super::stream::{SCRATCH_BYTES, task_texels};
use crate::{Btf, Error, Result};

/// More rows than this make the products no faster (512 is the depth at which faer splits them), only memory.
/// Whole images of three rows.
const MAX_BLOCK_ROWS: usize = 510;
/// Fewer rows than this would leave the products waiting for memory: refused as over budget.
const MIN_BLOCK_ROWS: usize = 15;
/// Packed operands of the products, the program and its stacks.
const OVERHEAD_BYTES: u64 = 32 << 20;

/// What the system's allocator makes of this many bytes in use: it keeps what is freed between pieces that are
/// not. A quarter was measured at the full size; a third is reserved.
fn resident(bytes: u64) -> u64 {
    bytes.saturating_mul(4) / 3
}

/// The most rows of a block, up to what is useful, with which factorizing and coding stay within `limit_bytes` at its
/// peak. `width` is that of the subspace.
///
/// # Errors
/// [`Error::OverBudget`] if the factors alone do not fit.
pub(super) fn block_rows(btf: &Btf, components: u32, width: usize, limit_bytes: u64) -> Result<usize> {
    let (rows, columns) = (btf.rows() as u64, btf.columns() as u64);
    let wide = width as u64;
    let kept = wide.min(components.into());
    // A pass holds Q and Z, both f32, or Q and Y; orthonormalization Z and Q.
    let pass = 4 * wide * (columns + columns.max(rows));
    // For each of its rows a block has mapped samples and, of each task, a product of its own.
    let tasks = btf.columns().div_ceil(task_texels(btf.columns())) as u64;
    let block_row = columns * btf.sample_bytes() as u64 + 4 * wide * (tasks + 1);
    let threads = rayon::current_num_threads() as u64;
    let overhead = OVERHEAD_BYTES + threads * SCRATCH_BYTES as u64;
    // Rayleigh-Ritz holds Q, Y, its f64 copy, and the SVD's U and working copy; then both factors.
    let ritz = 4 * wide * columns + (4 + 3 * 8) * wide * rows + 4 * kept * (rows + columns);
    // Coding holds the factors, a decoded copy in halves and the records, and each thread's mips and pages.
    let coding = 4 * kept * (rows + columns) + 3 * kept * columns + threads * 48 * columns;
    let least = MIN_BLOCK_ROWS.min(btf.rows());
    let needed_bytes = resident(ritz.max(coding).max(pass + least as u64 * block_row)) + overhead;
    if needed_bytes > limit_bytes {
        let (rows, columns) = (btf.rows(), btf.columns());
        return Err(Error::OverBudget {
            components,
            rows,
            columns,
            needed_bytes,
            limit_bytes,
        });
    }
    let affordable = ((limit_bytes - overhead) / 4 * 3).saturating_sub(pass) / block_row;
    let affordable = usize::try_from(affordable).unwrap_or(usize::MAX).max(least);
    // An image is three rows.
    Ok((affordable.min(MAX_BLOCK_ROWS) / 3 * 3).min(btf.rows()))
}
