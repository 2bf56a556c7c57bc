//! What measurements compare with: the same pages and columns, shaded without a page table.
//!
//! A copy of all that is resident lies in caches that have a slot for each page and column of each BTF, in an order that the
//! shader computes (`resident.wgsl`): what a renderer without virtual textures would read. Slots of what is not resident stay
//! empty, so the pictures are the same where all that a view wants is there.

use shaders::mirror;
use tileset::PageId;

use super::{
    bind,
    column_cache::{ColumnCache, Rows},
    context::Context,
    page_cache::{Grid, PageCache},
    page_format::PageFormat,
    page_table::Region,
    renderer::Renderer,
    resources::{Groups, Materials, UNKNOWN},
    shade::{Shade, Textures, Way},
};
use crate::{Error, Result, residency::Slot};

/// Slots along each side of a layer; see `resident.wgsl`.
const SIDE_SLOTS: u32 = 16;
/// Most bytes of pages: scenes beyond are not worth the memory that they would be measured in.
const MOST_BYTES: u64 = 1 << 30;

/// The caches, and what reads them.
pub(super) struct Resident {
    pages: PageCache,
    columns: ColumnCache,
    table: wgpu::Buffer,
    shade: Shade,
    /// Scene, caches, and what shading reads and writes.
    groups: [wgpu::BindGroup; 3],
}

impl Resident {
    pub(super) fn shade(&self) -> (&Shade, [&wgpu::BindGroup; 3]) {
        (&self.shade, self.groups.each_ref())
    }

    pub(super) fn bytes(&self) -> u64 {
        self.pages.bytes() + self.columns.bytes() + self.table.size()
    }
}

/// Where pages and columns of a BTF begin.
#[derive(Clone, Copy)]
struct First {
    page: u32,
    column: u32,
}

/// Of all BTFs, and after the last the number of slots.
fn layout(regions: &[Region]) -> Vec<First> {
    let mut firsts = vec![First { page: 0, column: 0 }];
    let mut next = firsts[0];
    for region in regions {
        let pages = u32::from(region.groups).saturating_mul(region.pyramid.tile_count());
        next.page = next.page.saturating_add(pages);
        next.column += u32::from(region.groups);
        firsts.push(next);
    }
    firsts
}

/// Layouts of the caches, where they have room.
fn grids(context: &Context, end: First, rows: Rows) -> Result<(Grid, Rows)> {
    let limits = context.device.limits();
    let grid = Grid {
        columns: SIDE_SLOTS,
        rows: SIDE_SLOTS,
        layers: end.page.div_ceil(SIDE_SLOTS * SIDE_SLOTS).max(1),
    };
    let rows = Rows {
        layer_slots: 1,
        layers: end.column.max(1),
        ..rows
    };
    let bytes = u64::from(grid.layers * SIDE_SLOTS * SIDE_SLOTS) * PageFormat::Half.slot_bytes();
    let layers = grid.layers.max(rows.layers);
    if bytes > MOST_BYTES || layers > limits.max_texture_array_layers {
        return Err(Error::Budget(format!(
            "all pages of the scene take {bytes} bytes and {layers} layers; to compare with all of them resident, at most \
             {MOST_BYTES} bytes and {} layers will do: measure fewer or smaller materials",
            limits.max_texture_array_layers
        )));
    }
    Ok((grid, rows))
}

impl Renderer {
    /// Copies what is resident, by BTF, to where [`Renderer::draw_resident`] finds it; `btf_of` is that of
    /// [`Renderer::show_btfs`]. Caches and tables that are made anew forget it.
    ///
    /// # Errors
    /// [`Error::Budget`] if all pages of all BTFs take more than a gibibyte, or more layers than the adapter has;
    /// [`Error::Adapter`] if the device fails.
    pub fn lay_out_resident(
        &mut self,
        pages: impl Iterator<Item = (usize, PageId, Slot)>,
        columns: impl Iterator<Item = (usize, u16, Slot)>,
        btf_of: &[Option<usize>],
    ) -> Result<()> {
        self.resident = None;
        self.show_filled();
        if self.materials.pages.format != PageFormat::Half {
            return Err(Error::Budget(
                "frames with all pages resident are measured with pages of half floats: choose that format"
                    .into(),
            ));
        }
        let Materials { page_table, .. } = &self.materials;
        let regions = page_table.regions();
        let firsts = layout(regions);
        let (grid, rows) = grids(&self.context, firsts[regions.len()], self.materials.columns.rows)?;
        let pages = pages.filter_map(|(btf, page, slot)| {
            let tile = regions[btf].pyramid.tile_index(page.tile)?;
            let place = tile * u32::from(regions[btf].groups) + u32::from(page.group);
            Some((slot, Slot(firsts[btf].page + place)))
        });
        let pages: Vec<_> = pages.collect();
        let columns: Vec<_> = columns
            .map(|(btf, group, slot)| (slot, Slot(firsts[btf].column + u32::from(group))))
            .collect();
        let mut table = self
            .materials
            .tables
            .materials(&self.scene_materials, btf_of, UNKNOWN);
        for (material, btf) in table.iter_mut().zip(btf_of) {
            if let Some(btf) = *btf {
                (material.page_table, material.votes) = (firsts[btf].page, firsts[btf].column);
            }
        }
        let resident = self.copy_resident((grid, &pages), (rows, &columns), &table)?;
        self.resident = Some(resident);
        self.context.check()
    }

    fn copy_resident(
        &self,
        (grid, page_moves): (Grid, &[(Slot, Slot)]),
        (rows, column_moves): (Rows, &[(Slot, Slot)]),
        table: &[mirror::Material],
    ) -> Result<Resident> {
        let context = &self.context;
        let pages = PageCache::new(context, grid, PageFormat::Half);
        let columns = ColumnCache::new(context, rows);
        let mut encoder = context.device.create_command_encoder(&Default::default());
        pages.copy_from(&mut encoder, &self.materials.pages, page_moves);
        columns.copy_from(&mut encoder, &self.materials.columns, column_moves);
        context.queue.submit([encoder.finish()]);
        let table = bind::storage(context, "resident materials", table)?;
        let (scene, caches) = (&self.passes.scene, &self.passes.caches);
        let way = Way {
            angular: rows.angular,
            textures: Textures::Resident,
            half: self.passes.half,
        };
        let shade = Shade::new(context, scene, caches, way)?;
        let groups = [
            Groups::scene(context, &self.passes, &self.frame_buffer, &self.geometry, &table),
            Groups::caches(
                context,
                &self.passes,
                &self.materials.page_table_buffer.buffer,
                &self.materials.directions.buffer,
                &pages,
                &self.materials.slot_weights,
                &self.materials.slot_scales,
            ),
            shade.bind(context, &self.targets, &columns),
        ];
        Ok(Resident {
            pages,
            columns,
            table,
            shade,
            groups,
        })
    }

    /// Draws as [`Renderer::draw`] does, but what [`Renderer::lay_out_resident`] has copied, without a page table; what the
    /// caches hold, if nothing was copied.
    pub fn draw_resident(&mut self, exposure: f32) {
        let Some(resident) = self.resident.take() else {
            return self.draw(exposure);
        };
        self.frame.exposure = exposure;
        let frame = mirror::Frame {
            page_scale: resident.pages.scale(),
            column_shift: resident.columns.rows.width_shift,
            column_mask: (1 << resident.columns.rows.width_shift) - 1,
            ..self.frame
        };
        self.context
            .queue
            .write_buffer(&self.frame_buffer, 0, bytemuck::bytes_of(&frame));
        self.encode_picture(Some(&resident));
        self.resident = Some(resident);
    }
}
