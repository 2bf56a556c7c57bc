//! WGSL of Eigentile, its Rust mirrors and the import resolver.
//!
//! - `wgsl/`: one concept or one pass a file; [`shader`] gives a file with everything it imports.
//! - [`resolve`]: the one `#import`, for build and tests. Some imports stand for one of several files ([`CHOICES`]).
//! - [`mirror`]: structs as they lie in GPU memory, compared with WGSL member by member in the tests.

pub mod mirror;
mod reflect;
pub mod resolve;

pub use reflect::{Field, Mirror, WgslType};
pub use resolve::{CHOICES, Error, NAMES, shader, variant};
