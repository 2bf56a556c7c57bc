//! Budgets and choices.

use crate::{
    Error, Result,
    angular::Angular,
    gpu::{Caches, Context, Filter, PageFormat, Shading},
};

/// Least bytes of host memory: what decodes a few pages at a time.
pub const MIN_HOST_BYTES: u64 = 1 << 20;
/// Largest [`Options::feedback_stride`].
pub const MAX_FEEDBACK_STRIDE: u32 = 8;
/// Largest [`Options::prefetch_seconds`]: what lies further ahead nobody can tell from the motion so far.
pub const MAX_PREFETCH_SECONDS: f32 = 2.0;

/// What may be used of each resource. [`super::Engine::set_budgets`] changes it at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budgets {
    /// Bytes of the GPU page cache; rounded down to whole slots, at least one.
    pub page_cache_bytes: u64,
    /// Bytes of the GPU column cache; rounded down to whole slots, at least one.
    pub column_cache_bytes: u64,
    /// Bytes of host memory for compressed records and decoded pages, at least [`MIN_HOST_BYTES`].
    pub host_bytes: u64,
    /// Most pages and columns uploaded in one frame, at least one.
    pub uploads_per_frame: usize,
    /// Most records handed to the decoder in one frame, at least one. Where there are threads they decode beside the
    /// frames; in browsers, and with [`Options::wait`], decoding is part of the frame.
    pub decodes_per_frame: usize,
    /// Most records asked of the source and not yet handed to the caches, at least one; the source may allow fewer.
    pub requests_in_flight: usize,
    /// Most bytes asked of the source and not yet here, at least one; a single record may take more.
    pub bytes_in_flight: u64,
}

impl Budgets {
    fn check(&self) -> Result<()> {
        let wrong = |text: String| Err(Error::Budget(text));
        if self.host_bytes < MIN_HOST_BYTES {
            return wrong(format!(
                "{} bytes of host memory: at least {MIN_HOST_BYTES} are needed",
                self.host_bytes
            ));
        }
        let counts = [
            self.uploads_per_frame,
            self.decodes_per_frame,
            self.requests_in_flight,
        ];
        if counts.contains(&0) || self.bytes_in_flight == 0 {
            return wrong(
                "uploads and decodes in a frame, requests and bytes in flight must be at least one each"
                    .into(),
            );
        }
        Ok(())
    }
}

/// Where pages are made of what entropy decoding leaves, which is always the workers'.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decode {
    /// On the GPU, which spares host memory, decoding ancestors again, and a third of the bytes to upload; on the workers
    /// where the GPU is a program on the same processor, which takes ten times as long, and where the page cache holds bytes
    /// ([`PageFormat::Byte`]). See docs/results.md.
    #[default]
    Auto,
    /// On the workers, to texels.
    Cpu,
    /// On the GPU, from coefficients and the parents in the page cache, which must be of half floats. Roots, and archives whose codec cannot be split,
    /// are decoded on the workers all the same.
    Gpu,
}

impl Decode {
    fn is_gpu(self, context: &Context) -> bool {
        match self {
            Decode::Auto => !context.is_software(),
            Decode::Cpu => false,
            Decode::Gpu => true,
        }
    }
}

/// How precisely shading sums over directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Arithmetic {
    /// Half floats on graphics cards that have them, if pixels may err by [`HALF_ERROR`] ([`Options::component_error`]); single precision
    /// on others, and where the graphics card is a program, which would widen and round every number.
    #[default]
    Auto,
    /// Single precision.
    Single,
    /// Half floats, of which sums over component groups are single all the same. With [`Angular::Hemisphere`] texture units
    /// sum, and this changes nothing.
    Half,
}

/// What sums of half floats may change a pixel by, relative: three roundings to 11 bits. See docs/results.md.
pub const HALF_ERROR: f64 = 5e-4;

impl Arithmetic {
    /// Whether half floats are summed by an adapter that is a program or not, where pixels may err by so much.
    fn is_half(self, has_half: bool, software: bool, component_error: f64) -> bool {
        match self {
            Arithmetic::Auto => has_half && !software && component_error >= HALF_ERROR,
            Arithmetic::Single => false,
            Arithmetic::Half => true,
        }
    }
}

/// Budgets and choices. Defaults work.
#[derive(Clone, Debug)]
pub struct Options {
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// What may be used of each resource.
    pub budgets: Budgets,
    /// How far ahead of a moving camera pages are fetched, in seconds, at most [`MAX_PREFETCH_SECONDS`]; 0 for not at
    /// all.
    pub prefetch_seconds: f32,
    /// Exposure: radiance is multiplied by 2^this before tone mapping.
    pub exposure_stops: f32,
    /// One pixel of each square of this side votes in a frame, another one in the next: 1 to
    /// [`MAX_FEEDBACK_STRIDE`]; 1 lets every pixel vote. Votes are summed over the last stride² frames.
    pub feedback_stride: u32,
    /// Root mean square reflectance that a pixel may lose because component groups are left out where they hardly matter;
    /// 0 leaves out nothing. Reflectance of a white surface is 1.
    pub component_error: f64,
    /// How columns are interpolated between directions. [`super::Engine::set_angular`] changes it at run time.
    pub angular: Angular,
    /// How precisely they are summed.
    pub arithmetic: Arithmetic,
    /// How eigen-textures are filtered between mips.
    pub filter: Filter,
    /// Frames in which a new page comes in; 0: at once. A view has settled when all are in.
    pub fade_frames: u32,
    /// Where pages are decoded.
    pub decode_on: Decode,
    /// What texels of the page cache are; `None`: half floats where all that is wanted has room, otherwise as the ledgers of the
    /// scene's materials advise, so that the predicted error is least. What has been better for some frames becomes so; the
    /// picture stays until as much has come in the new format, and both caches are in memory meanwhile.
    pub page_format: Option<PageFormat>,
    /// Each frame waits for its own votes and for the picture, so that the same inputs give the same operations.
    /// Programs with a window turn it off: then nothing waits, and votes are used when they have come back. Browsers
    /// never wait.
    pub wait: bool,
}

impl Default for Budgets {
    fn default() -> Self {
        Self {
            page_cache_bytes: 256 << 20,
            column_cache_bytes: 128 << 20,
            host_bytes: 256 << 20,
            // Requests take two frames at least: as many as can be in flight come in that time.
            uploads_per_frame: 32,
            // Without threads a frame decodes itself: some 3 ms of pages.
            decodes_per_frame: if cfg!(target_arch = "wasm32") { 8 } else { 64 },
            requests_in_flight: 64,
            bytes_in_flight: 16 << 20,
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            size: (1280, 720),
            budgets: Budgets::default(),
            prefetch_seconds: 0.3,
            exposure_stops: 0.0,
            feedback_stride: 4,
            component_error: Shading::default().component_error,
            angular: Angular::default(),
            arithmetic: Arithmetic::default(),
            filter: Filter::default(),
            fade_frames: Shading::default().fade_frames,
            decode_on: Decode::default(),
            page_format: None,
            wait: true,
        }
    }
}

impl Options {
    /// Bytes of the caches on the GPU.
    pub(super) fn caches(&self) -> Caches {
        Caches {
            page_bytes: self.budgets.page_cache_bytes,
            page_format: self.page_format.unwrap_or_default(),
            column_bytes: self.budgets.column_cache_bytes,
            angular: self.angular,
        }
    }

    /// Whether the GPU decodes pages of a cache of this format.
    pub(super) fn decodes_on_gpu(&self, context: &Context, format: PageFormat) -> bool {
        format == PageFormat::Half && self.decode_on.is_gpu(context)
    }

    /// Whether shading sums half floats.
    ///
    /// # Errors
    /// [`Error::Adapter`] if it shall, and the adapter cannot.
    pub(super) fn half_arithmetic(&self, context: &Context) -> Result<bool> {
        let has_half = context.has_half_arithmetic();
        if self.arithmetic == Arithmetic::Half && !has_half {
            return Err(Error::Adapter(format!(
                "{} has no arithmetic of half floats: choose single precision",
                context.adapter()
            )));
        }
        let software = context.is_software();
        Ok(self.arithmetic.is_half(has_half, software, self.component_error))
    }

    /// Choices of shading.
    pub(super) fn shading(&self) -> Shading {
        Shading {
            component_error: self.component_error,
            fade_frames: self.fade_frames,
            filter: self.filter,
        }
    }

    pub(super) fn check(&self) -> Result<()> {
        self.budgets.check()?;
        let wrong = |text: String| Err(Error::Budget(text));
        if (self.decode_on, self.page_format) == (Decode::Gpu, Some(PageFormat::Byte)) {
            return wrong(
                "the GPU cannot decode pages for a cache of bytes, which does not hold their exact parents: \
                 choose half floats, or to decode on the CPU"
                    .into(),
            );
        }
        if !(0.0..=MAX_PREFETCH_SECONDS).contains(&self.prefetch_seconds) {
            return wrong(format!(
                "{} seconds of prefetching: 0 to {MAX_PREFETCH_SECONDS}",
                self.prefetch_seconds
            ));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_floats_are_summed_where_they_are_fast_and_good_enough() {
        let default = Options::default().component_error;
        let is_half = |software, error| Arithmetic::Auto.is_half(true, software, error);
        assert!(is_half(false, default));
        assert!(!is_half(true, default), "a program would only lose time");
        assert!(!is_half(false, 0.0), "the exact picture is wanted");
        assert!(!Arithmetic::Auto.is_half(false, false, default));
        assert!(Arithmetic::Half.is_half(true, true, 0.0));
        assert!(!Arithmetic::Single.is_half(true, false, 1.0));
    }
}
