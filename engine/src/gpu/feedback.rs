//! The feedback pass: votes for tiles, counted and compacted on the GPU and read back without waiting.
//!
//! The list of pairs on the GPU has room for every counter. Of it as many are read back as the last time were there, and
//! some more. Where there are more than that, the answer does not say which tiles are missing: it counts as lost, so that
//! what comes back does not depend on the order in which the GPU works, and the next one is read in full.
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
        targets::Ids,
    },
};

/// Votes that may be on their way back at once; further ones are not asked for.
const RING: usize = 3;
/// Of which votes ahead leave this many free for others.
const KEPT_FREE: usize = 1;

/// States of a staging buffer.
const FREE: u8 = 0;
const PENDING: u8 = 1;
const READY: u8 = 2;
const LOST: u8 = 3;

/// Bytes of the number of pairs, and of a pair.
const HEADER_BYTES: u64 = 8;
const PAIR_BYTES: u64 = 8;
/// Pairs that are read back before it is known how many there are.
const FIRST_PAIRS: u32 = 4096;
/// Pairs are read back in multiples of this.
const PAIRS_STEP: u32 = 256;
/// Most workgroups that compact; each goes on until all counters are done.
const MOST_WORKGROUPS: u32 = 1024;
const COMPACT_WORKGROUP: u32 = 256;

/// Votes that came back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Counted {
    /// What [`super::Renderer::look`] or [`super::Renderer::look_ahead`] was told to remember about them.
    pub tag: u64,
    /// Whether they are for a camera that is not shown.
    pub ahead: bool,
    /// Counters that are not zero by index, with the pixels of the picture that want them.
    pub votes: Vec<(u32, u32)>,
}

/// What is known of votes when they are asked for.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Asked {
    pub(super) tag: u64,
    pub(super) ahead: bool,
    /// Pixels of the picture for each that voted.
    pub(super) pixels: u32,
}

struct Staging {
    buffer: wgpu::Buffer,
    state: Arc<AtomicU8>,
    asked: Asked,
    /// Pairs that are copied.
    pairs: u32,
}

/// The pass.
pub(super) struct Feedback {
    count: wgpu::ComputePipeline,
    count_layout: wgpu::BindGroupLayout,
    compact: wgpu::ComputePipeline,
    compact_layout: wgpu::BindGroupLayout,
    compact_group: wgpu::BindGroup,
    counters: wgpu::Buffer,
    pairs: wgpu::Buffer,
    ring: Vec<Staging>,
    /// Pairs to read back the next time, of a picture and ahead.
    expected: [u32; 2],
    bytes_read: u64,
}

impl Feedback {
    pub(super) fn new(
        context: &Context,
        scene: &wgpu::BindGroupLayout,
        caches: &wgpu::BindGroupLayout,
    ) -> Result<Self> {
        let layout =
            |label, bindings: &[Binding]| bind::layout(context, label, wgpu::ShaderStages::COMPUTE, bindings);
        let count_layout = layout("feedback", &[Binding::Integers, Binding::Counters]);
        let compact_layout = layout("compact", &[Binding::Counters; 2]);
        let (counters, pairs) = buffers(context, 0)?;
        Ok(Self {
            count: bind::compute(context, "feedback", &[scene, caches, &count_layout])?,
            count_layout,
            compact: bind::compute(context, "compact", &[&compact_layout])?,
            compact_group: compact_group(context, &compact_layout, &counters, &pairs),
            compact_layout,
            counters,
            pairs,
            ring: Vec::new(),
            expected: [0; 2],
            bytes_read: 0,
        })
    }

    /// Makes room for this many counters. Votes on their way back are forgotten.
    pub(super) fn resize(&mut self, context: &Context, votes: u32) -> Result<()> {
        (self.counters, self.pairs) = buffers(context, votes)?;
        self.compact_group = compact_group(context, &self.compact_layout, &self.counters, &self.pairs);
        self.expected = [FIRST_PAIRS.min(votes); 2];
        self.ring = (0..RING)
            .map(|_| Staging {
                buffer: staging_buffer(context, self.expected[0]),
                state: Arc::default(),
                asked: Asked::default(),
                pairs: 0,
            })
            .collect();
        Ok(())
    }

    pub(super) fn bind(&self, context: &Context, ids: &Ids) -> wgpu::BindGroup {
        let visibility = wgpu::BindingResource::TextureView(&ids.visibility.view);
        bind::group(
            context,
            "feedback",
            &self.count_layout,
            &[visibility, self.counters.as_entire_binding()],
        )
    }

    /// A staging buffer that is free.
    pub(super) fn free(&self, ahead: bool) -> Option<usize> {
        let mut free =
            (0..self.ring.len()).filter(|&staging| self.ring[staging].state.load(Ordering::Acquire) == FREE);
        free.nth(if ahead { KEPT_FREE } else { 0 })
    }

    /// Counts, compacts, and copies to a free staging buffer. `size` is that of the picture in feedback cells.
    pub(super) fn encode(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        size: (u32, u32),
        groups: [&wgpu::BindGroup; 3],
        (staging, asked): (usize, Asked),
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
    ) {
        encoder.clear_buffer(&self.pairs, 0, Some(HEADER_BYTES));
        let mut pass = bind::pass(encoder, "feedback", timestamp_writes);
        bind::dispatch(&mut pass, &self.count, &groups, size);
        pass.set_pipeline(&self.compact);
        pass.set_bind_group(0, &self.compact_group, &[]);
        let workgroups = self.counter_count().div_ceil(COMPACT_WORKGROUP);
        pass.dispatch_workgroups(workgroups.min(MOST_WORKGROUPS), 1, 1);
        drop(pass);
        let (staging, pairs) = (&mut self.ring[staging], self.expected[usize::from(asked.ahead)]);
        (staging.asked, staging.pairs) = (asked, pairs);
        let bytes = HEADER_BYTES + u64::from(pairs) * PAIR_BYTES;
        if staging.buffer.size() < bytes {
            staging.buffer = staging_buffer(context, pairs);
        }
        encoder.copy_buffer_to_buffer(&self.pairs, 0, &staging.buffer, 0, bytes);
        self.bytes_read += bytes;
    }

    /// After submission: asks for the pairs.
    pub(super) fn map(&mut self, staging: usize) {
        let Staging {
            buffer, state, pairs, ..
        } = &self.ring[staging];
        state.store(PENDING, Ordering::Release);
        let state = state.clone();
        let bytes = HEADER_BYTES + u64::from(*pairs) * PAIR_BYTES;
        buffer.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
            state.store(if result.is_ok() { READY } else { LOST }, Ordering::Release);
        });
    }

    /// Whether votes for what is shown are on their way.
    pub(super) fn pending(&self) -> bool {
        self.ring
            .iter()
            .any(|staging| !staging.asked.ahead && staging.state.load(Ordering::Acquire) == PENDING)
    }

    /// All votes that have arrived, the oldest tag first, by index. Lost ones are forgotten.
    pub(super) fn poll(&mut self) -> Vec<Counted> {
        let counters = self.counter_count();
        let mut all = Vec::new();
        for staging in &mut self.ring {
            match staging.state.load(Ordering::Acquire) {
                READY => {
                    let bytes = HEADER_BYTES + u64::from(staging.pairs) * PAIR_BYTES;
                    if let Ok(bytes) = staging.buffer.get_mapped_range(..bytes) {
                        let words: &[[u32; 2]] = bytemuck::cast_slice(&bytes);
                        let count = words[0][0].min(counters);
                        self.expected[usize::from(staging.asked.ahead)] = expect(count, counters);
                        if count <= staging.pairs {
                            all.push(counted(staging.asked, &words[1..][..count as usize]));
                        }
                    }
                    staging.buffer.unmap();
                }
                LOST => {}
                _ => continue,
            }
            staging.state.store(FREE, Ordering::Release);
        }
        all.sort_by_key(|counted| (counted.ahead, counted.tag));
        all
    }

    fn counter_count(&self) -> u32 {
        ((self.pairs.size() - HEADER_BYTES) / PAIR_BYTES) as u32
    }

    /// Bytes read back since the start.
    pub(super) fn bytes_read(&self) -> u64 {
        self.bytes_read
    }

    pub(super) fn bytes(&self) -> u64 {
        let ring = self.ring.iter().map(|staging| staging.buffer.size());
        self.counters.size() + self.pairs.size() + ring.sum::<u64>()
    }
}

/// Pairs to read where there were `count` before: a quarter more.
fn expect(count: u32, counters: u32) -> u32 {
    let more = u64::from(count) + u64::from(count) / 4 + 1;
    more.next_multiple_of(PAIRS_STEP.into()).min(counters.into()) as u32
}

fn counted(asked: Asked, pairs: &[[u32; 2]]) -> Counted {
    let mut votes: Vec<_> = pairs
        .iter()
        .map(|&[counter, votes]| (counter, votes.saturating_mul(asked.pixels)))
        .collect();
    votes.sort_unstable();
    Counted {
        tag: asked.tag,
        ahead: asked.ahead,
        votes,
    }
}

fn buffers(context: &Context, votes: u32) -> Result<(wgpu::Buffer, wgpu::Buffer)> {
    let votes = u64::from(votes);
    let pairs = HEADER_BYTES + votes * PAIR_BYTES;
    Ok((
        bind::zeros(context, "votes", votes * 4, wgpu::BufferUsages::empty())?,
        bind::zeros(context, "pairs of votes", pairs, wgpu::BufferUsages::COPY_SRC)?,
    ))
}

fn compact_group(
    context: &Context,
    layout: &wgpu::BindGroupLayout,
    counters: &wgpu::Buffer,
    pairs: &wgpu::Buffer,
) -> wgpu::BindGroup {
    let resources = [counters.as_entire_binding(), pairs.as_entire_binding()];
    bind::group(context, "compact", layout, &resources)
}

fn staging_buffer(context: &Context, pairs: u32) -> wgpu::Buffer {
    context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("votes read back"),
        size: HEADER_BYTES + u64::from(pairs) * PAIR_BYTES,
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    })
}
