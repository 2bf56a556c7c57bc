//! The feedback pass: votes for tiles, counted on the GPU and read back without waiting.
//!
//! Source: Schwartz, Ruiters, Klein 2013, sections 3 and 5.2.

use std::sync::{
    Arc,
    atomic::{AtomicU8, Ordering},
};

use crate::{
    Result,
    gpu::{
        Context,
        bind::{self, Binding},
        targets::Targets,
    },
};

/// Votes that may be on their way back at once; further ones are not asked for.
const RING: usize = 3;

/// States of a staging buffer.
const FREE: u8 = 0;
const PENDING: u8 = 1;
const READY: u8 = 2;
const LOST: u8 = 3;

/// Votes that came back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Counted {
    /// What [`super::Renderer::look`] was told to remember about them.
    pub tag: u64,
    /// Counters with their indices, only those that are not zero.
    pub votes: Vec<(u32, u32)>,
}

struct Staging {
    buffer: wgpu::Buffer,
    state: Arc<AtomicU8>,
    tag: u64,
}

/// The pass.
pub(super) struct Feedback {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    counters: wgpu::Buffer,
    ring: Vec<Staging>,
}

impl Feedback {
    pub(super) fn new(
        context: &Context,
        scene: &wgpu::BindGroupLayout,
        caches: &wgpu::BindGroupLayout,
    ) -> Result<Self> {
        let layout = bind::layout(
            context,
            "feedback",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::Integers, Binding::Counters],
        );
        let pipeline = bind::compute(context, "feedback", &[scene, caches, &layout])?;
        let (counters, ring) = (counters(context, 0)?, Vec::new());
        Ok(Self {
            pipeline,
            layout,
            counters,
            ring,
        })
    }

    /// Makes room for this many counters. Votes on their way back are forgotten.
    pub(super) fn resize(&mut self, context: &Context, votes: u32) -> Result<()> {
        self.counters = counters(context, votes)?;
        self.ring = (0..RING)
            .map(|_| Staging {
                buffer: context.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("votes read back"),
                    size: self.counters.size(),
                    usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                    mapped_at_creation: false,
                }),
                state: Arc::default(),
                tag: 0,
            })
            .collect();
        Ok(())
    }

    pub(super) fn bind(&self, context: &Context, targets: &Targets) -> wgpu::BindGroup {
        let visibility = wgpu::BindingResource::TextureView(&targets.visibility.view);
        bind::group(
            context,
            "feedback",
            &self.layout,
            &[visibility, self.counters.as_entire_binding()],
        )
    }

    /// A staging buffer that is free.
    pub(super) fn free(&self) -> Option<usize> {
        self.ring
            .iter()
            .position(|staging| staging.state.load(Ordering::Acquire) == FREE)
    }

    /// Counts, and copies to a free staging buffer. `size` is that of the picture in feedback cells.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        size: (u32, u32),
        groups: [&wgpu::BindGroup; 3],
        staging: usize,
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        encoder.clear_buffer(&self.counters, 0, None);
        bind::dispatch(
            encoder,
            "feedback",
            &self.pipeline,
            groups,
            size,
            timestamp_writes,
        );
        encoder.copy_buffer_to_buffer(
            &self.counters,
            0,
            &self.ring[staging].buffer,
            0,
            self.counters.size(),
        );
    }

    /// After submission: asks for the counts.
    pub(super) fn map(&mut self, staging: usize, tag: u64) {
        let Staging {
            buffer,
            state,
            tag: kept,
        } = &mut self.ring[staging];
        *kept = tag;
        state.store(PENDING, Ordering::Release);
        let state = state.clone();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            state.store(if result.is_ok() { READY } else { LOST }, Ordering::Release);
        });
    }

    /// Whether votes are on their way.
    pub(super) fn pending(&self) -> bool {
        self.ring
            .iter()
            .any(|staging| staging.state.load(Ordering::Acquire) == PENDING)
    }

    /// All votes that have arrived, the oldest tag first. Lost ones are forgotten.
    pub(super) fn poll(&mut self) -> Vec<Counted> {
        let mut all = Vec::new();
        for staging in &self.ring {
            match staging.state.load(Ordering::Acquire) {
                READY => {
                    if let Ok(bytes) = staging.buffer.get_mapped_range(..) {
                        let counts: &[u32] = bytemuck::cast_slice(&bytes);
                        let votes = (0..)
                            .zip(counts.iter().copied())
                            .filter(|&(_, count)| count > 0)
                            .collect();
                        all.push(Counted {
                            tag: staging.tag,
                            votes,
                        });
                    }
                    staging.buffer.unmap();
                }
                LOST => {}
                _ => continue,
            }
            staging.state.store(FREE, Ordering::Release);
        }
        all.sort_by_key(|counted| counted.tag);
        all
    }

    pub(super) fn bytes(&self) -> u64 {
        self.counters.size() * (1 + self.ring.len() as u64)
    }
}

fn counters(context: &Context, votes: u32) -> Result<wgpu::Buffer> {
    bind::storage(context, "votes", &vec![0u32; votes as usize])
}
