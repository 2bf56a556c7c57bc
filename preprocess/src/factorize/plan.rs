//! How large blocks and subspace may be.

use super::stream::{SCRATCH_BYTES, task_texels};
use super::{Settings, once};
use crate::{Btf, Error, Result};

/// More rows than this make the products no faster (512 is the depth at which faer splits them), only memory.
/// Whole images of three rows.
const MAX_BLOCK_ROWS: usize = 510;
/// Fewer rows than this would leave the products waiting for memory: refused as over budget.
const MIN_BLOCK_ROWS: usize = 15;
/// Packed operands of the products, sums of Gram matrices, the program and its stacks.
const OVERHEAD_BYTES: u64 = 32 << 20;
/// Vectors of a block where the rank is not known beforehand: few enough to stop soon after enough of them, enough for
/// fast products and few passes.
const GROWTH: usize = 64;
/// Passes where none are asked for and the rank is known: sketch, two power iterations, projection.
const USUAL_PASSES: u32 = 4;
/// The same at most, where each adds much.
const MOST_PASSES: usize = 8;

/// Sizes of one factorization.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Plan {
    /// Rows read at a time.
    pub(super) block_rows: usize,
    /// Vectors of a block of the subspace.
    pub(super) width: usize,
    /// Vectors of all blocks of the subspace where nothing speaks for less or more.
    pub(super) usual: usize,
    /// The same at most.
    pub(super) most: usize,
}

/// What the system's allocator makes of this many bytes in use: it keeps what is freed between pieces that are
/// not. A quarter was measured at the full size; a third is reserved.
fn resident(bytes: u64) -> u64 {
    bytes.saturating_mul(4) / 3
}

/// Bytes beside the samples of a block: at most, and while samples are read.
struct Need {
    peak: u64,
    pass: u64,
}

/// Beside it, what a single pass holds of test vectors and their products.
fn tests_bytes(btf: &Btf, settings: &Settings, width: usize) -> u64 {
    if settings.passes == Some(1) {
        4 * once::tests(width) as u64 * (btf.rows() + btf.columns()) as u64
    } else {
        0
    }
}

/// What a subspace of `total` vectors in blocks of `width`, and `components` terms of it, take.
fn need(btf: &Btf, width: usize, total: usize, components: usize) -> Need {
    let (rows, columns) = (btf.rows() as u64, btf.columns() as u64);
    let (wide, all, kept) = (width as u64, total as u64, components.min(total) as u64);
    // A pass holds all blocks of Q and Y, and Z; orthonormalization of Z copies it twice.
    let blocks = 4 * all * (columns + rows);
    let pass = blocks + 4 * wide * columns;
    let orthonormalization = blocks + 3 * 4 * wide * columns;
    // Rayleigh-Ritz holds all blocks, and the product in f64; or the projection, U and a working copy; then both factors.
    let product = 8 * kept * rows + 4 * kept * (rows + columns);
    let ritz = blocks + product.max(3 * 8 * all * rows);
    // Coding holds the factors, a decoded copy in halves and the records, and each thread's mips and pages.
    let threads = rayon::current_num_threads() as u64;
    let coding = 4 * kept * (rows + columns) + 3 * kept * columns + threads * 48 * columns;
    Need {
        peak: ritz.max(coding).max(orthonormalization),
        pass,
    }
}

/// Sizes with which factorizing and coding stay within the memory that may be used: the widest subspace that is useful,
/// then the most rows of a block, up to what is useful.
///
/// # Errors
/// [`Error::OverBudget`] if the factors alone do not fit.
pub(super) fn plan(btf: &Btf, settings: &Settings) -> Result<Plan> {
    let smaller_side = btf.rows().min(btf.columns());
    let wanted = settings.components as usize + settings.oversampling as usize;
    let passes = settings.passes.unwrap_or(USUAL_PASSES) as usize;
    let (width, most) = match (settings.enough, passes) {
        (Some(_), _) => (GROWTH.min(wanted), wanted),
        // What is never sharpened has to be wider: 32 terms of a ray-traced cloth had 1.8 times the error of four passes.
        (None, 1) => (2 * wanted, 2 * wanted),
        (None, 2) => (wanted, wanted),
        // Twice as many vectors as wanted, in as many blocks as there are passes after the sketch. Measured on a BTF of
        // slowly falling spectrum, rank 100, against two power iterations of 110 vectors (550 products with each row):
        // 3 blocks of 74 have 0.993 of the error with 374 products, of 64 the same error; 2 of 110 have 1.004 with 334.
        (None, _) => {
            let width = (2 * wanted).div_ceil(passes - 1);
            (width, width * (passes - 1))
        }
    };
    let (width, most) = (width.min(smaller_side), most.min(smaller_side));
    let threads = rayon::current_num_threads() as u64;
    let overhead = OVERHEAD_BYTES + threads * (SCRATCH_BYTES as u64 + btf.decoding_bytes());
    let least_rows = MIN_BLOCK_ROWS.min(btf.rows());
    // For each of its rows a block has samples, mapped or decoded, and, of each task, a product of its own.
    let tasks = btf.columns().div_ceil(task_texels(btf.columns())) as u64;
    let block_row = btf.columns() as u64 * btf.sample_bytes() as u64 + 8 * width as u64 * (tasks + 1);
    let needed = |most: usize| {
        let need = need(btf, width, most, settings.components as usize);
        let pass = need.pass + least_rows as u64 * block_row;
        resident(need.peak.max(pass + tests_bytes(btf, settings, width))) + overhead
    };
    let limit_bytes = settings.memory_bytes;
    let most = if settings.enough.is_some() {
        // As wide as fits, from one block on.
        let fitting = |most: &usize| needed(*most) <= limit_bytes;
        (width..=most)
            .rev()
            .step_by(GROWTH)
            .find(fitting)
            .unwrap_or(width)
    } else {
        most
    };
    let needed_bytes = needed(most);
    if needed_bytes > limit_bytes {
        return Err(Error::OverBudget {
            components: settings.components,
            rows: btf.rows(),
            columns: btf.columns(),
            needed_bytes,
            limit_bytes,
        });
    }
    let pass = need(btf, width, most, settings.components as usize).pass + tests_bytes(btf, settings, width);
    let affordable = ((limit_bytes - overhead) / 4 * 3).saturating_sub(pass) / block_row;
    let affordable = usize::try_from(affordable).unwrap_or(usize::MAX).max(least_rows);
    // An image is three rows.
    let block_rows = (affordable.min(MAX_BLOCK_ROWS) / 3 * 3).min(btf.rows());
    let usual = most;
    let mut plan = Plan {
        block_rows,
        width,
        usual,
        most,
    };
    if settings.enough.is_none() && settings.passes.is_none() {
        // As many more as fit beside blocks of as many rows.
        let needed = |most: usize| {
            let need = need(btf, width, most, settings.components as usize);
            resident(need.peak.max(need.pass + block_rows as u64 * block_row)) + overhead
        };
        plan.most = (passes..MOST_PASSES)
            .rev()
            .map(|blocks| (blocks * width).min(smaller_side))
            .find(|&most| needed(most) <= limit_bytes)
            .unwrap_or(usual);
    }
    Ok(plan)
}
