//! The shading pass: outgoing radiance of each pixel that shows anything, material by material.

use std::sync::OnceLock;

use serde::Serialize;
use shaders::mirror;

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
/// Materials of a tile that are items of their own; more are one mixed item. As in `work.wgsl`.
const MOST_ITEMS: usize = 2;

/// Of which kinds there may be items.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kinds([bool; KINDS.len()]);

impl Kinds {
    /// Of pictures of these materials.
    pub(super) fn of(materials: &[mirror::Material]) -> Self {
        let is_btf = |material: &mirror::Material| material.groups > 0;
        Self([
            materials.iter().any(is_btf),
            !materials.iter().all(is_btf),
            materials.len() > MOST_ITEMS,
        ])
    }

    fn each(self) -> impl Iterator<Item = usize> {
        (0..KINDS.len()).filter(move |&kind| self.0[kind])
    }
}

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

/// Ways of shading that are shaders of their own.
#[derive(Clone, Copy)]
pub(super) struct Way {
    pub(super) angular: Angular,
    pub(super) textures: Textures,
    /// Sums over directions are of half floats; of [`Angular::Delaunay`] only, since the other way lets texture units sum.
    pub(super) half: bool,
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
        let (textures, constants): (_, [&'static [_]; 2]) = match way.textures {
            Textures::Virtual => ("eigen", [&[("fading", 0.0)], &[("fading", 1.0)]]),
            Textures::Resident => ("resident", [&[], &[]]),
        };
        let half = way.half && way.angular == Angular::Delaunay;
        let choices = [
            ("angular", file),
            ("textures", textures),
            ("arithmetic", if half { "half" } else { "single" }),
        ];
        let module = bind::variant(context, "shade", &choices)?;
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

    /// Compiles what a variant draws items of these kinds with, as far as it is not there.
    pub(super) fn compile(&self, variant: Variant, kinds: Kinds) {
        for kind in kinds.each() {
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

    /// Shades the items of these kinds that the classification has left in `targets`.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
        groups: [&wgpu::BindGroup; 3],
        (variant, kinds): (Variant, Kinds),
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "shade", timestamp_writes);
        for (index, group) in (0..).zip(groups) {
            pass.set_bind_group(index, group, &[]);
        }
        for kind in kinds.each() {
            pass.set_pipeline(self.pipeline(kind, variant));
            pass.dispatch_workgroups_indirect(&targets.workgroups, kind as u64 * 12);
        }
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn kinds_follow_from_what_materials_are() {
        let btf = mirror::Material {
            groups: 3,
            ..Zeroable::zeroed()
        };
        let diffuse = mirror::Material::zeroed();
        let kinds = |materials: &[_]| Kinds::of(materials).each().collect::<Vec<_>>();
        assert_eq!(kinds(&[btf]), [0]);
        assert_eq!(kinds(&[diffuse, diffuse]), [1]);
        assert_eq!(kinds(&[btf, diffuse]), [0, 1]);
        assert_eq!(kinds(&[btf, btf, btf]), [0, 2]);
        assert_eq!(kinds(&[btf, diffuse, btf]), [0, 1, 2]);
    }
}
