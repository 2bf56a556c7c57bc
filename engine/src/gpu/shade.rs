//! The shading pass: outgoing radiance of each pixel.

use crate::{
    Result,
    gpu::{
        Context,
        bind::{self, Binding},
        targets::{PICTURE, Targets},
    },
};

/// The pass.
pub(super) struct Shade {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Shade {
    pub(super) fn new(
        context: &Context,
        scene: &wgpu::BindGroupLayout,
        caches: &wgpu::BindGroupLayout,
    ) -> Result<Self> {
        let layout = bind::layout(
            context,
            "shade",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::Integers, Binding::Picture(PICTURE)],
        );
        Ok(Self {
            pipeline: bind::compute(context, "shade", &[scene, caches, &layout])?,
            layout,
        })
    }

    pub(super) fn bind(&self, context: &Context, targets: &Targets) -> wgpu::BindGroup {
        use wgpu::BindingResource::TextureView;
        let resources = [
            TextureView(&targets.visibility.view),
            TextureView(&targets.picture.view),
        ];
        bind::group(context, "shade", &self.layout, &resources)
    }

    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        size: (u32, u32),
        groups: [&wgpu::BindGroup; 3],
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        bind::dispatch(encoder, "shade", &self.pipeline, groups, size, timestamp_writes);
    }
}
