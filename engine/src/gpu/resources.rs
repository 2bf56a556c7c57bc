//! What the renderer owns: passes, tables and caches, bind groups.

use glam::Vec3;
use shaders::mirror;

use super::{
    bind::{self, Binding},
    classify::Classify,
    column_cache::{ColumnCache, Rows},
    context::Context,
    cutoff::groups_that_matter,
    fade::{Fade, SlotWeights},
    feedback::Feedback,
    geometry::Geometry,
    growing::{self, Growing},
    kept::Slots,
    materials::{Btf, Tables},
    page_cache::{Grid, PageCache},
    page_format::PageFormat,
    page_table::{PageTable, Region},
    shade::{Kinds, Shade, Textures, Way},
    slot_scales::SlotScales,
    stitch::{Stitch, StitchGroups},
    targets::Targets,
    tonemap::Tonemap,
    visibility::Visibility,
};
use crate::{Result, angular::Angular, residency::Slot};

/// Reflectance of BTFs whose archives are not known yet.
pub(super) const UNKNOWN: Vec3 = Vec3::splat(0.18);

/// Budgets of the caches, and what lies in them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caches {
    /// Bytes of the page cache.
    pub page_bytes: u64,
    /// What its texels are.
    pub page_format: PageFormat,
    /// Bytes of the column cache.
    pub column_bytes: u64,
    /// What columns are.
    pub angular: Angular,
}

/// How the caches are laid out within their budgets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub(super) pages: Grid,
    pub(super) page_format: PageFormat,
    pub(super) columns: Rows,
}

impl Layout {
    /// Room for one page, and for one column of next to nothing: all that a scene without known BTFs needs.
    const fn nothing(angular: Angular, page_format: PageFormat) -> Self {
        Self {
            pages: Grid {
                columns: 1,
                rows: 1,
                layers: 1,
            },
            page_format,
            columns: Rows {
                angular,
                width_shift: 7,
                slot_rows: 1,
                layer_slots: 1,
                layers: 1,
            },
        }
    }

    /// What `caches` have room for, if the largest column has `column_quads` times four half floats; 0 if there is none.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] if that is not one page and one column.
    pub(super) fn new(context: &Context, caches: Caches, column_quads: u64) -> Result<Self> {
        let pages = PageCache::grid(context, caches.page_format, caches.page_bytes)?;
        if column_quads == 0 {
            return Ok(Self::nothing(caches.angular, caches.page_format));
        }
        Ok(Self {
            pages,
            page_format: caches.page_format,
            columns: ColumnCache::rows(context, caches.angular, column_quads, caches.column_bytes)?,
        })
    }

    /// What a texel of the page cache is.
    pub fn page_format(&self) -> PageFormat {
        self.page_format
    }

    /// Slots for pages and for columns.
    pub fn slots(&self) -> (u32, u32) {
        (self.pages.slots(), self.columns.slots())
    }
}

/// Choices of shading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shading {
    /// Root mean square reflectance that a pixel may lose because components are left out; 0 leaves out nothing.
    pub component_error: f64,
    /// Frames in which a new page comes in; 0: at once.
    pub fade_frames: u32,
    /// How eigen-textures are filtered.
    pub filter: Filter,
}

/// How eigen-textures are filtered: bilinear inside of a mip, which is the finest or the coarsest wherever there is no other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// Between the two mips around the level of detail.
    #[default]
    Trilinear,
    /// In the nearest mip, which takes one sample instead of two and shows where the mip changes.
    Bilinear,
}

impl Default for Shading {
    fn default() -> Self {
        Self {
            // 1/16 of a step of 8 bits, or 66 dB below white.
            component_error: 5e-4,
            // A tenth of a second at 60 Hz.
            fade_frames: 6,
            filter: Filter::default(),
        }
    }
}

/// The passes, and the layouts of the bind groups that they share.
pub(super) struct Passes {
    pub(super) scene: wgpu::BindGroupLayout,
    pub(super) caches: wgpu::BindGroupLayout,
    pub(super) visibility: Visibility,
    pub(super) feedback: Feedback,
    pub(super) classify: Classify,
    pub(super) shade: Shade,
    /// Shading sums half floats.
    pub(super) half: bool,
    pub(super) tonemap: Tonemap,
    pub(super) stitch: Stitch,
}

/// What depends on the BTFs that are known.
pub(super) struct Materials {
    pub(super) table: wgpu::Buffer,
    /// What there is to shade, by that table.
    pub(super) kinds: Kinds,
    pub(super) tables: Tables,
    pub(super) directions: Growing,
    pub(super) page_table: PageTable,
    pub(super) page_table_buffer: Growing,
    pub(super) pages: PageCache,
    pub(super) columns: ColumnCache,
    pub(super) shading: Shading,
    pub(super) fade: Fade,
    pub(super) slot_weights: SlotWeights,
    pub(super) slot_scales: SlotScales,
    /// Strips that give slots larger scales, to be run before any others.
    pub(super) raised: Vec<mirror::Strip>,
}

/// The bind groups.
pub(super) struct Groups {
    pub(super) scene: wgpu::BindGroup,
    pub(super) caches: wgpu::BindGroup,
    pub(super) feedback: wgpu::BindGroup,
    pub(super) classify: wgpu::BindGroup,
    /// Of cameras that are not shown.
    pub(super) ahead_scene: wgpu::BindGroup,
    pub(super) ahead_feedback: wgpu::BindGroup,
    pub(super) shade: wgpu::BindGroup,
    pub(super) tonemap: wgpu::BindGroup,
    pub(super) stitch: StitchGroups,
}

impl Passes {
    pub(super) fn new(context: &Context) -> Result<Self> {
        use wgpu::ShaderStages as Stages;
        // Camera, vertices, indices, instances, materials, lights.
        let storage = [Binding::Storage; 5];
        let scene = [&[Binding::Uniform], &storage[..]].concat();
        let scene = bind::layout(context, "scene", Stages::VERTEX | Stages::COMPUTE, &scene);
        // Page table, directions, pages, weights and scales of slots.
        let caches = [
            Binding::Storage,
            Binding::Storage,
            Binding::Layers,
            Binding::Sampler,
            Binding::Floats,
            Binding::Floats,
        ];
        let caches = bind::layout(context, "caches", Stages::COMPUTE, &caches);
        let way = Way {
            angular: Angular::default(),
            textures: Textures::Virtual,
            half: false,
        };
        Ok(Self {
            visibility: Visibility::new(context, &scene)?,
            feedback: Feedback::new(context, &scene, &caches)?,
            classify: Classify::new(context, &scene)?,
            shade: Shade::new(context, &scene, &caches, way)?,
            half: false,
            tonemap: Tonemap::new(context, &scene, &caches)?,
            stitch: Stitch::new(context, PageFormat::default())?,
            scene,
            caches,
        })
    }
}

impl Materials {
    /// Of a scene of whose BTFs none is known.
    pub(super) fn new(context: &Context, scene_materials: &[scenes::Material]) -> Result<Self> {
        let tables = Tables::default();
        let unknown = tables.materials(scene_materials, &vec![None; scene_materials.len()], UNKNOWN);
        let shading = Shading::default();
        let nothing = Layout::nothing(Angular::default(), PageFormat::default());
        let fade = Fade::new(shading.fade_frames, nothing.slots().0);
        Ok(Self {
            table: bind::storage(context, "materials", &unknown)?,
            kinds: Kinds::of(&unknown),
            tables,
            directions: Growing::new(context, "directions"),
            page_table: PageTable::default(),
            page_table_buffer: Growing::new(context, "page tables"),
            pages: PageCache::new(context, nothing.pages, nothing.page_format),
            columns: ColumnCache::new(context, nothing.columns),
            shading,
            slot_weights: SlotWeights::new(context, &fade),
            slot_scales: SlotScales::new(context, 0),
            raised: Vec::new(),
            fade,
        })
    }

    /// Appends a BTF, of which nothing is resident.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] if a table would exceed the adapter; then all stays as it is.
    pub(super) fn add(&mut self, context: &Context, btf: &Btf) -> Result<()> {
        let region = Region {
            base: self.tables.page_entries,
            groups: btf.groups(),
            pyramid: *btf.pyramid(),
        };
        let entries_bytes = region.entries() as u64 * 4;
        let most_words = (growing::most_bytes(context) / 4).min(u32::MAX.into());
        let added = self.tables.pack(btf, most_words as u32)?;
        self.directions
            .reserve(context, added.directions.len() as u64 * 4)?;
        self.page_table_buffer.reserve(context, entries_bytes)?;
        self.tables.push(&added);
        self.directions.append(context, &added.directions);
        // Written with all else that has changed in the table.
        self.page_table_buffer.skip(entries_bytes);
        let matter = groups_that_matter(&btf.index, self.shading.component_error);
        self.page_table.add(region, &matter);
        Ok(())
    }

    /// Lets the materials of the scene show the BTFs that `btf_of` names for them.
    pub(super) fn show(
        &mut self,
        context: &Context,
        scene_materials: &[scenes::Material],
        btf_of: &[Option<usize>],
    ) {
        let materials = self.tables.materials(scene_materials, btf_of, UNKNOWN);
        self.kinds = Kinds::of(&materials);
        context
            .queue
            .write_buffer(&self.table, 0, bytemuck::cast_slice(&materials));
    }

    /// Makes caches of another layout and moves there, on the GPU, what stays: pages and columns from slot to slot. The
    /// page table must name only those. A cache whose layout stays is left alone; in it nothing moves. Where pages or columns
    /// become something else, none stay. Returns the old slots if they were replaced.
    pub(super) fn resize(
        &mut self,
        context: &Context,
        layout: Layout,
        pages: &[(Slot, Slot)],
        columns: &[(Slot, Slot)],
    ) -> Option<Slots> {
        let old = self.layout();
        let mut replaced = None;
        let mut encoder = context.device.create_command_encoder(&Default::default());
        if (layout.pages, layout.page_format) != (old.pages, old.page_format) {
            let resized = PageCache::new(context, layout.pages, layout.page_format);
            if layout.page_format == old.page_format {
                resized.copy_from(&mut encoder, &self.pages, pages);
            }
            let scaled = match layout.page_format {
                PageFormat::Half => 0,
                PageFormat::Byte => layout.pages.slots(),
            };
            let scales = self.slot_scales.moved(context, scaled, pages);
            self.fade = self.fade.moved(layout.slots().0, pages.iter().copied());
            let weights = SlotWeights::new(context, &self.fade);
            replaced = Some(Slots {
                pages: std::mem::replace(&mut self.pages, resized),
                weights: std::mem::replace(&mut self.slot_weights, weights),
                scales: std::mem::replace(&mut self.slot_scales, scales),
            });
        }
        if layout.columns != old.columns {
            let resized = ColumnCache::new(context, layout.columns);
            if layout.columns.angular == old.columns.angular {
                resized.copy_from(&mut encoder, &self.columns, columns);
            }
            self.columns = resized;
        }
        context.queue.submit([encoder.finish()]);
        let (page_slots, column_slots) = old.slots();
        let page_to = destinations(page_slots, pages);
        let column_to = destinations(column_slots, columns);
        self.page_table.relocate(
            |address| layout.pages.address(page_to[old.pages.slot(address).0 as usize]),
            |address| {
                layout
                    .columns
                    .address(column_to[old.columns.slot(address).0 as usize])
            },
        );
        replaced
    }

    pub(super) fn layout(&self) -> Layout {
        Layout {
            pages: self.pages.grid,
            page_format: self.pages.format,
            columns: self.columns.rows,
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        let buffers = [
            &self.table,
            &self.directions.buffer,
            &self.page_table_buffer.buffer,
        ];
        buffers.iter().map(|buffer| buffer.size()).sum::<u64>()
            + self.pages.bytes()
            + self.columns.bytes()
            + self.slot_weights.bytes()
            + self.slot_scales.bytes()
    }
}

/// For each old slot the new one.
fn destinations(slots: u32, moves: &[(Slot, Slot)]) -> Vec<Slot> {
    let mut to = vec![Slot(0); slots as usize];
    for &(source, destination) in moves {
        to[source.0 as usize] = destination;
    }
    to
}

impl Groups {
    pub(super) fn new(
        context: &Context,
        passes: &Passes,
        targets: &Targets,
        geometry: &Geometry,
        materials: &Materials,
        [frame, ahead_frame]: [&wgpu::Buffer; 2],
    ) -> Self {
        let scene = |frame| Self::scene(context, passes, frame, geometry, &materials.table);
        Self {
            scene: scene(frame),
            ahead_scene: scene(ahead_frame),
            caches: Self::caches(
                context,
                passes,
                &materials.page_table_buffer.buffer,
                &materials.directions.buffer,
                &materials.pages,
                &materials.slot_weights,
                &materials.slot_scales,
            ),
            feedback: passes.feedback.bind(context, &targets.ids),
            ahead_feedback: passes.feedback.bind(context, &targets.ahead),
            classify: passes.classify.bind(context, targets),
            shade: passes.shade.bind(context, targets, &materials.columns),
            tonemap: passes.tonemap.bind(context, targets),
            stitch: passes.stitch.bind(context, &materials.pages),
        }
    }

    /// The scene with a table of materials.
    pub(super) fn scene(
        context: &Context,
        passes: &Passes,
        frame: &wgpu::Buffer,
        geometry: &Geometry,
        table: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let buffers = [
            frame,
            &geometry.vertices,
            &geometry.indices,
            &geometry.instances,
            table,
            &geometry.lights,
        ];
        let resources = buffers.map(wgpu::Buffer::as_entire_binding);
        bind::group(context, "scene", &passes.scene, &resources)
    }

    /// Page table and directions with a cache of pages.
    pub(super) fn caches(
        context: &Context,
        passes: &Passes,
        table: &wgpu::Buffer,
        directions: &wgpu::Buffer,
        pages: &PageCache,
        weights: &SlotWeights,
        scales: &SlotScales,
    ) -> wgpu::BindGroup {
        use wgpu::BindingResource::{Sampler, TextureView};
        let resources = [
            table.as_entire_binding(),
            directions.as_entire_binding(),
            TextureView(&pages.view),
            Sampler(&pages.sampler),
            TextureView(&weights.view),
            TextureView(&scales.view),
        ];
        bind::group(context, "caches", &passes.caches, &resources)
    }
}
