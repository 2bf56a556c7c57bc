//! How large the blocks may be.

use crate::{Btf, Error, Result};

/// More rows than this make the products no faster (512 is the depth at which faer splits them), only memory.
const MAX_BLOCK_ROWS: usize = 512;
/// Fewer rows than this make the products slower than memory: refused as over budget.
const MIN_BLOCK_ROWS: usize = 16;
/// Packed operands of the products, the program and its stacks.
const OVERHEAD_BYTES: u64 = 48 << 20;

/// Bytes that a factorization holds at its peak, by phase. `width` is that of the subspace.
pub(super) struct Plan {
    /// Rows of a block.
    pub(super) block_rows: usize,
}

impl Plan {
    /// The largest useful blocks within `limit_bytes`.
    ///
    /// # Errors
    /// [`Error::OverBudget`] if the factors alone do not fit.
    pub(super) fn new(btf: &Btf, components: u32, width: usize, limit_bytes: u64) -> Result<Self> {
        let (rows, columns) = (btf.rows() as u64, btf.columns() as u64);
        let wide = width as u64;
        let kept = wide.min(components.into());
        // A pass holds Q and Z, both f32, or Q and Y; and its block, mapped and as f32, and the block's Y.
        let pass = 4 * wide * (columns + columns.max(rows));
        let block_row = columns * (4 + btf.dtype().bytes() as u64) + 4 * wide;
        // Householder QR holds Z and Q, and a product of half their size.
        let basis = 10 * wide * columns;
        // Rayleigh-Ritz holds Q, Y, its f64 copy, and the SVD's U and working copy; then both factors.
        let ritz = 4 * wide * columns + (4 + 3 * 8) * wide * rows + 4 * kept * (rows + columns);
        let factors = 4 * kept * (rows + columns);
        let fixed = basis.max(ritz).max(factors) + OVERHEAD_BYTES;
        let useful = MAX_BLOCK_ROWS.min(btf.rows());
        let affordable = limit_bytes.saturating_sub(pass + OVERHEAD_BYTES) / block_row;
        let least = MIN_BLOCK_ROWS.min(btf.rows());
        let needed_bytes = fixed.max(pass + OVERHEAD_BYTES + least as u64 * block_row);
        if needed_bytes > limit_bytes {
            return Err(Error::OverBudget {
                components,
                rows: btf.rows(),
                columns: btf.columns(),
                needed_bytes,
                limit_bytes,
            });
        }
        Ok(Self {
            block_rows: useful.min(usize::try_from(affordable).unwrap_or(usize::MAX)),
        })
    }
}
