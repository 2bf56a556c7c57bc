//! The page cache: one texture array whose layers hold a grid of slots.

use glam::{UVec2, Vec2};
use tileset::SLOT_TEXELS;

use super::{page_format::PageFormat, uploads::Uploads};
use crate::{Error, Result, gpu::Context, residency::Slot};

/// Bytes of a slot of half floats.
pub const SLOT_BYTES: u64 = PageFormat::Half.slot_bytes();
/// Most layers, rows and columns that an entry of the page table can name; see `pages.wgsl`.
const MAX_LAYERS: u32 = 1 << 11;
const MAX_GRID: u32 = 1 << 8;

/// How slots are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Slots along the width of a layer.
    pub columns: u32,
    /// Slots along its height.
    pub rows: u32,
    /// Layers.
    pub layers: u32,
}

impl Grid {
    /// The grid that makes the most of `slots` slots, with sides up to `max_side` and up to `max_layers` layers.
    /// `None` if there is not one slot. Large numbers get layers of at least 8 × 8 slots, so that what adapters
    /// add to align a layer stays small; that leaves less than 1 % unused.
    pub fn new(slots: u64, max_side: u32, max_layers: u32) -> Option<Self> {
        let max_layers = max_layers.min(MAX_LAYERS);
        let max_side = (max_side / SLOT_TEXELS).min(MAX_GRID);
        let most = u64::from(max_side).pow(2) * u64::from(max_layers);
        let slots = slots.min(most);
        let least_side = if slots >= 64 * 128 { 8 } else { 1 };
        let large_side = ((slots.div_ceil(max_layers.into()) as f64).sqrt().ceil() as u32)
            .max(16)
            .min(max_side);
        let mut best: Option<Grid> = None;
        for rows in least_side.min(large_side)..=large_side {
            for columns in rows..=large_side {
                let layers = (slots / u64::from(rows * columns)).min(max_layers.into()) as u32;
                let grid = Grid {
                    columns,
                    rows,
                    layers,
                };
                if layers > 0 && best.is_none_or(|best| best.slots() <= grid.slots()) {
                    best = Some(grid);
                }
            }
        }
        best
    }

    /// Slots in all.
    pub fn slots(self) -> u32 {
        self.columns * self.rows * self.layers
    }

    /// Layer, row and column of a slot, as an entry of the page table names them.
    pub fn address(self, slot: Slot) -> u32 {
        let (layer, place) = (
            slot.0 / (self.columns * self.rows),
            slot.0 % (self.columns * self.rows),
        );
        (layer << 16) | ((place / self.columns) << 8) | (place % self.columns)
    }

    /// The slot at an address.
    pub fn slot(self, address: u32) -> Slot {
        let (layer, row, column) = (address >> 16, address >> 8 & 0xff, address & 0xff);
        Slot((layer * self.rows + row) * self.columns + column)
    }

    /// The slot in which a texel of a layer lies.
    pub fn slot_of(self, texel: UVec2, layer: u32) -> Slot {
        let place = texel / SLOT_TEXELS;
        Slot((layer * self.rows + place.y) * self.columns + place.x)
    }

    /// Slots from here on that lie beside each other, up to the end of the row.
    fn rest_of_row(self, slot: Slot) -> u32 {
        self.columns - slot.0 % self.columns
    }
}

/// The slot at an address; the inverse of [`Grid::address`].
pub fn slot(grid: Grid, address: u32) -> Slot {
    let (layer, row, column) = (address >> 16, address >> 8 & 0xff, address & 0xff);
    Slot((layer * grid.rows + row) * grid.columns + column)
}

/// First texel and layer of the slot at an address.
pub fn origin(address: u32) -> (UVec2, u32) {
    let (row, column) = (address >> 8 & 0xff, address & 0xff);
    (UVec2::new(column, row) * SLOT_TEXELS, address >> 16)
}

/// The texture.
pub(super) struct PageCache {
    pub(super) grid: Grid,
    pub(super) format: PageFormat,
    texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
    pub(super) sampler: wgpu::Sampler,
}

impl PageCache {
    /// As many slots as fit into the budget.
    ///
    /// # Errors
    /// [`Error::Budget`] if that is none.
    pub(super) fn grid(context: &Context, format: PageFormat, budget_bytes: u64) -> Result<Grid> {
        let limits = context.device.limits();
        let slot_bytes = format.slot_bytes();
        let slots = budget_bytes / slot_bytes;
        Grid::new(
            slots,
            limits.max_texture_dimension_2d,
            limits.max_texture_array_layers,
        )
        .ok_or_else(|| {
            Error::Budget(format!(
                "a page cache of {budget_bytes} bytes has no room for one page of {slot_bytes} bytes"
            ))
        })
    }

    pub(super) fn new(context: &Context, grid: Grid, format: PageFormat) -> Self {
        let texture = super::targets::layers(
            context,
            "page cache",
            format.texture(),
            (grid.columns * SLOT_TEXELS, grid.rows * SLOT_TEXELS, grid.layers),
            // Borders are stitched; pages move to caches of other sizes; tests read slots back.
            wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC,
        );
        let view = super::targets::layers_view(&texture);
        let sampler = context.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("pages"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self {
            grid,
            format,
            texture,
            view,
            sampler,
        }
    }

    /// Copies slots of another cache of the same format, each from where to where, on the GPU. Slots that stay side by side are copied
    /// together.
    pub(super) fn copy_from(&self, encoder: &mut wgpu::CommandEncoder, from: &Self, moves: &[(Slot, Slot)]) {
        for (first, count) in runs(from.grid, self.grid, moves) {
            let (source, destination) = moves[first];
            super::targets::copy(
                encoder,
                (&from.texture, origin_3d(from.grid.address(source))),
                (&self.texture, origin_3d(self.grid.address(destination))),
                (count * SLOT_TEXELS, SLOT_TEXELS),
            );
        }
    }

    /// Writes the first columns and rows of a slot; `texels` are those of all of it, as bytes of the format.
    pub(super) fn write(
        &self,
        context: &Context,
        uploads: &mut Uploads,
        slot: Slot,
        size: (u32, u32),
        texels: &[u8],
    ) {
        uploads.write(
            context,
            &self.texture,
            origin_3d(self.grid.address(slot)),
            size,
            self.format.slot_bytes() as u32 / SLOT_TEXELS,
            texels,
        );
    }

    /// The texels of the slot at an address, `[y][x]`, as bytes of the format. Waits.
    ///
    /// # Errors
    /// [`Error::Adapter`] if the device fails.
    pub(super) fn read(&self, context: &Context, address: u32) -> Result<Vec<u8>> {
        super::readback::rectangle(
            context,
            &self.texture,
            origin_3d(address),
            (SLOT_TEXELS, SLOT_TEXELS),
        )
    }

    /// One over width and height of a layer in texels.
    pub(super) fn scale(&self) -> Vec2 {
        1.0 / (Vec2::new(self.grid.columns as f32, self.grid.rows as f32) * SLOT_TEXELS as f32)
    }

    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.grid.slots()) * self.format.slot_bytes()
    }
}

/// Moves that can be made together: the first of them, and how many.
fn runs(from: Grid, to: Grid, moves: &[(Slot, Slot)]) -> Vec<(usize, u32)> {
    let mut runs: Vec<(usize, u32)> = Vec::new();
    for (at, &(source, destination)) in moves.iter().enumerate() {
        if let Some((first, count)) = runs.last_mut() {
            let (from_slot, to_slot) = moves[*first];
            let follows = source.0 == from_slot.0 + *count && destination.0 == to_slot.0 + *count;
            if follows && *count < from.rest_of_row(from_slot).min(to.rest_of_row(to_slot)) {
                *count += 1;
                continue;
            }
        }
        runs.push((at, 1));
    }
    runs
}

fn origin_3d(address: u32) -> wgpu::Origin3d {
    let (texel, layer) = origin(address);
    wgpu::Origin3d {
        x: texel.x,
        y: texel.y,
        z: layer,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_use_the_budget_and_the_limits() {
        assert_eq!(Grid::new(0, 8192, 256), None);
        for slots in (1..600).chain([1618, 6473, 8191, 8209, 25889, 65536, 103_557, 1_000_003]) {
            let grid = Grid::new(slots, 8192, 256).unwrap();
            assert!(u64::from(grid.slots()) <= slots, "{slots} {grid:?}");
            assert!(u64::from(grid.slots()) * 100 >= slots * 99, "{slots} {grid:?}");
            assert!(
                grid.columns * SLOT_TEXELS <= 8192 && grid.rows * SLOT_TEXELS <= 8192 && grid.layers <= 256
            );
        }
        assert_eq!(Grid::new(u64::MAX, 8192, 256).unwrap().slots(), 113 * 113 * 256);
    }

    #[test]
    fn addresses_name_every_slot_once() {
        let grid = Grid {
            columns: 3,
            rows: 2,
            layers: 4,
        };
        let mut addresses: Vec<_> = (0..grid.slots()).map(|slot| grid.address(Slot(slot))).collect();
        assert!(
            (0..)
                .zip(&addresses)
                .all(|(at, &address)| slot(grid, address) == Slot(at))
        );
        assert_eq!(addresses[0], 0);
        assert_eq!(addresses[5], 1 << 8 | 2);
        assert_eq!(addresses[6], 1 << 16);
        assert_eq!(origin(addresses[23]), (UVec2::new(144, 72), 3));
        assert!((0..24).all(|slot| grid.slot(addresses[slot as usize]) == Slot(slot)));
        addresses.dedup();
        assert_eq!(addresses.len(), 24);
    }

    #[test]
    fn runs_make_every_move_once_and_stay_in_their_rows() {
        let grid = |columns, rows, layers| Grid {
            columns,
            rows,
            layers,
        };
        let (from, to) = (grid(5, 3, 2), grid(4, 4, 1));
        let moves: Vec<_> = [0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 12, 20, 21, 22]
            .into_iter()
            .zip(0..)
            .map(|(source, destination)| (Slot(source), Slot(destination)))
            .collect();
        let runs = runs(from, to, &moves);
        assert_eq!(
            runs.iter().map(|(_, count)| count).sum::<u32>(),
            moves.len() as u32
        );
        assert!(runs.len() < moves.len());
        let mut next = 0;
        for (first, count) in runs {
            assert_eq!(first, next);
            for n in 0..count {
                let (source, destination) = moves[first + n as usize];
                let place = |grid: Grid, slot: Slot| (grid.address(slot) >> 8, grid.address(slot) & 0xff);
                for (grid, slot, start) in [(from, source, moves[first].0), (to, destination, moves[first].1)]
                {
                    let (row, column) = place(grid, start);
                    assert_eq!(place(grid, slot), (row, column + n));
                }
            }
            next += count as usize;
        }
    }
}
