//! What a user says about an input that is no archive.

use ::preprocess::source::{Color, Overrides};
use clap::{Args, ValueEnum};

/// What no file says, or what it says wrongly.
#[derive(Args, Clone, Copy, Default)]
pub(crate) struct InputArguments {
    /// Whether the material repeats in both directions.
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    wrap: Option<bool>,
    /// Whether the samples include the cosine of the light's polar angle.
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    cosine: Option<bool>,
    /// What the numbers in images mean; without it the encoding decides.
    #[arg(long, value_enum)]
    color: Option<Numbers>,
}

/// What the numbers in images mean.
#[derive(Clone, Copy, ValueEnum)]
enum Numbers {
    /// sRGB with its transfer function
    Srgb,
    /// Linear RGB
    Linear,
    /// CIE XYZ, D65
    Xyz,
}

impl InputArguments {
    pub(crate) fn overrides(&self) -> Overrides {
        Overrides {
            wrap: self.wrap,
            cosine: self.cosine,
            color: self.color.map(|numbers| match numbers {
                Numbers::Srgb => Color::Srgb,
                Numbers::Linear => Color::Linear,
                Numbers::Xyz => Color::Xyz,
            }),
        }
    }
}
