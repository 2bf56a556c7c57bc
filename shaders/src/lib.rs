//! WGSL of Eigentile, its Rust mirrors and the import resolver.
//!
//! - `wgsl/`: one concept or one pass a file; [`shader`] gives a file with everything it imports.
//! - [`resolve`]: the one `#import`, for build and tests.
//! - [`mirror`]: structs as they lie in GPU memory, compared with WGSL member by member in the tests.

pub mod mirror;
mod reflect;
pub mod resolve;

pub use reflect::{Field, Mirror, WgslType};
pub use resolve::{Error, NAMES, shader};
