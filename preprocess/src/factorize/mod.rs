//! Truncated singular value decomposition of a BTF that is far larger than memory.
//!
//! The BTF is the m×n matrix B with a row for every (view, light, rgb) and a column for every texel: the full
//! matrix factorization (FMF) of Schwartz, Ruiters, Klein 2013, section 3, equation 2. B is read in passes of
//! bulk products over blocks of rows (`products`), which grow a subspace (`krylov`) that is then rotated to singular
//! vectors (`ritz`); what the result leaves out is computed, not estimated.
//!
//! Factors are scaled so that errors can be read off: U' = √m·U has unit root mean square per component, and
//! with V' = V·Σ/√m a squared difference in V' at a texel is the mean squared error of reflectance there.

mod basis;
mod checkpoint;
mod factors;
mod gram;
mod grow;
mod krylov;
mod low_rank;
mod once;
mod passes;
mod plan;
mod products;
mod refine;
mod ritz;
mod sampled;
mod settings;
mod stream;
mod voronoi;
mod weights;

pub use checkpoint::Checkpoint;
pub use factors::{Factors, Weighted};
pub(crate) use grow::left_out;
pub use grow::{factorize, factorize_resumable};
pub use low_rank::factorize_product;
pub use sampled::Sampled;
pub use settings::{Enough, Settings, Statistics};
pub use weights::Weights;
