//! How long each pass took on the GPU, where the adapter can tell.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use serde::Serialize;

use crate::gpu::Context;

/// Milliseconds of the passes on the GPU; zero for a pass that did not run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct GpuMilliseconds {
    /// Rasterizing ids.
    pub visibility: f64,
    /// Counting votes.
    pub feedback: f64,
    /// Finding which materials each tile of the picture shows.
    pub classify: f64,
    /// Shading.
    pub shade: f64,
    /// Tone mapping.
    pub tonemap: f64,
    /// Decoding pages.
    pub decode: f64,
    /// Stitching borders.
    pub stitch: f64,
}

/// A pass that is timed, by the index of its first timestamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pass {
    Visibility = 0,
    Feedback = 2,
    Shade = 4,
    Tonemap = 6,
    Stitch = 8,
    Classify = 10,
    Decode = 12,
}

const TIMESTAMPS: u32 = 14;
const BYTES: u64 = TIMESTAMPS as u64 * 8;
/// Each pass is resolved to a place of its own.
const RESOLVED_BYTES: u64 = TIMESTAMPS as u64 / 2 * wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT;

/// Timestamps of one frame at a time; frames that come while they are read back are not timed.
pub(super) struct Timers {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
    /// Set when the staging buffer can be read.
    mapped: Arc<AtomicBool>,
    busy: bool,
    /// Passes of this frame, and of the frame that is read back.
    ran: [bool; TIMESTAMPS as usize],
    reading: [bool; TIMESTAMPS as usize],
    nanoseconds: f64,
}

impl Timers {
    /// `None` where the adapter has no timestamps.
    pub(super) fn new(context: &Context) -> Option<Self> {
        let buffer = |label, size, usage| {
            context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usage;
        context.has_timestamps().then(|| Self {
            queries: context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timers"),
                ty: wgpu::QueryType::Timestamp,
                count: TIMESTAMPS,
            }),
            resolved: buffer(
                "timestamps",
                RESOLVED_BYTES,
                Usage::QUERY_RESOLVE | Usage::COPY_SRC,
            ),
            staging: buffer("timestamps read back", BYTES, Usage::COPY_DST | Usage::MAP_READ),
            mapped: Arc::default(),
            busy: false,
            ran: Default::default(),
            reading: Default::default(),
            nanoseconds: context.queue.get_timestamp_period().into(),
        })
    }

    pub(super) fn render(&mut self, pass: Pass) -> wgpu::RenderPassTimestampWrites<'_> {
        self.ran[pass as usize] = true;
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(pass as u32),
            end_of_pass_write_index: Some(pass as u32 + 1),
        }
    }

    pub(super) fn compute(&mut self, pass: Pass) -> wgpu::ComputePassTimestampWrites<'_> {
        self.ran[pass as usize] = true;
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(pass as u32),
            end_of_pass_write_index: Some(pass as u32 + 1),
        }
    }

    /// Of a pass that takes several rounds: from the beginning of the first to the end of the last.
    pub(super) fn round(
        &mut self,
        pass: Pass,
        first: bool,
        last: bool,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        self.ran[pass as usize] = true;
        (first || last).then_some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: first.then_some(pass as u32),
            end_of_pass_write_index: last.then_some(pass as u32 + 1),
        })
    }

    /// After the frame's last pass. Returns whether [`Timers::map`] is to be called after submission.
    pub(super) fn resolve(&mut self, encoder: &mut wgpu::CommandEncoder) -> bool {
        let ran = std::mem::take(&mut self.ran);
        if self.busy {
            return false;
        }
        self.reading = ran;
        // Timestamps that were never written must not be resolved: adapters would wait for them.
        for first in (0..TIMESTAMPS).step_by(2).filter(|&first| ran[first as usize]) {
            let place = u64::from(first) / 2 * wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT;
            encoder.resolve_query_set(&self.queries, first..first + 2, &self.resolved, place);
            encoder.copy_buffer_to_buffer(&self.resolved, place, &self.staging, u64::from(first) * 8, 16);
        }
        true
    }

    pub(super) fn map(&mut self) {
        self.busy = true;
        let mapped = self.mapped.clone();
        self.staging.map_async(wgpu::MapMode::Read, .., move |_| {
            mapped.store(true, Ordering::Release)
        });
    }

    /// The times that have arrived since the last call.
    pub(super) fn poll(&mut self) -> Option<GpuMilliseconds> {
        if !self.busy || !self.mapped.swap(false, Ordering::Acquire) {
            return None;
        }
        self.busy = false;
        let times = self.staging.get_mapped_range(..).ok().map(|bytes| {
            let at =
                |index: usize| u64::from_le_bytes(bytes[index * 8..][..8].try_into().unwrap_or_default());
            let pass = |pass: Pass| {
                let ticks = at(pass as usize + 1).saturating_sub(at(pass as usize));
                if self.reading[pass as usize] {
                    ticks as f64 * self.nanoseconds * 1e-6
                } else {
                    0.0
                }
            };
            GpuMilliseconds {
                visibility: pass(Pass::Visibility),
                feedback: pass(Pass::Feedback),
                classify: pass(Pass::Classify),
                shade: pass(Pass::Shade),
                tonemap: pass(Pass::Tonemap),
                decode: pass(Pass::Decode),
                stitch: pass(Pass::Stitch),
            }
        });
        self.staging.unmap();
        times
    }
}
