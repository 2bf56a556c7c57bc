//! What the window shows: the surface, and egui's renderer.

use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use egui::{ClippedPrimitive, TexturesDelta};
use engine::gpu::{Area, Context};
use viewer::Viewer;
use wgpu::CurrentSurfaceTexture as Current;
use winit::window::Window;

/// A window's surface.
pub(crate) struct Surface {
    context: Context,
    surface: wgpu::Surface<'static>,
    configuration: wgpu::SurfaceConfiguration,
    egui: egui_wgpu::Renderer,
}

/// What egui wants to have drawn.
pub(crate) struct Painted {
    pub(crate) primitives: Vec<ClippedPrimitive>,
    pub(crate) textures: TexturesDelta,
    pub(crate) pixels_per_point: f32,
}

impl Surface {
    /// Of a window, with a device that can draw into it.
    pub(crate) fn new(window: &Arc<Window>) -> Result<Self> {
        let descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance
            .create_surface(window.clone())
            .context("the window cannot be drawn into")?;
        let context = pollster::block_on(Context::new(&instance, Some(&surface)))?;
        let size = window.inner_size();
        let configuration = context.configure(&surface, (size.width, size.height))?;
        let options = egui_wgpu::RendererOptions {
            dithering: false,
            ..Default::default()
        };
        let egui = egui_wgpu::Renderer::new(context.device(), configuration.format, options);
        Ok(Self {
            context,
            surface,
            configuration,
            egui,
        })
    }

    pub(crate) fn context(&self) -> &Context {
        &self.context
    }

    /// Pixels.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.configuration.width, self.configuration.height)
    }

    pub(crate) fn resize(&mut self, size: (u32, u32)) -> Result<()> {
        if size != self.size() && size.0 > 0 && size.1 > 0 {
            self.configuration = self.context.configure(&self.surface, size)?;
        }
        Ok(())
    }

    /// Shows the viewer's last frame in an area, and what egui has painted over it. Returns whether it could: not while the
    /// window is hidden, nor when the surface has to be made anew first.
    pub(crate) fn show(
        &mut self,
        viewer: &mut Viewer,
        area: Area,
        split: f32,
        painted: &mut Painted,
    ) -> Result<bool> {
        let (device, queue) = (self.context.device(), self.context.queue());
        for (id, deltas) in painted.textures.set.drain() {
            for delta in &deltas {
                self.egui.update_texture(device, queue, id, delta);
            }
        }
        let free = std::mem::take(&mut painted.textures.free);
        let shown = match self.surface.get_current_texture() {
            Current::Success(texture) | Current::Suboptimal(texture) => {
                let view = texture.texture.create_view(&Default::default());
                let mut encoder = device.create_command_encoder(&Default::default());
                let (format, size) = (self.configuration.format, self.size());
                viewer.present(&mut encoder, &view, format, size, area, split)?;
                let screen = egui_wgpu::ScreenDescriptor {
                    size_in_pixels: [size.0, size.1],
                    pixels_per_point: painted.pixels_per_point,
                };
                let buffers =
                    self.egui
                        .update_buffers(device, queue, &mut encoder, &painted.primitives, &screen);
                let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("panel"),
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: &view,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations {
                            load: wgpu::LoadOp::Load,
                            store: wgpu::StoreOp::Store,
                        },
                    })],
                    ..Default::default()
                });
                let mut pass = pass.forget_lifetime();
                self.egui.render(&mut pass, &painted.primitives, &screen);
                drop(pass);
                queue.submit(buffers.into_iter().chain([encoder.finish()]));
                queue.present(texture);
                true
            }
            Current::Outdated | Current::Lost => {
                self.configuration = self.context.configure(&self.surface, self.size())?;
                false
            }
            Current::Timeout | Current::Occluded => false,
            Current::Validation => bail!("the window cannot be drawn into any more"),
        };
        for id in &free {
            self.egui.free_texture(id);
        }
        Ok(shown)
    }
}
