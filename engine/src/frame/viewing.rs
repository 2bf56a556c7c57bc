//! What viewers change while a scene is shown.

use scenes::{Light, Scene};

use super::{Arithmetic, Engine, Filter, MAX_PREFETCH_SECONDS, Options};
use crate::{Result, gpu::Context};

impl Engine {
    /// Budgets and choices as they are.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The device that draws.
    pub fn context(&self) -> &Context {
        self.renderer.context()
    }

    /// What a screen shows of the last picture, for [`crate::gpu::Present`]; another one after [`Engine::resize`].
    pub fn screen(&self) -> &wgpu::TextureView {
        self.renderer.screen()
    }

    /// Replaces the lights. Nothing has to be streamed for it.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] for more than the adapter holds.
    pub fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        self.renderer.set_lights(lights)?;
        self.changed = true;
        Ok(())
    }

    /// Replaces meshes, instances and lights; materials and what is resident of them stay.
    ///
    /// # Errors
    /// [`crate::Error::Scene`] if the scene does not hold together or has another number of materials,
    /// [`crate::Error::Budget`] if it is too large for the adapter; then all stays as it is.
    pub fn set_geometry(&mut self, scene: &Scene) -> Result<()> {
        self.renderer.set_geometry(scene)?;
        // The next frame's view is a new one.
        self.camera = None;
        self.changed = true;
        self.ahead.ask_again();
        Ok(())
    }

    /// Changes what a pixel may lose because component groups are left out: [`Options::component_error`].
    ///
    /// # Errors
    /// [`crate::Error::Budget`] unless it is 0 or positive and finite; then all stays as it is.
    pub fn set_component_error(&mut self, component_error: f64) -> Result<()> {
        self.change(Options {
            component_error,
            ..self.options.clone()
        })
    }

    /// Changes how precisely shading sums: [`Options::arithmetic`].
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the adapter cannot; then all stays as it is.
    pub fn set_arithmetic(&mut self, arithmetic: Arithmetic) -> Result<()> {
        self.change(Options {
            arithmetic,
            ..self.options.clone()
        })
    }

    /// Changes how eigen-textures are filtered: [`Options::filter`].
    ///
    /// # Errors
    /// None that can happen; as [`Engine::set_component_error`].
    pub fn set_filter(&mut self, filter: Filter) -> Result<()> {
        self.change(Options {
            filter,
            ..self.options.clone()
        })
    }

    /// Changes in how many frames new pages come in: [`Options::fade_frames`].
    ///
    /// # Errors
    /// None that can happen; as [`Engine::set_component_error`].
    pub fn set_fade_frames(&mut self, fade_frames: u32) -> Result<()> {
        self.change(Options {
            fade_frames,
            ..self.options.clone()
        })
    }

    /// Changes how far ahead of a moving camera pages are fetched: [`Options::prefetch_seconds`], limited to what it may be.
    pub fn set_prefetch_seconds(&mut self, seconds: f32) {
        let seconds = if seconds.is_nan() { 0.0 } else { seconds };
        self.options.prefetch_seconds = seconds.clamp(0.0, MAX_PREFETCH_SECONDS);
    }

    fn change(&mut self, options: Options) -> Result<()> {
        options.check()?;
        let half = options.half_arithmetic(self.context())?;
        self.renderer.set_half_arithmetic(half)?;
        let btfs = self.btfs.iter().map(|btf| &**btf);
        self.renderer.change_shading(options.shading(), btfs);
        self.options = options;
        self.changed = true;
        Ok(())
    }

    /// Asks anew, at once, for all that could not be had: archives that were given up, and records whose pauses have
    /// grown long. For users who know that the host is there again.
    pub fn retry(&mut self) {
        self.archives.ask_again();
        self.residency.retry();
        // All pixels vote again, so that what they want is looked at anew.
        self.view += 1;
    }
}
