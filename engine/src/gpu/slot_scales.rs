//! The scales of slots that hold bytes: what each slot has to hold, and who changes it.
//!
//! A page's scale covers its payload, the border that the decoder guessed, and the edges of the neighbours that are there:
//! borders are stitched from those, and a clamped border would show as a seam. A neighbour that comes later with larger
//! values raises the scale; then the texels are rounded once more, on the GPU, which the error of the slot counts.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use glam::{UVec2, Vec4};
use half::f16;
use shaders::mirror;
use tileset::{BORDER_TEXELS, Page, SLOT_AREA, SLOT_TEXELS};

use super::{
    context::Context,
    page_cache::{self, Grid},
    page_format::{self, rounding_mse},
    uploads::Uploads,
};
use crate::residency::Slot;

/// Slots in a row of the texture of scales; see `pages.wgsl`.
const ROW: u32 = 256;
/// Largest scale: decoders make no larger values.
const HALF_MAX: f32 = 65504.0;

/// By component.
type Scale = [f32; 4];

/// What is known of the page in a slot.
#[derive(Clone, Copy, Debug, Default)]
struct Held {
    scale: Scale,
    /// Texels of the payload.
    size: UVec2,
    /// Largest magnitudes of the payload's first four columns, its last four columns, first four rows, last four rows.
    edges: [Scale; 4],
    /// Of the whole payload.
    largest: Scale,
    /// Mean squared error of what rounding has done, summed over components.
    mse: f64,
}

/// A page that has been rounded by itself, by whoever has time for that: where no neighbour is stronger, its bytes are used as they are.
pub struct Rounded {
    page: Arc<Page>,
    held: Held,
    bytes: Vec<i8>,
}

impl Rounded {
    /// Bytes that it takes beside the page.
    pub const BYTES: u64 = SLOT_AREA as u64 * 4;

    /// Rounds a page with a payload of this size.
    pub fn new(page: Arc<Page>, size: (u32, u32)) -> Self {
        let floats = page_format::floats(&page);
        let held = held(&floats, size.into());
        let bytes = page_format::bytes(&floats, held.scale);
        Self { page, held, bytes }
    }

    /// The page as it was.
    pub fn page(&self) -> &Page {
        &self.page
    }
}

/// The scales on the host and on the GPU.
pub(super) struct SlotScales {
    slots: Vec<Held>,
    changed_rows: BTreeSet<u32>,
    texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

impl SlotScales {
    /// For a cache of so many slots, in none of which there is a page; of none if slots have no scales.
    pub(super) fn new(context: &Context, slots: u32) -> Self {
        let texture = context.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("scales of slots"),
            size: wgpu::Extent3d {
                width: ROW,
                height: slots.div_ceil(ROW).max(1),
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        Self {
            slots: vec![Held::default(); slots as usize],
            changed_rows: BTreeSet::new(),
            view: texture.create_view(&Default::default()),
            texture,
        }
    }

    /// For a cache of another number of slots, to which pages have moved from slot to slot; those without scales stay so.
    pub(super) fn moved(&self, context: &Context, slots: u32, moves: &[(Slot, Slot)]) -> Self {
        let mut moved = Self::new(context, slots);
        for (from, to) in moves {
            let places = (
                self.slots.get(from.0 as usize),
                moved.slots.get_mut(to.0 as usize),
            );
            if let (Some(from), Some(place)) = places {
                *place = *from;
                moved.changed_rows.insert(to.0 / ROW);
            }
        }
        moved
    }

    /// Takes a new page; `strips` are those that are going to fill its border. Returns its bytes, rounded again where neighbours
    /// bring more than the page itself has.
    pub(super) fn place(
        &mut self,
        grid: Grid,
        slot: Slot,
        rounded: Rounded,
        strips: &[mirror::Strip],
    ) -> Vec<i8> {
        let mut held = rounded.held;
        // What is behind a wrapped edge may be the page itself.
        self.slots[slot.0 as usize] = held;
        for strip in strips {
            held.scale = larger(held.scale, self.bound(grid, strip));
        }
        held.mse = held.scale.into_iter().map(rounding_mse).sum();
        self.slots[slot.0 as usize] = held;
        self.changed_rows.insert(slot.0 / ROW);
        if held.scale == rounded.held.scale {
            return rounded.bytes;
        }
        page_format::bytes(&page_format::floats(&rounded.page), held.scale)
    }

    /// Gives strips the ratios of the scales at their ends. Where a strip brings more than its destination holds, the
    /// destination gets a larger scale: returned are the strips that change its texels over, to be run before all others.
    pub(super) fn fit(&mut self, grid: Grid, strips: &mut [mirror::Strip]) -> Vec<mirror::Strip> {
        let mut before = BTreeMap::new();
        for strip in &*strips {
            let needed = self.bound(grid, strip);
            let slot = grid.slot_of(strip.destination, strip.destination_layer);
            let held = &mut self.slots[slot.0 as usize];
            let raised = larger(held.scale, needed);
            if raised != held.scale {
                before.entry(slot).or_insert(held.scale);
                held.scale = raised;
            }
        }
        let raised = before.into_iter().map(|(slot, before)| {
            let held = &mut self.slots[slot.0 as usize];
            let rounded = held.scale.into_iter().zip(before);
            let rounded = rounded.filter(|(now, before)| now != before);
            held.mse += rounded.map(|(now, _)| rounding_mse(now)).sum::<f64>();
            self.changed_rows.insert(slot.0 / ROW);
            let (origin, layer) = page_cache::origin(grid.address(slot));
            mirror::Strip {
                source: origin,
                destination: origin,
                size: UVec2::splat(SLOT_TEXELS),
                step: UVec2::ONE,
                source_layer: layer,
                destination_layer: layer,
                ratio: ratio(before, held.scale),
                ..Default::default()
            }
        });
        let raised = raised.collect();
        for strip in strips {
            let scale = |texel, layer| self.slots[grid.slot_of(texel, layer).0 as usize].scale;
            strip.ratio = ratio(
                scale(strip.source, strip.source_layer),
                scale(strip.destination, strip.destination_layer),
            );
        }
        raised
    }

    /// Largest magnitudes that a strip may bring.
    fn bound(&self, grid: Grid, strip: &mirror::Strip) -> Scale {
        let held = &self.slots[grid.slot_of(strip.source, strip.source_layer).0 as usize];
        let first = strip.source % SLOT_TEXELS;
        let end = first + (strip.size - 1) * strip.step + 1;
        let near = end.cmple(UVec2::splat(2 * BORDER_TEXELS));
        let far = first.cmpge(held.size);
        let inside = [near.x, far.x, near.y, far.y];
        let edges = held.edges.iter().zip(inside).filter(|(_, inside)| *inside);
        edges.fold(held.largest, |least, (edge, _)| {
            std::array::from_fn(|c| least[c].min(edge[c]))
        })
    }

    /// Writes what has changed.
    pub(super) fn flush(&mut self, context: &Context, uploads: &mut Uploads) {
        for row in std::mem::take(&mut self.changed_rows) {
            let first = (row * ROW) as usize;
            let slots = &self.slots[first..self.slots.len().min(first + ROW as usize)];
            let scales: Vec<Scale> = slots.iter().map(|held| held.scale).collect();
            uploads.write(
                context,
                &self.texture,
                wgpu::Origin3d { x: 0, y: row, z: 0 },
                (scales.len() as u32, 1),
                size_of_val(&*scales) as u32,
                bytemuck::cast_slice(&scales),
            );
        }
    }

    /// Texels of a slot from its bytes.
    pub(super) fn halves(&self, slot: Slot, bytes: &[u8]) -> Vec<[f16; 4]> {
        page_format::halves(bytes, self.slots[slot.0 as usize].scale)
    }

    /// Mean squared error of what rounding has done to a slot, summed over components; 0 where slots have no scales.
    pub(super) fn mse(&self, slot: Slot) -> f64 {
        self.slots.get(slot.0 as usize).map_or(0.0, |held| held.mse)
    }

    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.texture.width()) * u64::from(self.texture.height()) * 16
    }
}

/// What a slot's texels say of it.
fn held(floats: &[f32], size: UVec2) -> Held {
    let mut held = Held {
        size,
        ..Default::default()
    };
    for (y, row) in (0..).zip(floats.chunks_exact(SLOT_TEXELS as usize * 4)) {
        let inside = (BORDER_TEXELS..BORDER_TEXELS + size.y).contains(&y);
        let texels = |from: u32, to: u32| largest(&row[from as usize * 4..to as usize * 4]);
        if !inside {
            held.scale = larger(held.scale, texels(0, SLOT_TEXELS));
            continue;
        }
        let (first, end) = (BORDER_TEXELS, BORDER_TEXELS + size.x);
        let payload = texels(first, end);
        for border in [texels(0, first), texels(end, SLOT_TEXELS), payload] {
            held.scale = larger(held.scale, border);
        }
        held.largest = larger(held.largest, payload);
        let columns = [(first, end.min(2 * BORDER_TEXELS)), (first.max(size.x), end)];
        for (edge, (from, to)) in held.edges.iter_mut().zip(columns) {
            *edge = larger(*edge, texels(from, to));
        }
        for (edge, inside) in held.edges[2..]
            .iter_mut()
            .zip([y < 2 * BORDER_TEXELS, y >= size.y])
        {
            if inside {
                *edge = larger(*edge, payload);
            }
        }
    }
    let clamp = |scale: Scale| scale.map(|scale| scale.min(HALF_MAX));
    held.scale = clamp(held.scale);
    held.largest = clamp(held.largest);
    held.edges = held.edges.map(clamp);
    debug_assert_eq!(floats.len(), SLOT_AREA * 4);
    held
}

/// Largest magnitudes; what is no number counts for nothing.
fn largest(floats: &[f32]) -> Scale {
    let magnitude = |most: Scale, texel: &[f32]| std::array::from_fn(|c| most[c].max(texel[c].abs()));
    floats.chunks_exact(4).fold([0.0; 4], magnitude)
}

fn larger(a: Scale, b: Scale) -> Scale {
    std::array::from_fn(|c| a[c].max(b[c]))
}

fn ratio(from: Scale, to: Scale) -> Vec4 {
    let ratio = |c: usize| if to[c] > 0.0 { from[c] / to[c] } else { 0.0 };
    Vec4::new(ratio(0), ratio(1), ratio(2), ratio(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_the_payload_within_a_border_of_its_sides() {
        let value = |x: u32, y: u32, c: u32| ((x * 131 + y * 71 + c * 29) % 97) as f32 - 48.0;
        let floats: Vec<f32> = (0..SLOT_AREA as u32 * 4)
            .map(|at| value(at / 4 % SLOT_TEXELS, at / 4 / SLOT_TEXELS, at % 4))
            .collect();
        for size in [(64, 64), (1, 64), (6, 3), (64, 4)].map(UVec2::from) {
            let held = held(&floats, size);
            let most = |inside: &dyn Fn(u32, u32) -> bool| -> Scale {
                let places = (0..size.y).flat_map(|y| (0..size.x).map(move |x| (x, y)));
                places
                    .filter(|&(x, y)| inside(x, y))
                    .fold([0.0; 4], |most, (x, y)| {
                        std::array::from_fn(|c| most[c].max(value(x + 4, y + 4, c as u32).abs()))
                    })
            };
            assert_eq!(held.largest, most(&|_, _| true));
            assert_eq!(held.edges[0], most(&|x, _| x < 4), "{size}");
            assert_eq!(held.edges[1], most(&|x, _| x + 4 >= size.x), "{size}");
            assert_eq!(held.edges[2], most(&|_, y| y < 4), "{size}");
            assert_eq!(held.edges[3], most(&|_, y| y + 4 >= size.y), "{size}");
            // Of the whole slot.
            assert_eq!(held.scale, [48.0; 4]);
        }
        let odd = held(
            &[f32::NAN, f32::INFINITY, 6e-8, 0.0].repeat(SLOT_AREA),
            UVec2::splat(64),
        );
        assert_eq!(odd.scale, [0.0, HALF_MAX, 6e-8, 0.0]);
        assert_eq!(
            ratio([1.0, 2.0, 0.0, 0.0], [2.0, 1.0, 1.0, 0.0]),
            Vec4::new(0.5, 2.0, 0.0, 0.0)
        );
    }
}
