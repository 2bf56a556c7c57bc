//! Shows pictures in a target that somebody else owns: a window's, a page's, a texture.

use super::{
    bind::{self, Binding},
    context::Context,
};
use crate::Result;

/// A rectangle of a target in pixels, from its upper left corner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Area {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

impl Area {
    /// What lies in both; without pixels where nothing does.
    pub fn intersection(self, other: Self) -> Self {
        let (x, y) = (self.x.max(other.x), self.y.max(other.y));
        let right = self
            .x
            .saturating_add(self.width)
            .min(other.x.saturating_add(other.width));
        let bottom = self
            .y
            .saturating_add(self.height)
            .min(other.y.saturating_add(other.height));
        Self {
            x,
            y,
            width: right.saturating_sub(x),
            height: bottom.saturating_sub(y),
        }
    }

    /// Whether there is no pixel in it.
    pub fn is_empty(self) -> bool {
        self.width == 0 || self.height == 0
    }
}

/// The pass, for targets of one format.
pub struct Present {
    context: Context,
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl Present {
    /// For targets of this format, which may encode sRGB or leave it to pictures that are encoded already.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn new(context: &Context, format: wgpu::TextureFormat) -> Result<Self> {
        let device = &context.device;
        let layout = bind::layout(
            context,
            "present",
            wgpu::ShaderStages::FRAGMENT,
            &[Binding::Filtered, Binding::Sampler],
        );
        let module = bind::module(context, "present")?;
        let constants = [("decodes", f64::from(u8::from(format.is_srgb())))];
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("present"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("present"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("present_vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("present_fragment"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..Default::default()
                },
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("present"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        context.check()?;
        Ok(Self {
            context: context.clone(),
            pipeline,
            layout,
            sampler,
        })
    }

    /// Draws each picture over its area of a target of this size, as far as it lies in its clip; the rest of the target
    /// becomes black. What of an area lies outside of the target is left out.
    pub fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        size: (u32, u32),
        pictures: &[(&wgpu::TextureView, Area, Area)],
    ) {
        let whole = Area {
            width: size.0,
            height: size.1,
            ..Area::default()
        };
        let groups: Vec<_> = pictures
            .iter()
            .map(|(picture, ..)| {
                let resources = [
                    wgpu::BindingResource::TextureView(picture),
                    wgpu::BindingResource::Sampler(&self.sampler),
                ];
                bind::group(&self.context, "present", &self.layout, &resources)
            })
            .collect();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("present"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        for ((_, area, clip), group) in pictures.iter().zip(&groups) {
            let seen = area.intersection(*clip).intersection(whole);
            if seen.is_empty() {
                continue;
            }
            let [x, y, width, height] = [area.x, area.y, area.width, area.height].map(|side| side as f32);
            pass.set_viewport(x, y, width, height, 0.0, 1.0);
            pass.set_scissor_rect(seen.x, seen.y, seen.width, seen.height);
            pass.set_bind_group(0, group, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_meet_in_what_both_have() {
        let area = |x, y, width, height| Area { x, y, width, height };
        assert_eq!(
            area(0, 0, 10, 10).intersection(area(4, 6, 20, 2)),
            area(4, 6, 6, 2)
        );
        assert!(area(0, 0, 4, 4).intersection(area(4, 0, 4, 4)).is_empty());
        assert!(
            !area(u32::MAX - 1, 0, 9, 1)
                .intersection(area(0, 0, u32::MAX, 9))
                .is_empty()
        );
    }
}
