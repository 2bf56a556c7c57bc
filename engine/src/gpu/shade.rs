//! The shading pass: outgoing radiance of each pixel that shows anything, material by material.

use std::sync::OnceLock;

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
const DIFFUSE: usize = 1;
const MIXED: usize = 2;
/// Materials of a tile that are items of their own; more are one mixed item. As in `work.wgsl`.
pub(super) const MOST_ITEMS: usize = 2;

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
    context: Context,
    module: wgpu::ShaderModule,
    /// Scene, caches, and what the pass itself reads and writes.
    groups: [wgpu::BindGroupLayout; 3],
    /// Override constants of both variants.
    constants: [&'static [(&'static str, f64)]; 2],
    /// By kind of item, while nothing fades and while something does. Made when they are first drawn with: compiling is most of
    /// what a first picture waits for, and few scenes need all of them.
    pipelines: [[OnceLock<wgpu::ComputePipeline>; 2]; KINDS.len()],
}

/// Which pipelines draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variant {
    /// Weights of slots are one.
    Plain,
    /// They may be below. Where they are one, the picture is the same, and takes longer.
    Fading,
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
        let (textures, constants): (_, [&'static [_]; 2]) = match textures {
            Textures::Virtual => ("eigen", [&[("fading", 0.0)], &[("fading", 1.0)]]),
            Textures::Resident => ("resident", [&[], &[]]),
        };
        let module = bind::variant(context, "shade", &[("angular", file), ("textures", textures)])?;
        Ok(Self {
            context: context.clone(),
            module,
            groups: [scene.clone(), caches.clone(), layout],
            constants,
            pipelines: Default::default(),
        })
    }

    /// Whether pictures of BTFs can be drawn in a variant without compiling it first.
    pub(super) fn has(&self, variant: Variant) -> bool {
        self.pipelines[0][variant as usize].get().is_some()
    }

    /// Compiles what a variant draws with, as far as it is not there; `mixed` as in [`Shade::encode`].
    pub(super) fn compile(&self, variant: Variant, mixed: bool) {
        for kind in kinds(mixed) {
            self.pipeline(kind, variant);
        }
    }

    fn pipeline(&self, kind: usize, variant: Variant) -> &wgpu::ComputePipeline {
        // What is diffuse never fades.
        let variant = if kind == DIFFUSE { Variant::Plain } else { variant } as usize;
        self.pipelines[kind][variant].get_or_init(|| {
            let groups = self.groups.each_ref();
            bind::variation(
                &self.context,
                &self.module,
                KINDS[kind],
                &groups,
                self.constants[variant],
            )
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
        bind::group(context, "shade", &self.groups[2], &resources)
    }

    /// Shades the items of `targets` that the classification has left there. `mixed`: there may be some of more than
    /// [`MOST_ITEMS`] materials.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        groups: [&wgpu::BindGroup; 3],
        (variant, mixed): (Variant, bool),
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "shade", timestamp_writes);
        for (index, group) in (0..).zip(groups) {
            pass.set_bind_group(index, group, &[]);
        }
        for kind in kinds(mixed) {
            pass.set_pipeline(self.pipeline(kind, variant));
            pass.dispatch_workgroups_indirect(&targets.workgroups, kind as u64 * 12);
        }
    }
}

/// Kinds of which there may be items.
fn kinds(mixed: bool) -> std::ops::Range<usize> {
    0..if mixed { KINDS.len() } else { MIXED }
}
