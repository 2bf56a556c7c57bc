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

/// Ways of shading that are pipelines of their own.
#[derive(Clone, Copy)]
pub(super) struct Way {
    pub(super) angular: Angular,
    pub(super) textures: Textures,
    /// Sums over directions are of half floats; of [`Angular::Delaunay`] only, since the other way lets texture units sum.
    pub(super) half: bool,
}

/// The pass.
pub(super) struct Shade {
    /// By kind of item, while nothing fades and while something does.
    pipelines: Vec<[wgpu::ComputePipeline; 2]>,
    layout: wgpu::BindGroupLayout,
}

impl Shade {
    pub(super) fn new(
        context: &Context,
        scene: &wgpu::BindGroupLayout,
        caches: &wgpu::BindGroupLayout,
        way: Way,
    ) -> Result<Self> {
        let (columns, file) = match way.angular {
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
        let (textures, constants): (_, &[&[(&str, f64)]]) = match way.textures {
            Textures::Virtual => ("eigen", &[&[("fading", 0.0)], &[("fading", 1.0)]]),
            Textures::Resident => ("resident", &[&[], &[]]),
        };
        let half = way.half && way.angular == Angular::Delaunay;
        let choices = [
            ("angular", file),
            ("textures", textures),
            ("arithmetic", if half { "half" } else { "single" }),
        ];
        let module = bind::variant(context, "shade", &choices)?;
        let groups = [scene, caches, &layout];
        let pipelines = KINDS.map(|kind| {
            [0, 1].map(|fading| bind::variation(context, &module, kind, &groups, constants[fading]))
        });
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

    /// Shades the items of `targets` that the classification has left there. `fading`: weights of slots may be below one.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        groups: [&wgpu::BindGroup; 3],
        fading: bool,
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "shade", timestamp_writes);
        for (index, group) in (0..).zip(groups) {
            pass.set_bind_group(index, group, &[]);
        }
        for (kind, pipelines) in (0..).zip(&self.pipelines) {
            pass.set_pipeline(&pipelines[usize::from(fading)]);
            pass.dispatch_workgroups_indirect(&targets.workgroups, kind * 12);
        }
    }
}
