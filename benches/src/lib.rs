//! What is measured, and how: benchmarks by stage (`cargo bench -p benches`), and the library behind `eigentile bench`.
//!
//! - [`codec`]: bytes, error and speed of whole archives at given errors, and the speed of decoding.
//! - [`compare`](mod@compare): two reports of one measurement, figure by figure.
//! - [`endurance`]: an hour at random over a line that fails: memory, budgets, and the picture in the end.
//! - [`engine`](mod@engine): what virtual textures cost in a frame, and what is skipped.
//! - [`factorize`](mod@factorize): seconds, error and memory of one factorization.
//! - [`memory_quality`]: pictures over memory on the GPU, by format of the page cache and by rank.
//! - [`policy`]: predicted error over budget of ways to choose what is resident.
//! - [`range`]: weights and compressed samples at equal rank.
//! - [`replay`](mod@replay): camera and network, recorded, and replayed exactly.
//! - [`scale`]: what grows with the number of materials and their size.
//! - [`serve`]: requests per second, latency and memory of the tile server, beside nginx.
//! - [`stability`]: BTFs that are hard on floating point numbers, against bounds.
//! - [`stream`]: what is seen after how many bytes and seconds, under networks.
//! - [`time_error`]: run time over error, of every setting that trades one for the other.
//! - [`report`]: how all of it is shown. [`results`]: what is kept of it in the tables of documents.
//! - [`KeptFactors`]: factors on disk, so that a codec can be measured again without factorizing again.
//! - [`eigen_textures`], [`small_cloth`], [`sparse_cloth`]: inputs that are made in a moment, for benchmarks of single stages.
//!
//! The programs to measure beside are in `peers/`; they read what is kept here. Results are reported, not judged.

mod capped;
mod cloth;
pub mod codec;
pub mod compare;
pub mod endurance;
pub mod engine;
mod error;
pub mod factorize;
mod kept;
mod memory;
pub mod memory_quality;
mod npy;
pub mod policy;
pub mod range;
pub mod replay;
pub mod report;
pub mod results;
pub mod scale;
pub mod serve;
pub mod stability;
pub mod stream;
mod textures;
pub mod time_error;

pub use cloth::{small_cloth, sparse_cloth};
pub use error::{Error, Result};
pub use kept::KeptFactors;
pub use textures::eigen_textures;
