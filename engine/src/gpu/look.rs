//! Ids of what cameras see, and votes for them.

use scenes::Camera;
use shaders::mirror;

use super::{
    feedback::{Asked, Counted},
    renderer::Renderer,
    targets::AHEAD_SIDE,
    timers::{GpuMilliseconds, Pass, Timers},
    view,
};
use crate::{Error, Result};

/// What the feedback of a frame is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ask {
    /// Side of a feedback cell in pixels.
    pub stride: u32,
    /// Which pixel of each cell votes.
    pub phase: u32,
    /// Comes back with the votes.
    pub tag: u64,
}

impl Renderer {
    /// Draws ids for a camera, if there is one, and asks for votes, if so told. Returns whether votes will come:
    /// not while too many are on their way already.
    pub fn look(&mut self, camera: Option<&Camera>, ask: Option<Ask>) -> bool {
        let staging = ask.and_then(|ask| Some((ask, self.passes.feedback.free(false)?)));
        if camera.is_none() && staging.is_none() {
            return false;
        }
        if let Some(camera) = camera {
            view::set_camera(&mut self.frame, camera, self.targets.size);
            self.classified = false;
        }
        if let Some((ask, _)) = staging {
            (self.frame.feedback_stride, self.frame.feedback_phase) = (ask.stride, ask.phase);
        }
        self.write_frame();
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        if camera.is_some() {
            let timestamps = self.timers.as_mut().map(|timers| timers.render(Pass::Visibility));
            let (ids, draws) = (&self.targets.ids, &self.geometry.draws);
            self.passes
                .visibility
                .encode(&mut encoder, ids, &self.groups.scene, draws, timestamps);
        }
        if let Some((ask, staging)) = staging {
            let timestamps = self.timers.as_mut().map(|timers| timers.compute(Pass::Feedback));
            let (width, height) = self.targets.size;
            let cells = (width.div_ceil(ask.stride), height.div_ceil(ask.stride));
            let groups = [&self.groups.scene, &self.groups.caches, &self.groups.feedback];
            let asked = Asked {
                tag: ask.tag,
                ahead: false,
                pixels: 1,
            };
            self.passes.feedback.encode(
                &self.context,
                &mut encoder,
                cells,
                groups,
                (staging, asked),
                timestamps,
            );
        }
        self.context.queue.submit([encoder.finish()]);
        if let Some((_, staging)) = staging {
            self.passes.feedback.map(staging);
        }
        staging.is_some()
    }

    /// Asks for votes for a camera that is not shown, at once for all pixels of a picture of a quarter of the size each
    /// way; what they want is what pixels of the full size would. Returns whether votes will come: not while others
    /// are on their way. Changes nothing of what is drawn.
    pub fn look_ahead(&mut self, camera: &Camera, tag: u64) -> bool {
        let Some(staging) = self.passes.feedback.free(true) else {
            return false;
        };
        let size = self.targets.ahead.size;
        let mut frame = mirror::Frame {
            feedback_stride: 1,
            feedback_phase: 0,
            pixel_scale: size.1 as f32 / self.targets.size.1 as f32,
            ..self.frame
        };
        view::set_camera(&mut frame, camera, size);
        self.context
            .queue
            .write_buffer(&self.ahead_frame_buffer, 0, bytemuck::bytes_of(&frame));
        let mut encoder = self.context.device.create_command_encoder(&Default::default());
        let (ids, draws) = (&self.targets.ahead, &self.geometry.draws);
        self.passes
            .visibility
            .encode(&mut encoder, ids, &self.groups.ahead_scene, draws, None);
        let groups = [
            &self.groups.ahead_scene,
            &self.groups.caches,
            &self.groups.ahead_feedback,
        ];
        let asked = Asked {
            tag,
            ahead: true,
            pixels: AHEAD_SIDE * AHEAD_SIDE,
        };
        self.passes
            .feedback
            .encode(&self.context, &mut encoder, size, groups, (staging, asked), None);
        self.context.queue.submit([encoder.finish()]);
        self.passes.feedback.map(staging);
        true
    }

    /// Votes and times that have arrived, without waiting.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device has failed.
    pub fn poll(&mut self) -> Result<(Vec<Counted>, Option<GpuMilliseconds>)> {
        self.context
            .device
            .poll(wgpu::PollType::Poll)
            .map_err(|error| Error::Adapter(error.to_string()))?;
        self.context.check()?;
        Ok((
            self.passes.feedback.poll(),
            self.timers.as_mut().and_then(Timers::poll),
        ))
    }

    /// Whether votes are on their way back.
    pub fn votes_pending(&self) -> bool {
        self.passes.feedback.pending()
    }

    /// Bytes of votes that were copied back since the start.
    pub fn vote_bytes(&self) -> u64 {
        self.passes.feedback.bytes_read()
    }
}
