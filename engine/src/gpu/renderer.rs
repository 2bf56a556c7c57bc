//! The GPU side of one scene: in which order buffers, caches and passes are used.

use std::sync::Arc;

use half::f16;
use scenes::Scene;
use shaders::mirror;
use tileset::{BORDER_TEXELS, Page, PageId, Pyramid, SLOT_TEXELS, Tile, codec::pyramid_dct::Coefficients};

use super::{
    borders::Known,
    context::Context,
    decode::{self, Decode, Waiting},
    geometry::Geometry,
    kept::Kept,
    materials::Btf,
    page_format::PageFormat,
    readback,
    resident::Resident,
    resources::{Caches, Groups, Layout, Materials, Passes, Shading},
    shade::{Shade, ShadingWork, Textures},
    slot_scales::Rounded,
    stitch::{self, Stitch},
    targets::{Targets, WORK_HEADER_BYTES},
    timers::{Pass, Timers},
    uploads::Uploads,
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
    uploads: Uploads,
    /// What decodes pages; made when the first one comes.
    pub(super) decode: Option<Decode>,
    pub(super) waiting: Vec<Waiting>,
    /// Pages whose borders are to be stitched, by BTF.
    pub(super) placed: Vec<(usize, PageId)>,
    known_borders: Known,
    /// What there is to shade is known.
    pub(super) classified: bool,
    /// Weights of slots are below one, as they were written last.
    fading: bool,
    /// The page cache that is shown while another one fills.
    pub(super) kept: Option<Kept>,
    /// What measurements compare with.
    pub(super) resident: Option<Resident>,
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
            kept: None,
            resident: None,
        })
    }

    /// Chooses how pages fade in, and which components BTFs that are added from now on may leave out.
    pub fn set_shading(&mut self, shading: Shading) {
        self.materials.shading = shading;
        self.materials.fade.frames = shading.fade_frames;
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
                let Passes { scene, caches, .. } = &self.passes;
                self.passes.shade = Shade::new(
                    &self.context,
                    scene,
                    caches,
                    layout.columns.angular,
                    Textures::Virtual,
                )?;
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
    }

    /// Gives a page its slot and enters it into the page table. What its border holds counts only where a
    /// neighbour is missing, and at the outer sides of a clamped mip.
    pub fn place_page(&mut self, btf: usize, page: PageId, slot: Slot, texels: &Page) {
        let Materials {
            pages, page_table, ..
        } = &mut self.materials;
        let pyramid = page_table.pyramid(btf);
        if pages.format == PageFormat::Byte {
            let rounded = Rounded::new(Arc::new(texels.clone()), pyramid.payload(page.tile));
            return self.place_rounded(btf, page, slot, rounded);
        }
        let used = used_texels(&pyramid, page.tile);
        let texels = bytemuck::cast_slice(&texels.texels);
        pages.write(&self.context, &mut self.uploads, slot, used, texels);
        self.enter(btf, page, slot);
    }

    /// The same for a page that has been rounded already.
    pub fn place_rounded(&mut self, btf: usize, page: PageId, slot: Slot, rounded: Rounded) {
        let Materials {
            pages,
            page_table,
            slot_scales,
            ..
        } = &mut self.materials;
        if pages.format == PageFormat::Half {
            return self.place_page(btf, page, slot, rounded.page());
        }
        // A page may be its own neighbour.
        page_table.insert(btf, page, pages.grid.address(slot));
        let strips = stitch::strips_into(page_table, &mut self.known_borders, btf, page);
        let bytes = slot_scales.place(pages.grid, slot, rounded, &strips);
        let used = used_texels(&page_table.pyramid(btf), page.tile);
        let texels = bytemuck::cast_slice(&bytes);
        pages.write(&self.context, &mut self.uploads, slot, used, texels);
        self.enter(btf, page, slot);
    }

    fn enter(&mut self, btf: usize, page: PageId, slot: Slot) {
        let Materials {
            pages,
            page_table,
            fade,
            ..
        } = &mut self.materials;
        page_table.insert(btf, page, pages.grid.address(slot));
        fade.start(slot);
        self.placed.push((btf, page));
    }

    /// The same for a page that the GPU decodes, at the next [`Renderer::flush`]. Its parent must be resident; without it
    /// debug builds panic, and others leave the page out, so that coarser ones show in its place.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if there are no passes to decode with, [`crate::Error::Budget`] if the adapter has no room for their
    /// buffers.
    ///
    /// [`crate::Error::Adapter`]: crate::Error::Adapter
    /// [`crate::Error::Budget`]: crate::Error::Budget
    pub fn place_coefficients(
        &mut self,
        btf: usize,
        page: PageId,
        slot: Slot,
        coefficients: Coefficients,
    ) -> Result<()> {
        if self.decode.is_none() {
            self.decode = Some(Decode::new(&self.context)?);
        }
        let Materials {
            pages, page_table, ..
        } = &self.materials;
        let parent = decode::parent(page_table, btf, page);
        debug_assert!(
            parent.is_some(),
            "BTF {btf}: {page} is placed, but its parent is not resident"
        );
        if parent.is_some() {
            let address = pages.grid.address(slot);
            self.enter(btf, page, slot);
            self.waiting.push(Waiting {
                btf,
                page,
                address,
                coefficients,
            });
        }
        Ok(())
    }

    /// Brings the texels of what was placed to where they belong.
    fn fill_slots(&mut self) {
        self.uploads.submit(&self.context);
        let waiting = std::mem::take(&mut self.waiting);
        let Materials {
            pages, page_table, ..
        } = &self.materials;
        if let Some(decode) = &self.decode {
            decode.run(&self.context, pages, page_table, waiting, self.timers.as_mut());
        }
    }

    /// Takes a page out of the page table.
    pub fn remove_page(&mut self, btf: usize, page: PageId) {
        self.materials.page_table.remove(btf, page);
    }

    /// Writes a column, in the [form](Btf::cached_column) that the cache has, into a slot and enters it into the page
    /// table. Before it the group's root was worth nothing: it comes in now.
    pub fn place_column(&mut self, btf: usize, group: u16, slot: Slot, quads: Vec<[f16; 4]>) {
        self.show_filled();
        let Materials {
            pages,
            columns,
            page_table,
            fade,
            ..
        } = &mut self.materials;
        columns.write(&self.context, &mut self.uploads, slot, quads);
        page_table.set_column(btf, group, Some(columns.rows.address(slot)));
        let tile = page_table.pyramid(btf).root();
        if let Some(address) = page_table.page(btf, PageId { group, tile }) {
            fade.start(pages.grid.slot(address));
        }
    }

    /// Takes a column out of the page table.
    pub fn remove_column(&mut self, btf: usize, group: u16) {
        self.show_filled();
        self.materials.page_table.set_column(btf, group, None);
    }

    /// Whether pages are on their way in: the next [`Renderer::flush`] changes the picture.
    pub fn fading(&self) -> bool {
        self.materials.fade.active()
    }

    /// Once a frame: lets new pages fade in and writes what has changed in the page table. Returns the strips that are to be
    /// stitched.
    pub fn flush(&mut self) -> Vec<mirror::Strip> {
        let Materials {
            page_table,
            page_table_buffer,
            fade,
            slot_weights,
            slot_scales,
            raised,
            pages,
            ..
        } = &mut self.materials;
        if fade.step() {
            slot_weights.write(&self.context, &mut self.uploads, fade);
        }
        self.fading = fade.active();
        page_table.flush(|first, entries| {
            self.uploads.write_buffer(
                &self.context,
                &page_table_buffer.buffer,
                first as u64 * 4,
                bytemuck::cast_slice(entries),
            );
        });
        let mut strips = stitch::strips(
            page_table,
            &mut self.known_borders,
            std::mem::take(&mut self.placed),
        );
        if pages.format == PageFormat::Byte {
            raised.extend(slot_scales.fit(pages.grid, &mut strips));
            slot_scales.flush(&self.context, &mut self.uploads);
        }
        strips
    }

    /// Copies or decodes what was placed to its slots, and stitches the borders between the pages placed before the last
    /// [`Renderer::flush`] and all that are resident. Returns how many texels stitching took: at most [`MOST_INTO`] + [`MOST_OUT`] a page placed.
    ///
    /// [`MOST_INTO`]: super::borders::MOST_INTO
    /// [`MOST_OUT`]: super::borders::MOST_OUT
    pub fn stitch(&mut self, strips: &[mirror::Strip]) -> u64 {
        self.fill_slots();
        let raised = std::mem::take(&mut self.materials.raised);
        let (stitch, groups) = (&self.passes.stitch, &self.groups.stitch);
        stitch.run(&self.context, groups, &raised, None);
        stitch.run(&self.context, groups, strips, self.timers.as_mut())
    }

    /// Shades and maps tones; `exposure` is a factor.
    pub fn draw(&mut self, exposure: f32) {
        self.frame.exposure = exposure;
        self.write_frame();
        self.encode_picture(None);
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
        let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Shade));
        let (shade, bound) = match resident {
            Some(resident) => resident.shade(),
            None => (&self.passes.shade, [&groups.scene, caches, &groups.shade]),
        };
        let fading = self.fading && self.kept.is_none();
        shade.encode(&mut encoder, &self.targets, bound, fading, timestamps);
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

/// Columns and rows of a slot that a page makes use of; the packed tail may lie anywhere.
fn used_texels(pyramid: &Pyramid, tile: Tile) -> (u32, u32) {
    if tile == pyramid.root() {
        return (SLOT_TEXELS, SLOT_TEXELS);
    }
    let (width, height) = pyramid.payload(tile);
    (width + 2 * BORDER_TEXELS, height + 2 * BORDER_TEXELS)
}
