//! What an engine has to show, and what of it can be changed between frames.

use super::{Counters, Engine, Event};
use crate::{Result, angular::Angular, gpu::ShadingWork, metrics::Picture, residency::Summary};

impl Engine {
    /// What residency knows of itself.
    pub fn summary(&self) -> Summary {
        self.residency.summary()
    }

    /// Work that was not needed, and work that went wrong, since the start.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// What has happened since the last call, the oldest first. A program that wants to know when the picture is as good
    /// as it gets waits for [`Event::Settled`]. Of events that nobody takes the newest thousand are kept.
    pub fn events(&mut self) -> impl Iterator<Item = Event> + '_ {
        std::iter::from_fn(|| self.events.take())
    }

    /// What went wrong without stopping the picture: the newest messages, the oldest first.
    pub fn problems(&self) -> impl Iterator<Item = &str> {
        self.problems.iter()
    }

    /// The last picture: linear radiance, before exposure. Waits for the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn picture(&self) -> Result<Picture> {
        self.renderer.picture()
    }

    /// The last picture in 8-bit sRGB with alpha, `[y][x][rgba]`. Waits for the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn tonemapped(&self) -> Result<Vec<u8>> {
        self.renderer.tonemapped()
    }

    /// For each pixel of the last frame the instance that it sees, counted from 1, and the triangle of its mesh;
    /// zeros where nothing is. Waits for the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn visibility(&self) -> Result<Vec<[u32; 2]>> {
        self.renderer.visibility()
    }

    /// Draws the picture again and counts what shading it takes, and what was saved. Waits for the GPU.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn shading_work(&mut self) -> Result<ShadingWork> {
        self.renderer.draw_counting(self.options.exposure_stops.exp2())
    }

    /// Bytes of votes that were copied back from the GPU since the start.
    pub fn vote_bytes(&self) -> u64 {
        self.renderer.vote_bytes()
    }

    /// Changes the size of the picture.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] for no pixels, or more than the adapter has.
    pub fn resize(&mut self, size: (u32, u32)) -> Result<()> {
        self.renderer.resize(size)?;
        self.options.size = size;
        // The next frame's view is a new one.
        self.camera = None;
        self.ahead.ask_again();
        Ok(())
    }

    /// Changes the exposure: radiance is multiplied by 2^`stops` before tone mapping.
    pub fn set_exposure_stops(&mut self, stops: f32) {
        self.changed |= stops != self.options.exposure_stops;
        self.options.exposure_stops = stops;
    }

    /// How columns are interpolated between directions.
    pub fn angular(&self) -> Angular {
        self.options.angular
    }

    /// Slots of the column cache, and bytes of each.
    pub fn column_slots(&self) -> (u32, u64) {
        self.renderer.column_slots()
    }

    /// Pixels.
    pub fn size(&self) -> (u32, u32) {
        self.renderer.size()
    }

    /// Name of the adapter and its driver.
    pub fn adapter(&self) -> String {
        self.renderer.adapter()
    }
}
