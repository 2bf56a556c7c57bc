//! The visibility pass: which triangle of which instance each pixel sees.

use crate::{
    Result,
    gpu::{
        Context, bind,
        targets::{DEPTH, Ids, VISIBILITY},
    },
};

/// The pass.
pub(super) struct Visibility {
    pipeline: wgpu::RenderPipeline,
}

impl Visibility {
    pub(super) fn new(context: &Context, scene: &wgpu::BindGroupLayout) -> Result<Self> {
        let module = bind::module(context, "visibility")?;
        let layout = context
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("visibility"),
                bind_group_layouts: &[Some(scene)],
                immediate_size: 0,
            });
        let pipeline = context
            .device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("visibility"),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("visibility_vertex"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                // Both sides of a triangle are seen; shading turns the frame.
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(true),
                    // Depth is near / distance.
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some("visibility_fragment"),
                    compilation_options: Default::default(),
                    targets: &[Some(VISIBILITY.into())],
                }),
                multiview_mask: None,
                cache: None,
            });
        Ok(Self { pipeline })
    }

    /// `draws`: corners of each instance.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        ids: &Ids,
        scene: &wgpu::BindGroup,
        draws: &[u32],
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("visibility"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &ids.visibility.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &ids.depth.view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            timestamp_writes,
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, scene, &[]);
        for (instance, &corners) in (0..).zip(draws) {
            pass.draw(0..corners, instance..instance + 1);
        }
    }
}
