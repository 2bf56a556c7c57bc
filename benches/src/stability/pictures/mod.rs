//! The whole way, from BTF to pixel: BTFs that are hard on floating point numbers, in views that are hard to draw.
//!
//! Each case is factorized, coded, streamed and drawn by the engine, and shaded in f64 twice from the pixels that the engine saw: from its
//! samples, and from its decoded archive. What is promised of every pixel:
//!
//! - it is finite;
//! - against the decoded archive it is off by rounding only;
//! - against the samples it is off by no more than what the archive lost there, and rounding. A pixel is a mean of samples
//!   of weights wᵢ, so by Jensen's inequality (Σ wᵢ eᵢ)² ≤ Σ wᵢ eᵢ²: squared errors of the archive, filtered and interpolated as its
//!   samples are, bound the squared error of the pixel. There is one light, of irradiance π, so that its cosine, at most 1, only lowers it.
//!
//! The mean of these squared errors over the BTF is what the ledger states, which is held against it.
//!
//! `views`: what is looked at, and from where. `judge`: what is right, in f64. `run`: all cases in all views.

mod judge;
mod run;
mod table;
mod views;

pub use run::{PictureRow, pictures};
pub use table::pictures_table;
