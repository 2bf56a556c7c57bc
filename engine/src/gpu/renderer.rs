//! The GPU side of one scene: in which order buffers, caches and passes are used.

use scenes::Scene;
use shaders::mirror;
use tileset::{Column, Page, PageId};

use super::{
    column_cache::with_ambient,
    context::Context,
    geometry::Geometry,
    materials::Btf,
    page_cache::{self, SLOT_BYTES},
    readback,
    resources::{Caches, Groups, Materials, Passes, Shading},
    shade::ShadingWork,
    stitch,
    targets::{Targets, WORK_HEADER_BYTES},
    timers::{Pass, Timers},
    view,
};
use crate::{Result, residency::Slot};

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
    /// Pages whose borders are to be stitched, by BTF.
    pub(super) placed: Vec<(usize, PageId)>,
    /// What there is to shade is known.
    pub(super) classified: bool,
}

impl Renderer {
    /// A renderer whose BTF materials are all unknown.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene does not hold together, [`Error::Budget`] if it is too large for the adapter.
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
        let nothing = Caches {
            page_bytes: SLOT_BYTES,
            column_bytes: 1 << 16,
        };
        let materials = Materials::new(
            &context,
            &scene_materials,
            &[],
            &vec![None; scene_materials.len()],
            nothing,
            Shading::default(),
        )?;
        let frames = [&frame_buffer, &ahead_frame_buffer];
        let groups = Groups::new(&context, &passes, &targets, &geometry, &materials, frames);
        let timers = Timers::new(&context);
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
            placed: Vec::new(),
            classified: false,
        })
    }

    /// Makes tables and caches for these BTFs; `btf_of` names for each material of the scene its BTF. Whatever was
    /// resident is gone.
    ///
    /// # Errors
    /// [`Error::Budget`] if the caches do not hold one page and one column, or tables exceed the adapter.
    pub fn set_materials(
        &mut self,
        btfs: &[Btf],
        btf_of: &[Option<usize>],
        caches: Caches,
        shading: Shading,
    ) -> Result<()> {
        self.materials = Materials::new(
            &self.context,
            &self.scene_materials,
            btfs,
            btf_of,
            caches,
            shading,
        )?;
        self.placed.clear();
        let votes = btfs.iter().map(|btf| btf.pyramid().tile_count()).sum();
        self.passes.feedback.resize(&self.context, votes)?;
        self.bind();
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
            [&self.frame_buffer, &self.ahead_frame_buffer],
        );
        self.classified = false;
        let Materials {
            pages,
            columns,
            page_table,
            ..
        } = &self.materials;
        self.frame.page_scale = pages.scale();
        self.frame.slot_weights = page_table.slot_weights();
        self.frame.slot_columns = pages.grid.columns;
        self.frame.layer_slots = pages.grid.columns * pages.grid.rows;
        self.frame.column_shift = columns.rows.width_shift;
        self.frame.column_mask = (1 << columns.rows.width_shift) - 1;
    }

    /// Slots of the page cache and of the column cache.
    pub fn slots(&self) -> (u32, u32) {
        (
            self.materials.pages.grid.slots(),
            self.materials.columns.rows.slots(),
        )
    }

    /// Pixels.
    pub fn size(&self) -> (u32, u32) {
        self.targets.size
    }

    /// For each BTF the index of its first counter among the votes.
    pub fn vote_bases(&self) -> impl Iterator<Item = u32> + '_ {
        self.materials.bases.iter().map(|bases| bases.votes)
    }

    /// Bytes allocated on the GPU.
    pub fn bytes(&self) -> u64 {
        self.geometry.bytes()
            + self.frame_buffer.size()
            + self.ahead_frame_buffer.size()
            + self.targets.bytes()
            + self.passes.feedback.bytes()
            + self.passes.stitch.bytes()
            + self.materials.bytes()
    }

    /// Writes a page into a slot and enters it into the page table. What its border holds counts only where a
    /// neighbour is missing, and at the outer sides of a clamped mip.
    pub fn place_page(&mut self, btf: usize, page: PageId, slot: Slot, texels: &Page) {
        let Materials {
            pages,
            page_table,
            fade,
            ..
        } = &mut self.materials;
        pages.write(&self.context, slot, texels);
        page_table.insert(btf, page, pages.grid.address(slot));
        fade.start(slot);
        self.placed.push((btf, page));
    }

    /// Takes a page out of the page table.
    pub fn remove_page(&mut self, btf: usize, page: PageId) {
        self.materials.page_table.remove(btf, page);
    }

    /// Writes a column with its ambient entries into a slot and enters it into the page table. Before it the group's
    /// root was worth nothing: it comes in now.
    pub fn place_column(&mut self, btf: usize, group: u16, slot: Slot, column: &Column) {
        let Materials {
            pages,
            columns,
            ambient_weights,
            page_table,
            fade,
            ..
        } = &mut self.materials;
        columns.write(&self.context, slot, with_ambient(column, &ambient_weights[btf]));
        page_table.set_column(btf, group, Some(columns.rows.address(slot)));
        let tile = page_table.pyramid(btf).root();
        if let Some(address) = page_table.page(btf, PageId { group, tile }) {
            fade.start(page_cache::slot(pages.grid, address));
        }
    }

    /// Takes a column out of the page table.
    pub fn remove_column(&mut self, btf: usize, group: u16) {
        self.materials.page_table.set_column(btf, group, None);
    }

    /// Whether pages are on their way in: the next [`Renderer::flush`] changes the picture.
    pub fn fading(&self) -> bool {
        self.materials.fade.active()
    }

    /// Once a frame: lets new pages fade in, writes what has changed in the page table, and stitches the borders between the pages placed since the last
    /// time and all that are resident. Returns how many texels that took: at most [`MOST_INTO`] + [`MOST_OUT`] a page
    /// placed.
    ///
    /// [`MOST_INTO`]: super::borders::MOST_INTO
    /// [`MOST_OUT`]: super::borders::MOST_OUT
    pub fn flush(&mut self) -> u64 {
        let Materials {
            page_table,
            page_table_buffer,
            fade,
            ..
        } = &mut self.materials;
        fade.step(page_table);
        self.frame.fading = fade.active().into();
        let queue = &self.context.queue;
        page_table.flush(|first, entries| {
            queue.write_buffer(page_table_buffer, first as u64 * 4, bytemuck::cast_slice(entries));
        });
        let strips = stitch::strips(page_table, std::mem::take(&mut self.placed));
        let timers = self.timers.as_mut();
        self.passes
            .stitch
            .run(&self.context, &self.groups.stitch, &strips, timers)
    }

    /// Shades and maps tones; `exposure` is a factor.
    pub fn draw(&mut self, exposure: f32) {
        self.frame.exposure = exposure;
        self.write_frame();
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        let (size, groups) = (self.targets.size, &self.groups);
        if !self.classified {
            self.targets.clear_work(&self.context.queue);
            let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Classify));
            let bound = [&groups.scene, &groups.classify];
            self.passes.classify.encode(&mut encoder, size, bound, timestamps);
            self.classified = true;
        }
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Shade));
        let bound = [&groups.scene, &groups.caches, &groups.shade];
        self.passes
            .shade
            .encode(&mut encoder, &self.targets, bound, timestamps);
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Tonemap));
        let bound = [&groups.scene, &groups.caches, &groups.tonemap];
        self.passes.tonemap.encode(&mut encoder, size, bound, timestamps);
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
    /// [`Error::Adapter`] if the device has failed.
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
    /// [`Error::Adapter`] if the device has failed.
    pub fn wait(&self) -> Result<()> {
        self.context.wait()
    }
}
