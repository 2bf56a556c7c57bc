//! The stitching pass: borders of cached pages from the payloads of their neighbours.
//!
//! Records hold no borders. A decoded page's border is a guess until the neighbours are resident: then each page that
//! comes takes its border from the resident pages around it and gives its edges to theirs ([`super::borders`]). What
//! has been taken stays when the neighbour goes; what lies behind a missing neighbour stays as the decoder left it.
//!
//! Two dispatches for hundreds of strips, not two copies a strip: graphics APIs put a barrier between any two copies
//! into one texture. Payloads are only read and borders only written, so strips may be split over rounds in any way.
//! Where slots have scales, texels change over from one to the other; `gpu::slot_scales` sees to it that they fit.

use glam::{UVec2, Vec4};
use shaders::mirror;
use tileset::PageId;

use crate::{
    Result,
    gpu::{
        Context,
        bind::{self, Binding},
        borders::{Known, Strip},
        page_cache::{self, PageCache},
        page_format::PageFormat,
        page_table::PageTable,
        timers::{Pass, Timers},
    },
};

/// Texels that wait between the two dispatches of a round: 1 MiB, what some 30 pages take and give.
const STAGING_TEXELS: u32 = 1 << 16;
const STAGING_TEXEL_BYTES: u64 = 16;
/// Strips of a round; as many texels on average fill the staging buffer with room to spare.
const ROUND_STRIPS: usize = 1 << 10;

/// The strips between pages that were placed since the last time and all that are resident, as BTF and strip's place
/// in the cache: each strip once, in an order that follows from the pages alone.
///
/// `placed` may hold pages that are gone again, or twice.
pub fn strips(table: &PageTable, known: &mut Known, mut placed: Vec<(usize, PageId)>) -> Vec<mirror::Strip> {
    placed.sort_unstable();
    placed.dedup();
    placed.retain(|&(btf, page)| table.page(btf, page).is_some());
    let mut strips = Vec::new();
    for &(btf, page) in &placed {
        let pyramid = table.pyramid(btf);
        let here = |tile| PageId {
            group: page.group,
            tile,
        };
        // What a new page takes covers what new pages give each other.
        let around = known.around(&pyramid, page.tile);
        let given = around.out_of.iter();
        let given = given.filter(|strip| placed.binary_search(&(btf, here(strip.destination))).is_err());
        for &strip in around.into.iter().chain(given) {
            let source = table.page(btf, here(strip.source));
            let destination = table.page(btf, here(strip.destination));
            if let (Some(source), Some(destination)) = (source, destination) {
                strips.push(pack(strip, source, destination));
            }
        }
    }
    strips
}

/// The strips that fill the border of a resident page, from all that are resident.
pub(super) fn strips_into(
    table: &PageTable,
    known: &mut Known,
    btf: usize,
    page: PageId,
) -> Vec<mirror::Strip> {
    let strips = known.around(&table.pyramid(btf), page.tile).into.iter();
    let packed = strips.filter_map(|&strip| {
        let address = |tile| table.page(btf, PageId { tile, ..page });
        Some(pack(strip, address(strip.source)?, address(strip.destination)?))
    });
    packed.collect()
}

/// A strip between two slots, given by their addresses.
fn pack(strip: Strip, source: u32, destination: u32) -> mirror::Strip {
    let (source, source_layer) = page_cache::origin(source);
    let (destination, destination_layer) = page_cache::origin(destination);
    mirror::Strip {
        source: source + UVec2::from(strip.from),
        destination: destination + UVec2::from(strip.to),
        size: strip.size.into(),
        step: strip.step.into(),
        source_layer,
        destination_layer,
        ratio: Vec4::ONE,
        ..Default::default()
    }
}

/// The pass.
pub(super) struct Stitch {
    gather: wgpu::ComputePipeline,
    scatter: wgpu::ComputePipeline,
    gather_layout: wgpu::BindGroupLayout,
    scatter_layout: wgpu::BindGroupLayout,
    strips: wgpu::Buffer,
    staging: wgpu::Buffer,
}

/// Its bind groups.
pub(super) struct StitchGroups {
    gather: wgpu::BindGroup,
    scatter: wgpu::BindGroup,
}

impl Stitch {
    /// For caches of this format.
    pub(super) fn new(context: &Context, format: PageFormat) -> Result<Self> {
        let layout = |label, texture| {
            let bindings = [Binding::Storage, Binding::Counters, texture];
            bind::layout(context, label, wgpu::ShaderStages::COMPUTE, &bindings)
        };
        let gather_layout = layout("stitch gather", Binding::Layers);
        let scatter_layout = layout("stitch scatter", Binding::Slots(format.texture()));
        let module = bind::variant(context, "stitch", &[("slots", format.shader())])?;
        let buffer = |label, size, usage| {
            context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usage;
        Ok(Self {
            gather: bind::pipeline(context, &module, "stitch_gather", &[&gather_layout]),
            scatter: bind::pipeline(context, &module, "stitch_scatter", &[&scatter_layout]),
            gather_layout,
            scatter_layout,
            strips: buffer(
                "strips",
                (ROUND_STRIPS * size_of::<mirror::Strip>()) as u64,
                Usage::STORAGE | Usage::COPY_DST,
            ),
            staging: buffer(
                "stitched texels",
                u64::from(STAGING_TEXELS) * STAGING_TEXEL_BYTES,
                Usage::STORAGE,
            ),
        })
    }

    pub(super) fn bind(&self, context: &Context, pages: &PageCache) -> StitchGroups {
        let group = |label, layout, view| {
            let resources = [
                self.strips.as_entire_binding(),
                self.staging.as_entire_binding(),
                wgpu::BindingResource::TextureView(view),
            ];
            bind::group(context, label, layout, &resources)
        };
        StitchGroups {
            gather: group("stitch gather", &self.gather_layout, &pages.view),
            scatter: group("stitch scatter", &self.scatter_layout, &pages.view),
        }
    }

    /// Copies, after all that has been written to the queue so far. Returns how many texels.
    pub(super) fn run(
        &self,
        context: &Context,
        groups: &StitchGroups,
        mut strips: &[mirror::Strip],
        mut timers: Option<&mut Timers>,
    ) -> u64 {
        let mut all_texels = 0;
        while !strips.is_empty() {
            let (round, texels) = round(strips);
            strips = &strips[round.len()..];
            let (first, last) = (all_texels == 0, strips.is_empty());
            all_texels += u64::from(texels);
            context
                .queue
                .write_buffer(&self.strips, 0, bytemuck::cast_slice(&round));
            let mut encoder = context.device.create_command_encoder(&Default::default());
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("stitch"),
                timestamp_writes: timers
                    .as_mut()
                    .and_then(|timers| timers.round(Pass::Stitch, first, last)),
            });
            for (pipeline, group) in [(&self.gather, &groups.gather), (&self.scatter, &groups.scatter)] {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, group, &[]);
                pass.dispatch_workgroups(round.len() as u32, 1, 1);
            }
            drop(pass);
            context.queue.submit([encoder.finish()]);
        }
        all_texels
    }

    pub(super) fn bytes(&self) -> u64 {
        self.strips.size() + self.staging.size()
    }
}

/// The first strips, as many as one round takes, with their places in the staging buffer; and their texels. Never
/// none: a strip lies in a slot.
fn round(strips: &[mirror::Strip]) -> (Vec<mirror::Strip>, u32) {
    let mut texels = 0;
    let mut round = Vec::with_capacity(strips.len().min(ROUND_STRIPS));
    for strip in strips.iter().take(ROUND_STRIPS) {
        let area = strip.size.x * strip.size.y;
        if texels + area > STAGING_TEXELS {
            break;
        }
        round.push(mirror::Strip {
            staging: texels,
            ..*strip
        });
        texels += area;
    }
    (round, texels)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use tileset::{Pyramid, Tile};

    use super::*;
    use crate::gpu::page_table::Region;

    fn table() -> PageTable {
        let pyramid = Pyramid::new(256, 256, true).unwrap();
        let region = |base| Region {
            base,
            groups: 2,
            pyramid,
        };
        let words = Region::words(2, pyramid.tile_count()) as u32;
        let mut table = PageTable::default();
        table.add(region(0), &[]);
        table.add(region(words), &[]);
        table
    }

    fn page(group: u16, x: u16, y: u16) -> PageId {
        PageId {
            group,
            tile: Tile { mip: 0, x, y },
        }
    }

    fn places(strips: &[mirror::Strip]) -> BTreeSet<([u32; 2], u32)> {
        strips
            .iter()
            .map(|strip| (strip.destination.into(), strip.destination_layer))
            .collect()
    }

    #[test]
    fn strips_join_resident_pages_of_one_group_once() {
        let mut table = table();
        // Layer 0, row 0: four neighbours, one of another BTF, one of another group.
        for (column, (btf, page)) in (0..).zip([
            (1, page(0, 0, 0)),
            (1, page(0, 1, 0)),
            (1, page(0, 0, 1)),
            (1, page(0, 1, 1)),
            (0, page(0, 0, 0)),
            (1, page(1, 1, 0)),
        ]) {
            table.insert(btf, page, column);
        }
        let all = vec![
            (1, page(0, 0, 0)),
            (1, page(0, 1, 0)),
            (1, page(0, 0, 1)),
            (1, page(0, 1, 1)),
        ];
        let mut known = Known::default();
        let strips = strips(&table, &mut known, all.clone());
        // Each of the four has three of its eight neighbours.
        assert_eq!((strips.len(), places(&strips).len()), (12, 12));
        assert!(
            strips
                .iter()
                .all(|strip| strip.source.x < 4 * 72 && strip.destination.x < 4 * 72)
        );
        // Told twice, or of a page that is gone, the same.
        let again = [all, vec![(1, page(0, 0, 0)), (1, page(0, 3, 3))]].concat();
        assert_eq!(super::strips(&table, &mut known, again).len(), 12);
        // The last of them alone: takes three, gives three.
        let last = super::strips(&table, &mut known, vec![(1, page(0, 1, 1))]);
        assert_eq!(last.len(), 6);
        assert_eq!(
            last.iter().filter(|strip| strip.destination.x / 72 == 3).count(),
            3
        );
        table.remove(1, page(0, 1, 1));
        assert!(super::strips(&table, &mut known, vec![(1, page(0, 1, 1))]).is_empty());
    }

    #[test]
    fn rounds_take_all_strips_and_keep_to_their_buffers() {
        for (side, count) in [(1, 5000), (16, 1000), (72, 40)] {
            let all = vec![
                mirror::Strip {
                    size: UVec2::splat(side),
                    ..Default::default()
                };
                count
            ];
            let mut rest = &all[..];
            while !rest.is_empty() {
                let (round, texels) = round(rest);
                assert!(!round.is_empty() && round.len() <= ROUND_STRIPS && texels <= STAGING_TEXELS);
                for (place, strip) in (0..).zip(&round) {
                    assert_eq!(strip.staging, place * side * side);
                }
                assert_eq!(texels, round.len() as u32 * side * side);
                rest = &rest[round.len()..];
            }
        }
    }
}
