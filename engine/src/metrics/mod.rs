//! Pictures and how far apart they are.
//!
//! - `tone`: from linear radiance to what a screen shows.
//! - `compare`: all figures of two pictures, as a [`Comparison`] for JSON.
//! - `ssim`: structural similarity. `lab`: CIELAB and its colour differences. `flip`: FLIP and HDR-FLIP.
//!
//! Errors of radiance (RMSE, HDR-FLIP) are taken from linear values, before tone mapping; everything that speaks of what is
//! seen (RMSE and PSNR of what is shown, SSIM, FLIP, ΔE) from what the screen shows: exposed, tone mapped, clipped to [0, 1].
//!
//! They are our own, on f64 and over covered pixels: `image-compare` takes bytes and whole pictures, `dssim` is another
//! measure under the AGPL, `palette` would save a hundred lines. scikit-image, colour-science and the authors' FLIP judge
//! them in the tests.

mod compare;
pub mod flip;
pub mod lab;
pub mod ssim;
pub mod tone;

pub use compare::{Comparison, compare};

/// Linear RGB, `[y][x]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// width × height pixels of radiance.
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// What a screen shows of it, 8 bits per channel, sRGB: see [`tone::srgb8_from_radiance`].
    pub fn to_srgb8(&self, exposure_stops: f32) -> Vec<[u8; 3]> {
        self.pixels
            .iter()
            .map(|&pixel| tone::srgb8_from_radiance(pixel, exposure_stops))
            .collect()
    }
}
