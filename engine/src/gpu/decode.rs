//! The decoding pass: pages from their coefficients and their parents in the page cache.
//!
//! Workers do what is serial, entropy decoding ([`Coefficients`]); here each block of 16×16 texels is a workgroup.
//! A coarser page may be new as well and must be there first: one round a mip, from coarse to fine, of three dispatches,
//! for no pass may read and write one texture: blocks and borders into a buffer, the buffer into the cache. Borders are
//! what the decoder of tileset makes them, until [`super::stitch`] knows better. Only for caches of half floats: children are
//! coded against their exact parents.

use std::collections::HashSet;

use glam::UVec2;
use shaders::mirror;
use tileset::{
    PAGE_TEXELS, PageId, SLOT_AREA,
    codec::pyramid_dct::{Coefficients, matrices},
};

use crate::{
    Result,
    gpu::{
        Context,
        bind::{self, Binding},
        page_cache::{self, PageCache},
        page_format::PageFormat,
        page_table::PageTable,
        timers::{Pass, Timers},
    },
};

/// Pages of a round: their words and texels take 3 MB.
const ROUND_PAGES: usize = 32;
/// Blocks of a full page.
const PAGE_BLOCKS: u32 = (PAGE_TEXELS / 16).pow(2);
/// Workgroups of 256 that take each texel of a slot once.
const SLOT_WORKGROUPS: u32 = (SLOT_AREA as u32).div_ceil(256);

/// A page that waits to be decoded into the slot at an address.
pub(super) struct Waiting {
    pub(super) btf: usize,
    pub(super) page: PageId,
    pub(super) address: u32,
    pub(super) coefficients: Coefficients,
}

/// The pass.
pub(super) struct Decode {
    block: wgpu::ComputePipeline,
    border: wgpu::ComputePipeline,
    store: wgpu::ComputePipeline,
    read_layout: wgpu::BindGroupLayout,
    write_layout: wgpu::BindGroupLayout,
    pages: wgpu::Buffer,
    words: wgpu::Buffer,
    basis: wgpu::Buffer,
    texels: wgpu::Buffer,
}

impl Decode {
    pub(super) fn new(context: &Context) -> Result<Self> {
        let layout = |label, texture| {
            let storage = Binding::Storage;
            let bindings = [storage, storage, storage, Binding::Counters, texture];
            bind::layout(context, label, wgpu::ShaderStages::COMPUTE, &bindings)
        };
        let read_layout = layout("decode", Binding::Layers);
        let write_layout = layout("decode store", Binding::Slots(PageFormat::Half.texture()));
        let module = bind::module(context, "decode")?;
        let pipeline = |name, layout| bind::pipeline(context, &module, name, &[layout]);
        let buffer =
            |label, bytes: usize| bind::zeros(context, label, bytes as u64, wgpu::BufferUsages::empty());
        Ok(Self {
            block: pipeline("decode_block", &read_layout),
            border: pipeline("decode_border", &read_layout),
            store: pipeline("decode_store", &write_layout),
            read_layout,
            write_layout,
            pages: buffer("pages to decode", ROUND_PAGES * size_of::<mirror::DecodedPage>())?,
            words: buffer("coefficients", ROUND_PAGES * Coefficients::MAX_WORDS * 4)?,
            basis: bind::storage(context, "cosines", matrices())?,
            texels: buffer("decoded texels", ROUND_PAGES * SLOT_AREA * 8)?,
        })
    }

    /// Decodes what is still to be where it waits, after all that has been written to the queue so far.
    pub(super) fn run(
        &self,
        context: &Context,
        cache: &PageCache,
        table: &PageTable,
        waiting: Vec<Waiting>,
        mut timers: Option<&mut Timers>,
    ) {
        let waiting = in_order(table, waiting);
        if waiting.is_empty() {
            return;
        }
        let group = |label, layout| {
            let buffers = [&self.pages, &self.words, &self.basis, &self.texels];
            let mut resources = buffers.map(wgpu::Buffer::as_entire_binding).to_vec();
            resources.push(wgpu::BindingResource::TextureView(&cache.view));
            bind::group(context, label, layout, &resources)
        };
        let read = group("decode", &self.read_layout);
        let write = group("decode store", &self.write_layout);
        let mips = waiting.chunk_by(|(a, _), (b, _)| a.page.tile.mip == b.page.tile.mip);
        let rounds: Vec<_> = mips.flat_map(|mip| mip.chunks(ROUND_PAGES)).collect();
        for (at, round) in rounds.iter().enumerate() {
            let (pages, words) = pack(round);
            let queue = &context.queue;
            queue.write_buffer(&self.pages, 0, bytemuck::cast_slice(&pages));
            queue.write_buffer(&self.words, 0, bytemuck::cast_slice(&words));
            let mut encoder = context.device.create_command_encoder(&Default::default());
            let timestamps = timers
                .as_mut()
                .and_then(|timers| timers.round(Pass::Decode, at == 0, at + 1 == rounds.len()));
            let mut pass = bind::pass(&mut encoder, "decode", timestamps);
            for (pipeline, group, workgroups) in [
                (&self.block, &read, PAGE_BLOCKS),
                (&self.border, &read, SLOT_WORKGROUPS),
                (&self.store, &write, SLOT_WORKGROUPS),
            ] {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, group, &[]);
                pass.dispatch_workgroups(workgroups, pages.len() as u32, 1);
            }
            drop(pass);
            queue.submit([encoder.finish()]);
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        self.pages.size() + self.words.size() + self.basis.size() + self.texels.size()
    }
}

/// Coarse to fine, with the addresses of the parents; without what has been removed or replaced meanwhile.
fn in_order(table: &PageTable, waiting: Vec<Waiting>) -> Vec<(Waiting, u32)> {
    let mut slots = HashSet::new();
    let latest = waiting
        .into_iter()
        .rev()
        .filter(|new| table.page(new.btf, new.page) == Some(new.address) && slots.insert(new.address));
    let mut waiting: Vec<_> = latest
        .filter_map(|new| {
            let parent = parent(table, new.btf, new.page)?;
            Some((new, parent))
        })
        .collect();
    waiting.sort_by_key(|(new, _)| std::cmp::Reverse(new.page.tile.mip));
    waiting
}

/// The address of a page's parent, if it is resident.
pub(super) fn parent(table: &PageTable, btf: usize, page: PageId) -> Option<u32> {
    let tile = table.pyramid(btf).parent(page.tile)?;
    table.page(btf, PageId { tile, ..page })
}

/// What a round hands to the GPU.
fn pack(round: &[(Waiting, u32)]) -> (Vec<mirror::DecodedPage>, Vec<u32>) {
    let mut words = Vec::new();
    let pages = round.iter().map(|(new, parent)| {
        let Coefficients {
            size,
            parent_origin,
            ends,
            step,
            ..
        } = new.coefficients;
        let (slot, layer) = page_cache::origin(new.address);
        let (parent, parent_layer) = page_cache::origin(*parent);
        let first = words.len() as u32;
        words.extend(&new.coefficients.words);
        mirror::DecodedPage {
            slot,
            parent: parent + UVec2::from(parent_origin),
            size: size.into(),
            ends: UVec2::from(ends.map(|[before, behind]| u32::from(before) | u32::from(behind) << 1)),
            layer,
            parent_layer,
            words: first,
            step,
        }
    });
    (pages.collect(), words)
}
