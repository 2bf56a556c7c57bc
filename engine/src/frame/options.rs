//! Budgets and choices.

use crate::{Error, Result, gpu::Shading};

/// Least bytes of host memory: what decodes a few pages at a time.
pub const MIN_HOST_BYTES: u64 = 1 << 20;
/// Largest [`Options::feedback_stride`].
pub const MAX_FEEDBACK_STRIDE: u32 = 8;

/// Budgets and choices. Defaults work.
#[derive(Clone, Debug)]
pub struct Options {
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Bytes of the GPU page cache; rounded down to whole slots, at least one.
    pub page_cache_bytes: u64,
    /// Bytes of the GPU column cache; rounded down to whole slots.
    pub column_cache_bytes: u64,
    /// Bytes of host memory for compressed records and decoded parents, at least [`MIN_HOST_BYTES`].
    pub host_bytes: u64,
    /// Most pages and columns uploaded in one frame, at least one.
    pub uploads_per_frame: usize,
    /// Most records asked for and not yet here, at least one; the source may allow fewer.
    pub requests_in_flight: usize,
    /// Exposure: radiance is multiplied by 2^this before tone mapping.
    pub exposure_stops: f32,
    /// One pixel of each square of this side votes in a frame, another one in the next: 1 to
    /// [`MAX_FEEDBACK_STRIDE`]; 1 lets every pixel vote. Votes are summed over the last stride² frames.
    pub feedback_stride: u32,
    /// Root mean square reflectance that a pixel may lose because component groups are left out where they hardly matter;
    /// 0 leaves out nothing. Reflectance of a white surface is 1.
    pub component_error: f64,
    /// Frames in which a new page comes in; 0: at once. A view has settled when all are in.
    pub fade_frames: u32,
    /// Each frame waits for its own votes and for the picture, so that the same inputs give the same operations.
    /// Programs with a window turn it off: then nothing waits, and votes are used when they have come back. Browsers
    /// never wait.
    pub wait: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: (1280, 720),
            page_cache_bytes: 256 << 20,
            column_cache_bytes: 128 << 20,
            host_bytes: 256 << 20,
            uploads_per_frame: 64,
            requests_in_flight: 64,
            exposure_stops: 0.0,
            feedback_stride: 4,
            component_error: Shading::default().component_error,
            fade_frames: Shading::default().fade_frames,
            wait: true,
        }
    }
}

impl Options {
    pub(super) fn check(&self) -> Result<()> {
        let wrong = |text: String| Err(Error::Budget(text));
        if self.host_bytes < MIN_HOST_BYTES {
            return wrong(format!(
                "{} bytes of host memory: at least {MIN_HOST_BYTES} are needed",
                self.host_bytes
            ));
        }
        if self.uploads_per_frame == 0 || self.requests_in_flight == 0 {
            return wrong("uploads in a frame and requests in flight must be at least one each".into());
        }
        if !(1..=MAX_FEEDBACK_STRIDE).contains(&self.feedback_stride) {
            return wrong(format!(
                "a feedback stride of {}: 1 to {MAX_FEEDBACK_STRIDE}",
                self.feedback_stride
            ));
        }
        if !(0.0..f64::INFINITY).contains(&self.component_error) {
            return wrong(format!(
                "a component error of {}: 0 or a small positive number",
                self.component_error
            ));
        }
        if !self.exposure_stops.is_finite() {
            return wrong(format!(
                "an exposure of {} stops: a finite number is needed",
                self.exposure_stops
            ));
        }
        Ok(())
    }
}
