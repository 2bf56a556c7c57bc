//! What of a scene can change while it is shown: lights, meshes, how much is left out.

use scenes::{Light, Scene};

use super::{
    context::Context,
    cutoff::groups_that_matter,
    geometry::{self, Geometry},
    materials::Btf,
    renderer::Renderer,
    resources::Shading,
};
use crate::{Error, Result};

impl Renderer {
    /// Replaces the lights.
    ///
    /// # Errors
    /// [`Error::Budget`] for more than the adapter holds.
    pub fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        if self.geometry.set_lights(&self.context, lights)? {
            self.bind();
        }
        self.frame.light_count = lights.len() as u32;
        Ok(())
    }

    /// Replaces meshes and instances; the scene's materials must be those that are there.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene does not hold together or has other materials, [`Error::Budget`] if it is too large
    /// for the adapter; then all stays as it is.
    pub fn set_geometry(&mut self, scene: &Scene) -> Result<()> {
        if scene.materials.len() != self.scene_materials.len() {
            return Err(Error::Scene(format!(
                "{} materials in the place of {}: only meshes, instances and lights can be replaced",
                scene.materials.len(),
                self.scene_materials.len()
            )));
        }
        self.geometry = Geometry::new(&self.context, scene)?;
        self.frame.light_count = scene.lights.len() as u32;
        self.bind();
        self.context.check()
    }

    /// Changes how pages fade in, and which component groups may be left out of the BTFs that are shown.
    pub fn change_shading<'a>(&mut self, shading: Shading, btfs: impl Iterator<Item = &'a Btf>) {
        let error = self.materials.shading.component_error;
        self.set_shading(shading);
        if shading.component_error != error {
            for (at, btf) in btfs.enumerate() {
                let matter = groups_that_matter(&btf.index, shading.component_error);
                self.materials.page_table.set_matter(at, &matter);
            }
        }
    }

    /// What a screen shows of the last picture: 8-bit sRGB, for [`super::Present`].
    pub fn screen(&self) -> &wgpu::TextureView {
        &self.targets.screen.view
    }
}

impl Geometry {
    /// Replaces the lights; returns whether that took another buffer.
    fn set_lights(&mut self, context: &Context, lights: &[Light]) -> Result<bool> {
        let lights: Vec<_> = lights.iter().map(geometry::light).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&lights);
        if bytes.len() as u64 <= self.lights.size() {
            context.queue.write_buffer(&self.lights, 0, bytes);
            return Ok(false);
        }
        self.lights = super::bind::storage(context, "lights", &lights)?;
        Ok(true)
    }
}
