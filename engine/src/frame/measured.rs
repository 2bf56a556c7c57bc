//! What measurements need: votes to record, and frames that only draw, to compare with.

use scenes::Camera;
use tileset::PageId;

use super::{Clock, Engine, FrameStats, phases::material_info};
use crate::{
    Error, Result,
    gpu::GpuMilliseconds,
    metrics::Picture,
    residency::{Item, MaterialId, MaterialInfo, Vote},
};

impl Engine {
    /// The votes of the present view as residency has seen them last: sums over the newest votes of each phase, by
    /// material and tile.
    pub fn votes(&mut self) -> &[Vote] {
        self.window.votes()
    }

    /// What residency knows of the materials that are known, in the order of their ids.
    pub fn material_infos(&self) -> impl Iterator<Item = MaterialInfo> + '_ {
        self.btfs.iter().map(|btf| material_info(btf))
    }

    /// A frame that is not drawn unless nothing more is to come: what is decided and fetched is the same. Pictures that
    /// nobody looks at need not be shaded to be streamed; [`Engine::show`] draws one.
    ///
    /// # Errors
    /// Those of [`Engine::frame`].
    pub fn step(&mut self, camera: &Camera) -> Result<FrameStats> {
        self.advance(camera, false)
    }

    /// Times the phases of frames ([`FrameStats::ms`]) with this clock from now on: that of the processor time of the
    /// calling thread tells work from waiting for a processor.
    pub fn time_with(&mut self, clock: Clock) {
        self.phase_clock = clock;
    }

    /// Draws the view of the last frame with what is there now, if that has not been done. Waits for the GPU.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device fails.
    pub fn show(&mut self) -> Result<Picture> {
        self.draw()?;
        self.picture()
    }

    /// Archives that are known, in the order of their ids, and whether each shows something of its own: column and root
    /// of the first group are resident.
    pub fn shown(&self) -> impl Iterator<Item = (&str, bool)> {
        self.btfs.iter().zip(0..).map(|(btf, material)| {
            let material = MaterialId(material);
            let root = PageId {
                group: 0,
                tile: btf.pyramid().root(),
            };
            let first = [Item::Column(material, 0), Item::Page(material, root)];
            let there = first.iter().all(|item| self.residency.slot(*item).is_some());
            (&*btf.archive, there)
        })
    }

    /// Copies all that is resident to where a renderer without virtual textures would have it: caches with a place for
    /// each page and column of each material, which the shader computes. [`Engine::draw_resident`] draws from there until
    /// the size of the picture, the caches or the known materials change.
    ///
    /// # Errors
    /// [`Error::Budget`] if all pages of all materials take more than a gibibyte, or more array layers than the adapter
    /// has; [`Error::Adapter`] if the device fails.
    pub fn lay_out_resident(&mut self) -> Result<()> {
        let resident = self.residency.resident();
        let pages = resident.iter().filter_map(|&(item, slot)| match item {
            Item::Page(material, page) => Some((material.0.into(), page, slot)),
            Item::Column(..) => None,
        });
        let columns = resident.iter().filter_map(|&(item, slot)| match item {
            Item::Column(material, group) => Some((material.0.into(), group, slot)),
            Item::Page(..) => None,
        });
        let btf_of = self.archives.btf_of_material();
        self.renderer.lay_out_resident(pages, columns, &btf_of)
    }

    /// Draws what a camera sees with what [`Engine::lay_out_resident`] has copied, and does nothing else: visibility,
    /// classification, shading of all component groups without a page table, and tone mapping. No votes are asked for,
    /// nothing is decided, fetched, decoded, placed or faded. If nothing was copied, what is resident is drawn, by the page
    /// table. The next [`Engine::frame`] sees a new view.
    ///
    /// # Errors
    /// [`Error::Scene`] for an unusable camera, [`Error::Adapter`] if the device fails.
    pub fn draw_resident(&mut self, camera: &Camera) -> Result<()> {
        if let Some(problem) = camera.problem() {
            return Err(Error::Scene(format!("the camera {problem}")));
        }
        self.renderer.look(Some(camera), None);
        self.renderer.draw_resident(self.options.exposure_stops.exp2());
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
