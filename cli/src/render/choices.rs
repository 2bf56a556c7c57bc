//! How the engine draws: choices that programs with pictures share.

use clap::{Args, ValueEnum};
use engine::angular::Angular;
use engine::frame::{Arithmetic, Decode, Filter, Options};
use engine::gpu::PageFormat;

/// Choices of the engine; without any of them its own.
#[derive(Args, Clone, Copy)]
pub(crate) struct Choices {
    /// Texels of the page cache: half floats, or bytes with a scale for each page, of which twice as many fit; auto takes
    /// what the ledgers of the materials predict the smaller error for.
    #[arg(long, value_name = "FORMAT", default_value = "auto")]
    page_format: Format,
    /// Interpolation between light directions: delaunay (exact, nine fetches) or hemisphere (filtered maps, fewer).
    #[arg(long, value_name = "WAY", default_value = "delaunay")]
    angular: Way,
    /// Sums over directions: in single precision, or of half floats; auto: of half floats on graphics cards that have them.
    #[arg(long, value_name = "PRECISION", default_value = "auto")]
    arithmetic: Precision,
    /// Between mips: trilinear, or bilinear in the nearest mip, which takes one sample instead of two.
    #[arg(long, value_name = "FILTER", default_value = "trilinear")]
    filter: Mips,
    /// Where pages are decoded; auto: on the GPU, but on the CPU where that is a program or the page cache holds bytes.
    #[arg(long, value_name = "WHERE", default_value = "auto")]
    decode_on: Place,
}

#[derive(ValueEnum, Clone, Copy)]
enum Format {
    Auto,
    Half,
    Byte,
}

#[derive(ValueEnum, Clone, Copy)]
enum Way {
    Delaunay,
    Hemisphere,
}

#[derive(ValueEnum, Clone, Copy)]
enum Precision {
    Auto,
    Single,
    Half,
}

#[derive(ValueEnum, Clone, Copy)]
enum Mips {
    Trilinear,
    Bilinear,
}

#[derive(ValueEnum, Clone, Copy)]
enum Place {
    Auto,
    Cpu,
    Gpu,
}

impl Choices {
    /// The same options with these choices.
    pub(crate) fn apply(self, options: Options) -> Options {
        Options {
            page_format: match self.page_format {
                Format::Auto => None,
                Format::Half => Some(PageFormat::Half),
                Format::Byte => Some(PageFormat::Byte),
            },
            angular: match self.angular {
                Way::Delaunay => Angular::Delaunay,
                Way::Hemisphere => Angular::Hemisphere,
            },
            arithmetic: match self.arithmetic {
                Precision::Auto => Arithmetic::Auto,
                Precision::Single => Arithmetic::Single,
                Precision::Half => Arithmetic::Half,
            },
            filter: match self.filter {
                Mips::Trilinear => Filter::Trilinear,
                Mips::Bilinear => Filter::Bilinear,
            },
            decode_on: match self.decode_on {
                Place::Auto => Decode::Auto,
                Place::Cpu => Decode::Cpu,
                Place::Gpu => Decode::Gpu,
            },
            ..options
        }
    }
}
