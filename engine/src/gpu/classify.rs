//! The classification pass: which materials each tile of the picture shows, as items for the shading pass.

use crate::{
    Result,
    gpu::{
        Context,
        bind::{self, Binding},
        targets::{PICTURE, Targets},
    },
};

/// The pass.
pub(super) struct Classify {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Classify {
    pub(super) fn new(context: &Context, scene: &wgpu::BindGroupLayout) -> Result<Self> {
        let bindings = [
            Binding::Integers,
            Binding::Picture(PICTURE),
            Binding::Counters,
            Binding::Counters,
        ];
        let layout = bind::layout(context, "classify", wgpu::ShaderStages::COMPUTE, &bindings);
        Ok(Self {
            pipeline: bind::compute(context, "classify", &[scene, &layout])?,
            layout,
        })
    }

    pub(super) fn bind(&self, context: &Context, targets: &Targets) -> wgpu::BindGroup {
        use wgpu::BindingResource::TextureView;
        let resources = [
            TextureView(&targets.ids.visibility.view),
            TextureView(&targets.picture.view),
            targets.work.as_entire_binding(),
            targets.workgroups.as_entire_binding(),
        ];
        bind::group(context, "classify", &self.layout, &resources)
    }

    /// After [`Targets::clear_work`]. `groups`: the scene, and what [`Classify::bind`] made.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        size: (u32, u32),
        groups: [&wgpu::BindGroup; 2],
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "classify", timestamp_writes);
        bind::dispatch(&mut pass, &self.pipeline, &groups, size);
    }
}
