//! The GPU side of one scene: in which order buffers, caches and passes are used.

use half::f16;
use scenes::{Camera, Scene};
use shaders::mirror;
use tileset::{Page, PageId};

use super::{
    context::Context,
    feedback::Counted,
    geometry::Geometry,
    materials::Btf,
    readback,
    resources::{Caches, Groups, Layout, Materials, Passes},
    stitch,
    targets::Targets,
    timers::{GpuMilliseconds, Pass, Timers},
    view,
};
use crate::{Error, Result, metrics::Picture, residency::Slot};

/// What the feedback of a frame is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ask {
    /// Side of a feedback cell in pixels.
    pub stride: u32,
    /// Which pixel of each cell votes.
    pub phase: u32,
    /// Comes back with the votes.
    pub tag: u64,
}

/// The GPU side of one scene.
pub struct Renderer {
    context: Context,
    scene_materials: Vec<scenes::Material>,
    geometry: Geometry,
    frame: mirror::Frame,
    frame_buffer: wgpu::Buffer,
    passes: Passes,
    targets: Targets,
    materials: Materials,
    groups: Groups,
    timers: Option<Timers>,
    /// Pages whose borders are to be stitched, by BTF.
    placed: Vec<(usize, PageId)>,
}

impl Renderer {
    /// A renderer whose BTF materials are all unknown.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene does not hold together, [`Error::Budget`] if it is too large for the adapter.
    pub fn new(context: Context, scene: &Scene, size: (u32, u32)) -> Result<Self> {
        let geometry = Geometry::new(&context, scene)?;
        let frame = view::frame(scene);
        let frame_buffer = context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame"),
            size: size_of::<mirror::Frame>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let passes = Passes::new(&context)?;
        let targets = Targets::new(&context, size)?;
        let scene_materials = scene.materials.clone();
        let materials = Materials::new(&context, &scene_materials)?;
        let groups = Groups::new(&context, &passes, &targets, &geometry, &materials, &frame_buffer);
        let timers = Timers::new(&context);
        context.check()?;
        Ok(Self {
            context,
            scene_materials,
            geometry,
            frame,
            frame_buffer,
            passes,
            targets,
            materials,
            groups,
            timers,
            placed: Vec::new(),
        })
    }

    /// Appends a BTF to the tables; its index counts up from 0. Nothing of it shows before [`Renderer::show_btfs`].
    ///
    /// # Errors
    /// [`Error::Budget`] if tables would exceed the adapter; then all stays as it is.
    pub fn add_btf(&mut self, btf: &Btf) -> Result<()> {
        self.materials.add(&self.context, btf)
    }

    /// Shows the BTFs that have been added: `btf_of` names for each material of the scene its BTF. Votes on their way
    /// back are lost, what is resident stays.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device fails.
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
    /// [`Error::Budget`] if the caches do not hold one page and one column.
    pub fn layout(&self, caches: Caches, column_quads: u64) -> Result<Layout> {
        Layout::new(&self.context, caches, column_quads)
    }

    /// Replaces the caches. Pages and columns that stay move from slot to slot on the GPU; all others must have been
    /// removed. Old and new caches are both in memory until the copies are done.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device fails.
    pub fn resize_caches(
        &mut self,
        layout: Layout,
        pages: &[(Slot, Slot)],
        columns: &[(Slot, Slot)],
    ) -> Result<()> {
        if layout != self.materials.layout() {
            self.materials.resize(&self.context, layout, pages, columns);
            self.bind();
        }
        self.context.check()
    }

    /// Changes the size of the picture.
    ///
    /// # Errors
    /// [`Error::Budget`] for no pixels, or more than the adapter has.
    pub fn resize(&mut self, size: (u32, u32)) -> Result<()> {
        self.targets = Targets::new(&self.context, size)?;
        self.bind();
        self.context.check()
    }

    fn bind(&mut self) {
        self.groups = Groups::new(
            &self.context,
            &self.passes,
            &self.targets,
            &self.geometry,
            &self.materials,
            &self.frame_buffer,
        );
        let Materials { pages, columns, .. } = &self.materials;
        self.frame.page_scale = pages.scale();
        self.frame.column_shift = columns.rows.width_shift;
        self.frame.column_mask = (1 << columns.rows.width_shift) - 1;
    }

    /// Slots of the page cache and of the column cache.
    pub fn slots(&self) -> (u32, u32) {
        self.materials.layout().slots()
    }

    /// Pixels.
    pub fn size(&self) -> (u32, u32) {
        self.targets.size
    }

    /// Bytes allocated on the GPU.
    pub fn bytes(&self) -> u64 {
        self.geometry.bytes()
            + self.frame_buffer.size()
            + self.targets.bytes()
            + self.passes.feedback.bytes()
            + self.passes.stitch.bytes()
            + self.materials.bytes()
    }

    /// Writes a page into a slot and enters it into the page table. What its border holds counts only where a
    /// neighbour is missing, and at the outer sides of a clamped mip.
    pub fn place_page(&mut self, btf: usize, page: PageId, slot: Slot, texels: &Page) {
        let Materials {
            pages, page_table, ..
        } = &mut self.materials;
        pages.write(&self.context, slot, texels);
        page_table.insert(btf, page, pages.grid.address(slot));
        self.placed.push((btf, page));
    }

    /// Takes a page out of the page table.
    pub fn remove_page(&mut self, btf: usize, page: PageId) {
        self.materials.page_table.remove(btf, page);
    }

    /// Writes a column, with its ambient entries ([`with_ambient`]), into a slot and enters it into the page table.
    ///
    /// [`with_ambient`]: super::column_cache::with_ambient
    pub fn place_column(&mut self, btf: usize, group: u16, slot: Slot, quads: Vec<[f16; 4]>) {
        let Materials {
            columns, page_table, ..
        } = &mut self.materials;
        columns.write(&self.context, slot, quads);
        page_table.set_column(btf, group, Some(columns.rows.address(slot)));
    }

    /// Takes a column out of the page table.
    pub fn remove_column(&mut self, btf: usize, group: u16) {
        self.materials.page_table.set_column(btf, group, None);
    }

    /// Writes what has changed in the page table, and stitches the borders between the pages placed since the last
    /// time and all that are resident. Returns how many texels that took: at most [`MOST_INTO`] + [`MOST_OUT`] a page
    /// placed.
    ///
    /// [`MOST_INTO`]: super::borders::MOST_INTO
    /// [`MOST_OUT`]: super::borders::MOST_OUT
    pub fn flush(&mut self) -> u64 {
        let Materials {
            page_table,
            page_table_buffer,
            ..
        } = &mut self.materials;
        let queue = &self.context.queue;
        page_table.flush(|first, entries| {
            queue.write_buffer(
                &page_table_buffer.buffer,
                first as u64 * 4,
                bytemuck::cast_slice(entries),
            );
        });
        let strips = stitch::strips(page_table, std::mem::take(&mut self.placed));
        let timers = self.timers.as_mut();
        self.passes
            .stitch
            .run(&self.context, &self.groups.stitch, &strips, timers)
    }

    /// A resident page as it lies in the cache, `[y][x]` with its border. Waits.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn page(&self, btf: usize, page: PageId) -> Result<Option<Page>> {
        let Materials {
            pages, page_table, ..
        } = &self.materials;
        let address = page_table.page(btf, page);
        address
            .map(|address| {
                Ok(Page {
                    texels: pages.read(&self.context, address)?,
                })
            })
            .transpose()
    }

    /// Draws ids for a camera, if there is one, and asks for votes, if so told. Returns whether votes will come:
    /// not while too many are on their way already.
    pub fn look(&mut self, camera: Option<&Camera>, ask: Option<Ask>) -> bool {
        let staging = ask.and_then(|ask| Some((ask, self.passes.feedback.free()?)));
        if camera.is_none() && staging.is_none() {
            return false;
        }
        if let Some(camera) = camera {
            view::set_camera(&mut self.frame, camera, self.targets.size);
        }
        if let Some((ask, _)) = staging {
            (self.frame.feedback_stride, self.frame.feedback_phase) = (ask.stride, ask.phase);
        }
        self.write_frame();
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        if camera.is_some() {
            let timestamps = self.timers.as_mut().map(|timers| timers.render(Pass::Visibility));
            let (visibility, scene) = (&self.passes.visibility, &self.groups.scene);
            visibility.encode(
                &mut encoder,
                &self.targets,
                scene,
                &self.geometry.draws,
                timestamps,
            );
        }
        if let Some((ask, staging)) = staging {
            let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Feedback));
            let (width, height) = self.targets.size;
            let cells = (width.div_ceil(ask.stride), height.div_ceil(ask.stride));
            let groups = [&self.groups.scene, &self.groups.caches, &self.groups.feedback];
            self.passes
                .feedback
                .encode(&mut encoder, cells, groups, staging, timestamps);
        }
        self.context.queue.submit([encoder.finish()]);
        if let Some((ask, staging)) = staging {
            self.passes.feedback.map(staging, ask.tag);
        }
        staging.is_some()
    }

    /// Shades and maps tones; `exposure` is a factor.
    pub fn draw(&mut self, exposure: f32) {
        self.frame.exposure = exposure;
        self.write_frame();
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        let (size, groups) = (self.targets.size, &self.groups);
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Shade));
        self.passes.shade.encode(
            &mut encoder,
            size,
            [&groups.scene, &groups.caches, &groups.shade],
            timestamps,
        );
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Tonemap));
        self.passes.tonemap.encode(
            &mut encoder,
            size,
            [&groups.scene, &groups.caches, &groups.tonemap],
            timestamps,
        );
        let map = self
            .timers
            .as_mut()
            .is_some_and(|timers| timers.resolve(&mut encoder));
        self.context.queue.submit([encoder.finish()]);
        if let Some(timers) = self.timers.as_mut().filter(|_| map) {
            timers.map();
        }
    }

    fn write_frame(&self) {
        self.context
            .queue
            .write_buffer(&self.frame_buffer, 0, bytemuck::bytes_of(&self.frame));
    }

    /// Votes and times that have arrived, without waiting.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn poll(&mut self) -> Result<(Vec<Counted>, Option<GpuMilliseconds>)> {
        self.context
            .device
            .poll(wgpu::PollType::Poll)
            .map_err(|error| Error::Adapter(error.to_string()))?;
        self.context.check()?;
        Ok((
            self.passes.feedback.poll(),
            self.timers.as_mut().and_then(Timers::poll),
        ))
    }

    /// Whether votes are on their way back.
    pub fn votes_pending(&self) -> bool {
        self.passes.feedback.pending()
    }

    /// Waits for all submitted work; at once in browsers.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn wait(&self) -> Result<()> {
        self.context.wait()
    }

    /// The last picture, linear. Waits.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn picture(&self) -> Result<Picture> {
        let bytes = readback::texels(&self.context, &self.targets.picture)?;
        let (width, height) = self.targets.size;
        let pixels = bytes.chunks_exact(16).map(|pixel| {
            let [r, g, b, _]: [f32; 4] = bytemuck::pod_read_unaligned(pixel);
            [r, g, b]
        });
        Ok(Picture {
            width,
            height,
            pixels: pixels.collect(),
        })
    }

    /// The last picture in 8-bit sRGB with alpha. Waits.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn tonemapped(&self) -> Result<Vec<u8>> {
        readback::texels(&self.context, &self.targets.screen)
    }

    /// For each pixel its instance, counted from 1, and triangle; 0 where nothing is. Waits.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn visibility(&self) -> Result<Vec<[u32; 2]>> {
        let bytes = readback::texels(&self.context, &self.targets.visibility)?;
        Ok(bytes.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect())
    }

    /// Name of the adapter and its driver.
    pub fn adapter(&self) -> String {
        self.context.adapter()
    }
}
