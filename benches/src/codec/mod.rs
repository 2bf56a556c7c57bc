//! Bytes, error and speed of whole archives, at steps that meet given errors.
//!
//! The error is that of the decoded finest mips against V', relative: √(Σ(decoded − V')² / ΣV'²) over all components,
//! in f64, and includes the rounding to half floats. Bytes are those of the whole file, by kind. Coding uses all
//! cores, decoding one.
//!
//! Not here: the peers. They code the same V', which is kept beside the archives; see `benches/peers`.

mod decode;
mod measure;
mod search;

pub use decode::{DecodeSpeed, Pages};
pub use measure::{Material, Plan, Point, measure};
