//! What measurements need: votes to record, and frames that only draw, to compare with.

use scenes::Camera;

use super::{Engine, phases::material_info};
use crate::{
    Error, Result,
    gpu::GpuMilliseconds,
    residency::{MaterialInfo, Vote},
};

impl Engine {
    /// The votes of the present view as residency has seen them last: sums over the newest votes of each phase, by
    /// material and tile.
    pub fn votes(&mut self) -> &[Vote] {
        self.window.votes()
    }

    /// What residency knows of the materials that are known, in the order of their ids.
    pub fn materials(&self) -> impl Iterator<Item = MaterialInfo> + '_ {
        self.btfs.iter().map(|btf| material_info(btf))
    }

    /// Draws what a camera sees with what is resident, and does nothing else: visibility, classification, shading and
    /// tone mapping. No votes are asked for, nothing is decided, fetched, decoded, placed or faded. With all that is
    /// wanted resident it is the renderer without virtual textures, but for the page table, which is still read. The next
    /// [`Engine::frame`] sees a new view.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unusable camera, [`Error::Adapter`] if the device fails.
    pub fn draw_resident(&mut self, camera: &Camera) -> Result<()> {
        if let Some(problem) = camera.problem() {
            return Err(Error::Scene(format!("the camera {problem}")));
        }
        self.renderer.look(Some(camera), None);
        self.renderer.draw(self.options.exposure_stops.exp2());
        // The ids that are there are not those of the last frame.
        self.camera = None;
        self.changed = true;
        self.poll()
    }

    /// Waits for all that was submitted, at once in browsers, and takes what comes back. Returns the times of the passes
    /// of the newest frame, where the adapter can tell.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device fails.
    pub fn wait(&mut self) -> Result<Option<GpuMilliseconds>> {
        self.gpu = None;
        self.renderer.wait()?;
        self.poll()?;
        Ok(self.gpu)
    }
}
