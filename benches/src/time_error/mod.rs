//! Run time over error, of every setting that trades one for the other.
//!
//! A [`Family`] is one knob at several settings, the program's default among them; the rest is as it is by default.
//!
//! - [`measure`] (`run`) measures all of them on one scene and one BTF.
//! - `pictures`: component groups, their cut-off, interpolation of directions, filter, arithmetic, format of the page cache: frames of
//!   settled views, against the best picture that the archives allow.
//! - `codes`: the quantizer: decoding, against V'. `factors`: passes of the factorization, against the BTF.
//! - `front`: which settings are the best of their kind, and which are beaten by which. `rounds`: times by turns.
//! - [`table`] and [`report`](fn@report) show.
//!
//! A setting and the default run by turns in the same process, and what counts is the median of their ratios: machines are noisy. Beside the
//! time stands a count of work that is the same on every machine, by which tests judge. Errors are relative root mean
//! squares, in the one unit that all errors of archives have.

mod codes;
mod factors;
mod front;
mod pictures;
mod report;
mod rounds;
mod run;

use serde::{Deserialize, Serialize};

pub use front::Judge;
pub use pictures::Plan;
pub use report::{plot, report, rows, table};
pub use run::{Input, Row, measure};

/// What is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knob {
    /// The leading component groups that are used, as a lower rank would have them.
    Components,
    /// What a pixel may lose because component groups are left out.
    CutOff,
    /// How columns are interpolated between directions.
    Angular,
    /// Whether eigen-textures are filtered between mips.
    Filter,
    /// How precisely shading sums.
    Arithmetic,
    /// Texels of the page cache.
    PageFormat,
    /// The step of the archive's quantizer.
    Quantizer,
    /// Passes of the factorization over the samples.
    Passes,
}

/// One setting of a knob.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// What is set.
    pub setting: String,
    /// Milliseconds, median.
    pub ms: f64,
    /// Time over that of the default beside it, median.
    pub ratio: f64,
    /// Half the distance of the quartiles of that.
    pub noise: f64,
    /// A count of work that is the same on every machine: see [`Knob::counted`].
    pub work: f64,
    /// What it takes of memory, see [`Knob::bytes`]; none where that does not depend on the setting.
    pub bytes: Option<u64>,
    /// Relative root mean square error: see [`Knob::error`].
    pub error: f64,
    /// The same against the BTF, where `error` is against something else and the BTF is known.
    pub error_of_btf: Option<f64>,
    /// Which setting is no slower, no larger and no worse, and better in one of these; none on the front.
    pub beaten_by: Option<String>,
}

/// A knob at several settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Family {
    /// What is set.
    pub knob: Knob,
    /// Which of the points is the default.
    pub default: usize,
    /// By setting.
    pub points: Vec<Point>,
}

/// All that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// What was drawn, coded and factorized.
    pub name: String,
    /// Times that each setting ran.
    pub rounds: usize,
    /// By knob.
    pub families: Vec<Family>,
    /// Knobs that could not be measured, and why.
    #[serde(default)]
    pub skipped: Vec<String>,
}

impl Knob {
    /// For people.
    pub fn title(self) -> &'static str {
        match self {
            Self::Components => "component groups",
            Self::CutOff => "cut-off of components",
            Self::Angular => "interpolation of directions",
            Self::Filter => "filter of textures",
            Self::Arithmetic => "arithmetic of sums",
            Self::PageFormat => "format of the page cache",
            Self::Quantizer => "step of the quantizer",
            Self::Passes => "passes of the factorization",
        }
    }

    /// What is timed.
    pub fn timed(self) -> &'static str {
        match self {
            Self::Quantizer => "decoding all pages on one core",
            Self::Passes => "factorizing",
            _ => "a frame",
        }
    }

    /// What is counted.
    pub fn counted(self) -> &'static str {
        match self {
            Self::Quantizer => "bytes of pages",
            Self::Passes => "floating point operations of products with samples",
            _ => "samples of textures",
        }
    }

    /// What takes memory.
    pub fn bytes(self) -> Option<&'static str> {
        match self {
            Self::Quantizer => Some("archive"),
            Self::Passes => None,
            _ => Some("pages and columns on the GPU"),
        }
    }

    /// What the error is measured against.
    pub fn error(self) -> &'static str {
        match self {
            Self::Quantizer => "V'",
            Self::Passes => "the BTF",
            _ => "the best picture",
        }
    }
}

impl Family {
    /// Judges measured points.
    fn new(knob: Knob, default: usize, mut points: Vec<Point>) -> Self {
        let beaten = front::beaten(&points, Judge::Measured);
        for (at, by) in beaten.into_iter().enumerate() {
            points[at].beaten_by = by.map(|by| points[by].setting.clone());
        }
        Self {
            knob,
            default,
            points,
        }
    }

    /// The index of the setting that beats the default, if any.
    pub fn beats_default(&self, judge: Judge) -> Option<usize> {
        front::beaten(&self.points, judge)[self.default]
    }
}
