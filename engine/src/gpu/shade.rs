//! The shading pass: outgoing radiance of each pixel that shows anything, material by material.

use serde::Serialize;

use crate::{
    Result,
    angular::Angular,
    gpu::{
        Context,
        bind::{self, Binding},
        column_cache::ColumnCache,
        targets::{PICTURE, Targets},
    },
};

/// Entry points by kind of item, in the order of `work.wgsl`.
const KINDS: [&str; 3] = ["shade_btf", "shade_diffuse", "shade_mixed"];

/// What shading a picture took: sums over its pixels of component groups, each of which would cost a fetch from each of
/// two mips and [some](Angular::fetches) from its column for each light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ShadingWork {
    /// Items by kind: one BTF, one diffuse material, or more than two materials in a tile of 8 × 8 pixels.
    pub items: [u32; 3],
    /// Groups whose eigen-textures were fetched.
    pub groups_fetched: u32,
    /// Groups left out because together they matter less than the error that a pixel may have.
    pub groups_left_out: u32,
    /// Groups of which column or page were not resident.
    pub groups_absent: u32,
}

/// How pages and columns are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Textures {
    /// By the page table.
    Virtual,
    /// By arithmetic; see [`super::resident`].
    Resident,
}

/// The pass.
pub(super) struct Shade {
    pipelines: Vec<wgpu::ComputePipeline>,
    layout: wgpu::BindGroupLayout,
}

impl Shade {
    pub(super) fn new(
        context: &Context,
        scene: &wgpu::BindGroupLayout,
        caches: &wgpu::BindGroupLayout,
        angular: Angular,
        textures: Textures,
    ) -> Result<Self> {
        let (columns, file) = match angular {
            Angular::Delaunay => (Binding::Words, "delaunay"),
            Angular::Hemisphere => (Binding::Layers, "hemisphere"),
        };
        let bindings = [
            Binding::Integers,
            Binding::Picture(PICTURE),
            Binding::Counters,
            columns,
        ];
        let layout = bind::layout(context, "shade", wgpu::ShaderStages::COMPUTE, &bindings);
        let textures = match textures {
            Textures::Virtual => "eigen",
            Textures::Resident => "resident",
        };
        let module = bind::variant(context, "shade", &[("angular", file), ("textures", textures)])?;
        let pipelines = KINDS.map(|kind| bind::pipeline(context, &module, kind, &[scene, caches, &layout]));
        Ok(Self {
            pipelines: pipelines.into(),
            layout,
        })
    }

    pub(super) fn bind(
        &self,
        context: &Context,
        targets: &Targets,
        columns: &ColumnCache,
    ) -> wgpu::BindGroup {
        use wgpu::BindingResource::TextureView;
        let resources = [
            TextureView(&targets.ids.visibility.view),
            TextureView(&targets.picture.view),
            targets.work.as_entire_binding(),
            TextureView(&columns.view),
        ];
        bind::group(context, "shade", &self.layout, &resources)
    }

    /// Shades the items of `targets` that the classification has left there.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        groups: [&wgpu::BindGroup; 3],
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "shade", timestamp_writes);
        for (index, group) in (0..).zip(groups) {
            pass.set_bind_group(index, group, &[]);
        }
        for (kind, pipeline) in (0..).zip(&self.pipelines) {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups_indirect(&targets.workgroups, kind * 12);
        }
    }
}
