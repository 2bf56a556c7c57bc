//! The GPU side of one scene: in which order buffers, caches and passes are used.

use scenes::Scene;
use shaders::mirror;
use tileset::PageId;

use super::{
    borders::Known,
    context::Context,
    decode::{Decode, Waiting},
    geometry::Geometry,
    kept::Kept,
    materials::Btf,
    overlay::OverlayPass,
    page_format::PageFormat,
    readback,
    resident::Resident,
    resources::{Caches, Filter, Groups, Layout, Materials, Passes, Shading},
    shade::{Shade, ShadingWork, Textures, Variant, Way},
    stitch::Stitch,
    targets::{Targets, WORK_HEADER_BYTES},
    timers::{Pass, Timers},
    uploads::Uploads,
    view,
};
use crate::{Result, angular::Angular, residency::Slot};

/// The GPU side of one scene.
pub struct Renderer {
    pub(super) context: Context,
    pub(super) scene_materials: Vec<scenes::Material>,
    pub(super) geometry: Geometry,
    pub(super) frame: mirror::Frame,
    pub(super) frame_buffer: wgpu::Buffer,
    /// Of cameras that are not shown.
    pub(super) ahead_frame_buffer: wgpu::Buffer,
    pub(super) passes: Passes,
    pub(super) targets: Targets,
    pub(super) materials: Materials,
    pub(super) groups: Groups,
    pub(super) timers: Option<Timers>,
    pub(super) uploads: Uploads,
    /// What decodes pages; made when the first one comes.
    pub(super) decode: Option<Decode>,
    pub(super) waiting: Vec<Waiting>,
    /// Pages whose borders are to be stitched, by BTF.
    pub(super) placed: Vec<(usize, PageId)>,
    /// Where their borders come from.
    pub(super) known_borders: Known,
    /// What there is to shade is known.
    pub(super) classified: bool,
    /// Weights of slots are below one, as they were written last.
    pub(super) fading: bool,
    /// A view has come to rest before.
    pub(super) rested: bool,
    /// The page cache that is shown while another one fills.
    pub(super) kept: Option<Kept>,
    /// What measurements compare with.
    pub(super) resident: Option<Resident>,
    /// What covers the picture.
    pub(super) overlay: Option<OverlayPass>,
}

impl Renderer {
    /// A renderer whose BTF materials are all unknown.
    ///
    /// # Errors
    /// [`crate::Error::Scene`] if the scene does not hold together, [`crate::Error::Budget`] if it is too large for the adapter.
    pub fn new(context: Context, scene: &Scene, size: (u32, u32)) -> Result<Self> {
        let geometry = Geometry::new(&context, scene)?;
        let frame = view::frame(scene);
        let [frame_buffer, ahead_frame_buffer] = ["frame", "frame ahead"].map(|label| {
            context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size_of::<mirror::Frame>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        let passes = Passes::new(&context)?;
        let targets = Targets::new(&context, size)?;
        let scene_materials = scene.materials.clone();
        let materials = Materials::new(&context, &scene_materials)?;
        let frames = [&frame_buffer, &ahead_frame_buffer];
        let groups = Groups::new(&context, &passes, &targets, &geometry, &materials, frames);
        let timers = Timers::new(&context);
        let uploads = Uploads::new(&context);
        context.check()?;
        Ok(Self {
            context,
            scene_materials,
            geometry,
            frame,
            frame_buffer,
            ahead_frame_buffer,
            passes,
            targets,
            materials,
            groups,
            timers,
            uploads,
            decode: None,
            waiting: Vec::new(),
            placed: Vec::new(),
            known_borders: Known::default(),
            classified: false,
            fading: false,
            rested: false,
            kept: None,
            resident: None,
            overlay: None,
        })
    }

    /// Chooses how pages fade in, and which components BTFs that are added from now on may leave out.
    pub fn set_shading(&mut self, shading: Shading) {
        self.materials.shading = shading;
        self.materials.fade.frames = shading.fade_frames;
        self.frame.nearest_mip = (shading.filter == Filter::Bilinear).into();
    }

    /// Chooses whether shading sums half floats, which the adapter must have.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn set_half_arithmetic(&mut self, half: bool) -> Result<()> {
        if half != self.passes.half {
            self.passes.shade = self.shade(self.materials.layout().columns.angular, half)?;
            self.passes.half = half;
            self.bind();
        }
        self.context.check()
    }

    fn shade(&self, angular: Angular, half: bool) -> Result<Shade> {
        let Passes { scene, caches, .. } = &self.passes;
        let way = Way {
            angular,
            textures: Textures::Virtual,
            half,
        };
        Shade::new(&self.context, scene, caches, way)
    }

    /// Appends a BTF to the tables; its index counts up from 0. Nothing of it shows before [`Renderer::show_btfs`].
    ///
    /// # Errors
    /// [`crate::Error::Budget`] if tables would exceed the adapter; then all stays as it is.
    pub fn add_btf(&mut self, btf: &Btf) -> Result<()> {
        self.show_filled();
        self.materials.add(&self.context, btf)
    }

    /// Shows the BTFs that have been added: `btf_of` names for each material of the scene its BTF. Votes on their way
    /// back are lost, what is resident stays.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn show_btfs(&mut self, btf_of: &[Option<usize>]) -> Result<()> {
        self.materials.show(&self.context, &self.scene_materials, btf_of);
        let votes = self.materials.tables.votes;
        self.passes.feedback.resize(&self.context, votes)?;
        self.bind();
        self.context.check()
    }

    /// How caches are laid out within budgets, where the largest column has `column_quads` times four half floats; 0 if
    /// no BTF is known.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] if the caches do not hold one page and one column.
    pub fn layout(&self, caches: Caches, column_quads: u64) -> Result<Layout> {
        Layout::new(&self.context, caches, column_quads)
    }

    /// Replaces the caches. Pages and columns that stay move from slot to slot on the GPU; all others must have been
    /// removed, and all pages or columns where those become something else. Old and new caches are both in memory until the copies
    /// are done; where the format of pages changes until [`Renderer::show_filled`], because the old one is drawn until then.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn resize_caches(
        &mut self,
        layout: Layout,
        pages: &[(Slot, Slot)],
        columns: &[(Slot, Slot)],
    ) -> Result<()> {
        let old = self.materials.layout();
        if layout != old {
            // Slots are about to move.
            self.fill_slots();
            if layout.columns.angular != old.columns.angular {
                self.passes.shade = self.shade(layout.columns.angular, self.passes.half)?;
            }
            if layout.page_format != old.page_format {
                self.passes.stitch = Stitch::new(&self.context, layout.page_format)?;
            }
            let replaced = self.materials.resize(&self.context, layout, pages, columns);
            if layout.columns != old.columns {
                self.kept = None;
            } else if let Some(slots) = replaced
                && layout.page_format != old.page_format
                && self.kept.is_none()
            {
                self.keep(slots);
            }
            self.bind();
        }
        self.context.check()
    }

    /// Changes the size of the picture.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] for no pixels, or more than the adapter has.
    pub fn resize(&mut self, size: (u32, u32)) -> Result<()> {
        self.targets = Targets::new(&self.context, size)?;
        self.bind();
        self.context.check()
    }

    pub(super) fn bind(&mut self) {
        self.groups = Groups::new(
            &self.context,
            &self.passes,
            &self.targets,
            &self.geometry,
            &self.materials,
            [&self.frame_buffer, &self.ahead_frame_buffer],
        );
        self.bind_overlay();
        self.classified = false;
        self.resident = None;
        let Materials { pages, columns, .. } = &self.materials;
        let pages = self.kept.as_ref().map_or(pages, |kept| &kept.slots.pages);
        self.frame.page_scale = pages.scale();
        self.frame.scaled = (pages.format == PageFormat::Byte).into();
        self.frame.slot_columns = pages.grid.columns;
        self.frame.layer_slots = pages.grid.columns * pages.grid.rows;
        self.frame.column_shift = columns.rows.width_shift;
        self.frame.column_mask = (1 << columns.rows.width_shift) - 1;
    }

    /// Slots of the page cache and of the column cache.
    pub fn slots(&self) -> (u32, u32) {
        self.materials.layout().slots()
    }

    /// Slots of the column cache, and bytes of each.
    pub fn column_slots(&self) -> (u32, u64) {
        let rows = self.materials.columns.rows;
        (rows.slots(), rows.slot_bytes())
    }

    /// Pixels.
    pub fn size(&self) -> (u32, u32) {
        self.targets.size
    }

    /// Bytes allocated on the GPU.
    pub fn bytes(&self) -> u64 {
        self.geometry.bytes()
            + self.frame_buffer.size()
            + self.ahead_frame_buffer.size()
            + self.targets.bytes()
            + self.passes.feedback.bytes()
            + self.passes.stitch.bytes()
            + self.kept.as_ref().map_or(0, Kept::bytes)
            + self.uploads.bytes()
            + self.decode.as_ref().map_or(0, Decode::bytes)
            + self.materials.bytes()
            + self.resident.as_ref().map_or(0, Resident::bytes)
            + self.overlay.as_ref().map_or(0, OverlayPass::bytes)
    }

    /// Shades and maps tones; `exposure` is a factor.
    pub fn draw(&mut self, exposure: f32) {
        self.frame.exposure = exposure;
        self.write_frame();
        self.encode_picture(None);
    }

    /// Maps the tones of the last picture again, under another overlay or exposure.
    pub fn draw_screen(&mut self, exposure: f32) {
        self.frame.exposure = exposure;
        self.write_frame();
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        self.encode_screen(&mut encoder);
        self.submit_timed(encoder);
    }

    /// The commands of [`Renderer::draw`], with the frame that the buffer holds; `resident` draws what it holds instead of
    /// what the caches do.
    pub(super) fn encode_picture(&mut self, resident: Option<&Resident>) {
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        let (size, groups) = (self.targets.size, &self.groups);
        let caches = self.kept.as_ref().map_or(&groups.caches, |kept| &kept.caches);
        if !self.classified {
            self.targets.clear_work(&self.context.queue);
            let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Classify));
            let bound = [&groups.scene, &groups.classify];
            self.passes.classify.encode(&mut encoder, size, bound, timestamps);
            self.classified = true;
        }
        let (shade, bound) = match resident {
            Some(resident) => resident.shade(),
            None => (&self.passes.shade, [&groups.scene, caches, &groups.shade]),
        };
        let variant = (self.variant(shade), self.materials.kinds);
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Shade));
        shade.encode(&mut encoder, &self.targets, bound, variant, timestamps);
        self.encode_screen(&mut encoder);
        self.submit_timed(encoder);
    }

    /// New pages come in by weight, so a first picture needs what draws them. That draws frames before and after, too, until a
    /// view has come to rest and there is time to compile what draws nothing else, and faster.
    fn variant(&self, shade: &Shade) -> Variant {
        let early = self.materials.fade.frames > 1 && !self.rested && !shade.has(Variant::Plain);
        match self.kept {
            None if self.fading || early => Variant::Fading,
            _ => Variant::Plain,
        }
    }

    /// A view has come to rest: compiles what draws frames in which nothing fades, unless that is there.
    pub fn rest(&mut self) {
        if !std::mem::replace(&mut self.rested, true) {
            self.passes.shade.compile(Variant::Plain, self.materials.kinds);
        }
    }

    /// From radiance to what a screen shows.
    fn encode_screen(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let (size, groups) = (self.targets.size, &self.groups);
        let caches = self.kept.as_ref().map_or(&groups.caches, |kept| &kept.caches);
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Tonemap));
        match &self.overlay {
            Some(pass) => pass.encode(encoder, size, [&groups.scene, caches], timestamps),
            None => {
                let bound = [&groups.scene, caches, &groups.tonemap];
                self.passes.tonemap.encode(encoder, size, bound, timestamps);
            }
        }
    }

    fn submit_timed(&mut self, mut encoder: wgpu::CommandEncoder) {
        let map = self
            .timers
            .as_mut()
            .is_some_and(|timers| timers.resolve(&mut encoder));
        self.context.queue.submit([encoder.finish()]);
        if let Some(timers) = self.timers.as_mut().filter(|_| map) {
            timers.map();
        }
    }

    /// Draws as [`Renderer::draw`] does, and counts what that takes. Waits.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn draw_counting(&mut self, exposure: f32) -> Result<ShadingWork> {
        // A new classification starts the counts anew.
        self.classified = false;
        self.frame.count_work = 1;
        self.draw(exposure);
        self.frame.count_work = 0;
        let bytes = readback::head(&self.context, &self.targets.work, WORK_HEADER_BYTES)?;
        let [btf, diffuse, mixed, _, fetched, left_out, absent, _]: [u32; 8] =
            bytemuck::pod_read_unaligned(&bytes);
        Ok(ShadingWork {
            items: [btf, diffuse, mixed],
            groups_fetched: fetched,
            groups_left_out: left_out,
            groups_absent: absent,
        })
    }

    pub(super) fn write_frame(&self) {
        self.context
            .queue
            .write_buffer(&self.frame_buffer, 0, bytemuck::bytes_of(&self.frame));
    }

    /// Waits for all submitted work; at once in browsers.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device has failed.
    pub fn wait(&self) -> Result<()> {
        self.context.wait()
    }
}
