//! Eigentile's exchange format: `NAME.npy`, f16 or f32, C order, shape (views, lights, 3, height, width), and
//! beside it `NAME.json` with the directions, so that any numpy user can bring data.
//!
//! - [`NpyBtf`]: a BTF that is read through a memory map.
//! - [`read_once`]: a BTF that arrives through a pipe.
//! - [`BtfWriter`]: streams a BTF into a new pair of files.
//! - [`NpyWriter`], [`write_npy_f32`]: any other array.
//!
//! Source: numpy.lib.format, "NPY format", versions 1.0, 2.0 and 3.0. Structured, big-endian and Fortran-ordered
//! arrays are refused with an error that says how to convert them.

mod header;
mod mapped;
mod pipe;
mod writer;

pub use mapped::{Dtype, NpyBtf, Samples};
pub use pipe::read_once;
pub use writer::{BtfWriter, NpyWriter, write_npy_f32};

use serde::{Deserialize, Serialize};
use tileset::Direction;

/// Largest accepted size of a sample. The factorization forms BᵀBQ in f32, which stays finite below it for all
/// accepted numbers of texels and directions; a radiance factor of 1e12 is no measurement.
pub const MAX_SAMPLE: f64 = 1e12;

/// What stands beside the samples in `NAME.json`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampling {
    /// View directions ωo, in the order of the array's first axis.
    pub views: Vec<Direction>,
    /// Light directions ωi, in the order of the array's second axis.
    pub lights: Vec<Direction>,
    /// Whether the material repeats in both directions.
    pub wrap: bool,
    /// Whether the samples include the cosine of the light's polar angle.
    pub cosine: bool,
}

/// The bytes of `NAME.json`: directions are pairs of theta and phi in radians.
#[derive(Serialize, Deserialize)]
struct SamplingFile {
    views: Vec<[f64; 2]>,
    lights: Vec<[f64; 2]>,
    wrap: bool,
    cosine: bool,
}

/// A right angle with slack for tables in degrees or single precision: as manifests of archives accept it.
const MAX_THETA: f64 = std::f64::consts::FRAC_PI_2 + 1e-4;

impl Sampling {
    /// Parses `NAME.json`; the error says what is wrong with it.
    fn parse(text: &str) -> std::result::Result<Self, String> {
        let file: SamplingFile = serde_json::from_str(text).map_err(|error| {
            format!(
                "{error}; expected {{\"views\": [[theta, phi], ...], \"lights\": [[theta, phi], ...], \
                 \"wrap\": true or false, \"cosine\": true or false}}"
            )
        })?;
        let directions = |pairs: &[[f64; 2]]| -> Vec<Direction> {
            pairs
                .iter()
                .map(|&[theta, phi]| Direction { theta, phi })
                .collect()
        };
        let sampling = Self {
            views: directions(&file.views),
            lights: directions(&file.lights),
            wrap: file.wrap,
            cosine: file.cosine,
        };
        sampling.check()?;
        Ok(sampling)
    }

    /// The text of `NAME.json`.
    fn to_json(&self) -> String {
        let pairs = |directions: &[Direction]| -> Vec<[f64; 2]> {
            directions
                .iter()
                .map(|direction| [direction.theta, direction.phi])
                .collect()
        };
        let file = SamplingFile {
            views: pairs(&self.views),
            lights: pairs(&self.lights),
            wrap: self.wrap,
            cosine: self.cosine,
        };
        serde_json::to_string(&file).expect("numbers and booleans always serialize")
    }

    /// Checks counts and angles.
    pub(crate) fn check(&self) -> std::result::Result<(), String> {
        for (what, directions) in [("views", &self.views), ("lights", &self.lights)] {
            let count = directions.len();
            if count == 0 || count > tileset::MAX_DIRECTIONS as usize {
                return Err(format!(
                    "{count} {what}, expected 1 to {}",
                    tileset::MAX_DIRECTIONS
                ));
            }
            for (index, Direction { theta, phi }) in directions.iter().enumerate() {
                if !(0.0..=MAX_THETA).contains(theta) || !phi.is_finite() {
                    return Err(format!(
                        "{what}[{index}] is [{theta}, {phi}], expected theta from 0 to pi/2 and a finite phi, \
                         both in radians"
                    ));
                }
            }
        }
        Ok(())
    }
}

/// Names of the channels in errors.
pub(crate) const CHANNELS: [char; 3] = ['r', 'g', 'b'];

/// The JSON file that belongs to an array.
fn sampling_path(npy: &std::path::Path) -> std::path::PathBuf {
    npy.with_extension("json")
}
