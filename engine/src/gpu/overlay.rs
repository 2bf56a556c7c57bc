//! The overlay pass: the screen's picture, and over it what is known of each pixel's pages. Takes the place of tone mapping;
//! without an overlay it is not there.

use glam::Vec4;
use shaders::mirror;

use super::{
    bind::{self, Binding},
    context::Context,
    growing::Growing,
    renderer::Renderer,
    resources::Passes,
    targets::{SCREEN, Targets},
};
use crate::{
    Result,
    overlay::{MARKS, Overlay, SCALE},
};

/// The pass, while there is an overlay.
pub(super) struct OverlayPass {
    overlay: Overlay,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    choice: wgpu::Buffer,
    /// What it needs besides the tables that shading reads: ages by slot, or energies beside the page table.
    knowledge: Growing,
    group: wgpu::BindGroup,
}

impl OverlayPass {
    fn new(context: &Context, passes: &Passes, targets: &Targets, overlay: Overlay) -> Result<Self> {
        let bindings = [
            Binding::Floats,
            Binding::Picture(SCREEN),
            Binding::Integers,
            Binding::Uniform,
            Binding::Storage,
        ];
        let layout = bind::layout(context, "overlay", wgpu::ShaderStages::COMPUTE, &bindings);
        let pipeline = bind::compute(context, "overlay", &[&passes.scene, &passes.caches, &layout])?;
        let choice = context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("overlay"),
            size: size_of::<mirror::Overlay>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let knowledge = Growing::new(context, "overlay");
        Ok(Self {
            overlay,
            group: group(context, &layout, targets, &choice, &knowledge),
            pipeline,
            layout,
            choice,
            knowledge,
        })
    }

    fn bind(&mut self, context: &Context, targets: &Targets) {
        self.group = group(context, &self.layout, targets, &self.choice, &self.knowledge);
    }

    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        size: (u32, u32),
        [scene, caches]: [&wgpu::BindGroup; 2],
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        let mut pass = bind::pass(encoder, "overlay", timestamp_writes);
        bind::dispatch(&mut pass, &self.pipeline, &[scene, caches, &self.group], size);
    }

    pub(super) fn bytes(&self) -> u64 {
        self.choice.size() + self.knowledge.buffer.size()
    }
}

fn group(
    context: &Context,
    layout: &wgpu::BindGroupLayout,
    targets: &Targets,
    choice: &wgpu::Buffer,
    knowledge: &Growing,
) -> wgpu::BindGroup {
    use wgpu::BindingResource::TextureView;
    let resources = [
        TextureView(&targets.picture.view),
        TextureView(&targets.screen.view),
        TextureView(&targets.ids.visibility.view),
        choice.as_entire_binding(),
        knowledge.buffer.as_entire_binding(),
    ];
    bind::group(context, "overlay", layout, &resources)
}

impl Renderer {
    /// Chooses what pictures are covered with from now on. What was told of another overlay is forgotten.
    ///
    /// # Errors
    /// [`crate::Error::Adapter`] if the device fails.
    pub fn set_overlay(&mut self, overlay: Overlay) -> Result<()> {
        self.overlay = match overlay {
            Overlay::None => None,
            _ => Some(OverlayPass::new(
                &self.context,
                &self.passes,
                &self.targets,
                overlay,
            )?),
        };
        self.context.check()
    }

    pub(super) fn bind_overlay(&mut self) {
        if let Some(pass) = &mut self.overlay {
            pass.bind(&self.context, &self.targets);
        }
    }

    /// Tells how strong the overlay is, from 0 to 1, and the number of the frame.
    pub fn tune_overlay(&mut self, opacity: f32, now: u64) {
        let Some(pass) = &self.overlay else { return };
        let colour = |[r, g, b]: [u8; 3]| Vec4::new(r.into(), g.into(), b.into(), 255.0) / 255.0;
        let choice = mirror::Overlay {
            kind: pass.overlay as u32,
            opacity,
            now: now as u32,
            pad: 0,
            scale: SCALE.map(colour),
            marks: MARKS.map(colour),
        };
        self.context
            .queue
            .write_buffer(&pass.choice, 0, bytemuck::bytes_of(&choice));
    }

    /// Replaces what the overlay knows: for ages, the frame in which each slot's page came.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] beyond what a buffer holds.
    pub fn set_overlay_knowledge(&mut self, words: &[u32]) -> Result<()> {
        let Some(pass) = &mut self.overlay else {
            return Ok(());
        };
        if pass.knowledge.buffer.size() < words.len() as u64 * 4 {
            pass.knowledge = Growing::new(&self.context, "overlay");
            pass.knowledge.reserve(&self.context, words.len() as u64 * 4)?;
            pass.bind(&self.context, &self.targets);
        }
        let bytes = bytemuck::cast_slice(words);
        self.context.queue.write_buffer(&pass.knowledge.buffer, 0, bytes);
        Ok(())
    }

    /// Appends to it: for predicted errors, the energies of a BTF beside its entries in the page table.
    ///
    /// # Errors
    /// [`crate::Error::Budget`] beyond what a buffer holds.
    pub fn add_overlay_knowledge(&mut self, words: &[u32]) -> Result<()> {
        let Some(pass) = &mut self.overlay else {
            return Ok(());
        };
        pass.knowledge.reserve(&self.context, words.len() as u64 * 4)?;
        pass.knowledge.append(&self.context, words);
        pass.bind(&self.context, &self.targets);
        Ok(())
    }
}
