//! Which rank and which quantizer step meet a goal.
//!
//! The error of an archive is what the rank leaves out and what coding loses; both cost bytes: another component costs
//! its eigen-ABRDF and its pages, a finer step costs more of every page. The search codes an archive for a handful of
//! ranks, each with the step that just meets the goal, and keeps the cheapest. Everything is measured on archives that
//! were really coded; models only choose what to try next.

mod archive;
mod search;

pub(crate) use archive::{overhead_bytes, rank_error_for, reach, terms_within};

use serde::Serialize;

use crate::{Error, Result};

/// What an archive shall meet.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Goal {
    /// At most this root mean square error, relative to the root mean square of the BTF, in as few bytes as possible.
    RelativeError(f64),
    /// At least this peak signal-to-noise ratio in decibels, in as few bytes as possible. The peak is 1, the
    /// reflectance of a white Lambertian surface, whatever the BTF's own maximum: highlights have none.
    Psnr(f64),
    /// The least error in an archive of at most so many bytes, all of the file counted.
    Bytes(u64),
}

impl Goal {
    /// The relative error that is allowed for a BTF of this root mean square; `None` if the goal is no error.
    fn relative_error(self, btf_rms: f64) -> Option<f64> {
        match self {
            Goal::RelativeError(error) => Some(error),
            Goal::Psnr(decibels) => Some(rms_of_psnr(decibels) / btf_rms.max(f64::MIN_POSITIVE)),
            Goal::Bytes(_) => None,
        }
    }

    /// # Errors
    /// [`Error::Invalid`] for a goal out of range.
    pub(crate) fn check(self) -> Result<()> {
        let (what, found, good, expected) = match self {
            Goal::RelativeError(error) => (
                "target error (root mean square, relative to that of the BTF)",
                error.to_string(),
                (1e-4..1.0).contains(&error),
                "from 0.0001, where half floats end, to below 1",
            ),
            Goal::Psnr(decibels) => (
                "target PSNR in decibels",
                decibels.to_string(),
                (0.0..=120.0).contains(&decibels),
                "from 0 to 120",
            ),
            Goal::Bytes(bytes) => (
                "largest size of the archive in bytes",
                bytes.to_string(),
                bytes >= 1024,
                "at least 1024",
            ),
        };
        if good {
            return Ok(());
        }
        Err(Error::Invalid {
            what,
            found,
            expected,
        })
    }
}

impl std::fmt::Display for Goal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Goal::RelativeError(error) => write!(f, "a relative error of {error}"),
            Goal::Psnr(decibels) => write!(f, "a PSNR of {decibels} dB"),
            Goal::Bytes(bytes) => write!(f, "an archive of {bytes} bytes"),
        }
    }
}

/// The peak signal-to-noise ratio of an error in decibels: see [`Goal::Psnr`]. `None` if there is no error at all.
pub fn psnr(rms: f64) -> Option<f64> {
    (rms > 0.0).then(|| -20.0 * rms.log10())
}

/// The inverse of [`psnr`].
pub(crate) fn rms_of_psnr(decibels: f64) -> f64 {
    10f64.powf(-decibels / 20.0)
}
