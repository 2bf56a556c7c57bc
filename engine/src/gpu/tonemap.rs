//! The tone mapping pass: from radiance to 8-bit sRGB.

use crate::{
    Result,
    gpu::{
        Context,
        bind::{self, Binding},
        targets::{SCREEN, Targets},
    },
};

/// The pass.
pub(super) struct Tonemap {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Tonemap {
    pub(super) fn new(
        context: &Context,
        scene: &wgpu::BindGroupLayout,
        caches: &wgpu::BindGroupLayout,
    ) -> Result<Self> {
        let layout = bind::layout(
            context,
            "tonemap",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::Floats, Binding::Picture(SCREEN)],
        );
        Ok(Self {
            pipeline: bind::compute(context, "tonemap", &[scene, caches, &layout])?,
            layout,
        })
    }

    pub(super) fn bind(&self, context: &Context, targets: &Targets) -> wgpu::BindGroup {
        use wgpu::BindingResource::TextureView;
        let resources = [
            TextureView(&targets.picture.view),
            TextureView(&targets.screen.view),
        ];
        bind::group(context, "tonemap", &self.layout, &resources)
    }

    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        size: (u32, u32),
        groups: [&wgpu::BindGroup; 3],
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "tonemap", timestamp_writes);
        bind::dispatch(&mut pass, &self.pipeline, &groups, size);
    }
}
