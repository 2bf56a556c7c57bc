//! What the renderer owns: passes, tables and caches, bind groups.

use glam::Vec3;

use super::{
    bind::{self, Binding},
    classify::Classify,
    column_cache::ColumnCache,
    context::Context,
    cutoff::groups_that_matter,
    fade::Fade,
    feedback::Feedback,
    geometry::Geometry,
    materials::{self, Bases, Btf},
    page_cache::PageCache,
    page_table::{PageTable, Region},
    shade::Shade,
    stitch::{Stitch, StitchGroups},
    targets::Targets,
    tonemap::Tonemap,
    visibility::Visibility,
};
use crate::Result;

/// Reflectance of BTFs whose archives are not known yet.
const UNKNOWN: Vec3 = Vec3::splat(0.18);

/// Budgets of the caches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caches {
    /// Bytes of the page cache.
    pub page_bytes: u64,
    /// Bytes of the column cache.
    pub column_bytes: u64,
}

/// Choices of shading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shading {
    /// Root mean square reflectance that a pixel may lose because components are left out; 0 leaves out nothing.
    pub component_error: f64,
    /// Frames in which a new page comes in; 0: at once.
    pub fade_frames: u32,
}

impl Default for Shading {
    fn default() -> Self {
        Self {
            // 1/16 of a step of 8 bits, or 66 dB below white.
            component_error: 5e-4,
            // A tenth of a second at 60 Hz.
            fade_frames: 6,
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
    pub(super) tonemap: Tonemap,
    pub(super) stitch: Stitch,
}

/// What depends on the BTFs that are known.
pub(super) struct Materials {
    pub(super) table: wgpu::Buffer,
    pub(super) directions: wgpu::Buffer,
    pub(super) bases: Vec<Bases>,
    pub(super) ambient_weights: Vec<Vec<f64>>,
    pub(super) page_table: PageTable,
    pub(super) page_table_buffer: wgpu::Buffer,
    pub(super) pages: PageCache,
    pub(super) columns: ColumnCache,
    pub(super) fade: Fade,
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
        // Page table, directions, pages, columns.
        let caches = [
            Binding::Storage,
            Binding::Storage,
            Binding::Layers,
            Binding::Sampler,
            Binding::Words,
        ];
        let caches = bind::layout(context, "caches", Stages::COMPUTE, &caches);
        Ok(Self {
            visibility: Visibility::new(context, &scene)?,
            feedback: Feedback::new(context, &scene, &caches)?,
            classify: Classify::new(context, &scene)?,
            shade: Shade::new(context, &scene, &caches)?,
            tonemap: Tonemap::new(context, &scene, &caches)?,
            stitch: Stitch::new(context)?,
            scene,
            caches,
        })
    }
}

impl Materials {
    pub(super) fn new(
        context: &Context,
        scene_materials: &[scenes::Material],
        btfs: &[Btf],
        btf_of: &[Option<usize>],
        caches: Caches,
        shading: Shading,
    ) -> Result<Self> {
        let tables = materials::pack(scene_materials, btfs, btf_of, UNKNOWN)?;
        let regions = btfs.iter().zip(&tables.bases).map(|(btf, bases)| Region {
            base: bases.page_table,
            groups: btf.groups(),
            pyramid: *btf.pyramid(),
        });
        let matter: Vec<_> = btfs
            .iter()
            .map(|btf| groups_that_matter(&btf.index, shading.component_error))
            .collect();
        let pages = PageCache::new(context, caches.page_bytes)?;
        let page_table = PageTable::new(regions.collect(), &matter, pages.grid.slots());
        let column_quads = btfs.iter().map(Btf::column_quads).max().unwrap_or(1);
        Ok(Self {
            table: bind::storage(context, "materials", &tables.materials)?,
            directions: bind::storage(context, "directions", &tables.directions)?,
            bases: tables.bases,
            ambient_weights: btfs.iter().map(|btf| btf.ambient_weights.clone()).collect(),
            page_table_buffer: bind::storage(context, "page tables", page_table.entries())?,
            page_table,
            pages,
            columns: ColumnCache::new(context, column_quads, caches.column_bytes)?,
            fade: Fade::new(shading.fade_frames),
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        let buffers = [&self.table, &self.directions, &self.page_table_buffer];
        buffers.iter().map(|buffer| buffer.size()).sum::<u64>() + self.pages.bytes() + self.columns.bytes()
    }
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
        use wgpu::BindingResource::{Sampler, TextureView};
        let scene = |frame| {
            let buffers = [
                frame,
                &geometry.vertices,
                &geometry.indices,
                &geometry.instances,
                &materials.table,
                &geometry.lights,
            ];
            let resources = buffers.map(wgpu::Buffer::as_entire_binding);
            bind::group(context, "scene", &passes.scene, &resources)
        };
        let caches = [
            materials.page_table_buffer.as_entire_binding(),
            materials.directions.as_entire_binding(),
            TextureView(&materials.pages.view),
            Sampler(&materials.pages.sampler),
            TextureView(&materials.columns.view),
        ];
        Self {
            scene: scene(frame),
            ahead_scene: scene(ahead_frame),
            caches: bind::group(context, "caches", &passes.caches, &caches),
            feedback: passes.feedback.bind(context, &targets.ids),
            ahead_feedback: passes.feedback.bind(context, &targets.ahead),
            classify: passes.classify.bind(context, targets),
            shade: passes.shade.bind(context, targets),
            tonemap: passes.tonemap.bind(context, targets),
            stitch: passes.stitch.bind(context, &materials.pages),
        }
    }
}
