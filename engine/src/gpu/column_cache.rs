//! The column cache: eigen-ABRDFs of resident groups, in slots of the size of the scene's largest column.
//!
//! What a column is in the cache depends on how shading interpolates ([`Angular`]): the samples as they are, eight half
//! floats a texel and without filtering, or maps of the light hemisphere, four half floats a texel, to be filtered.
//!
//! Source: Schwartz, Ruiters, Klein 2013, section 6 (columns come one by one) and section 7 (a further light holds
//! the pre-integrated ambient term).

use half::f16;
use tileset::Column;

use crate::{
    Error, Result,
    angular::{Angular, ROW_TEXELS},
    gpu::{Context, uploads::Uploads},
    residency::Slot,
};

/// Narrowest and widest layer, in texels; a power of two, so that shaders split an index by shift and mask.
const MIN_WIDTH_SHIFT: u32 = 7;
const MAX_WIDTH_SHIFT: u32 = 13;

/// Bytes of one colour at one view and light: four components.
const QUAD_BYTES: u64 = 8;

/// Bytes of a texel: two of those, or one that can be filtered.
const fn texel_bytes(angular: Angular) -> u64 {
    match angular {
        Angular::Delaunay => 2 * QUAD_BYTES,
        Angular::Hemisphere => QUAD_BYTES,
    }
}

/// More bytes than a slot takes for a column of `quads` times four half floats: it ends with a whole row.
pub(crate) const fn most_slot_bytes(quads: u64) -> u64 {
    quads.saturating_mul(QUAD_BYTES) + ((2 * QUAD_BYTES) << MAX_WIDTH_SHIFT)
}

/// How slots are laid out: each takes whole rows of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rows {
    /// What columns are.
    pub angular: Angular,
    /// Log2 of a layer's width in texels.
    pub width_shift: u32,
    /// Rows of a slot.
    pub slot_rows: u32,
    /// Slots in a layer.
    pub layer_slots: u32,
    /// Layers.
    pub layers: u32,
}

impl Rows {
    /// As many slots for columns of `quads` times four half floats as `budget_bytes` hold; `None` if that is none.
    pub fn new(
        angular: Angular,
        quads: u64,
        budget_bytes: u64,
        max_side: u32,
        max_layers: u32,
    ) -> Option<Self> {
        let texel_bytes = texel_bytes(angular);
        let texels = (quads * QUAD_BYTES).div_ceil(texel_bytes).max(1);
        let mut widths = match angular {
            Angular::Delaunay => MIN_WIDTH_SHIFT..=MAX_WIDTH_SHIFT,
            Angular::Hemisphere => ROW_TEXELS.ilog2()..=ROW_TEXELS.ilog2(),
        };
        let width_shift = widths.find(|&shift| texels.div_ceil(1 << shift) <= u64::from(max_side))?;
        let slot_rows = texels.div_ceil(1 << width_shift) as u32;
        let slots = budget_bytes / ((u64::from(slot_rows) << width_shift) * texel_bytes);
        let layer_slots = slots
            .div_ceil(max_layers.into())
            .clamp(1, (max_side / slot_rows).into()) as u32;
        let layers = (slots / u64::from(layer_slots)).min(max_layers.into()) as u32;
        (layers > 0).then_some(Self {
            angular,
            width_shift,
            slot_rows,
            layer_slots,
            layers,
        })
    }

    /// Slots in all.
    pub fn slots(self) -> u32 {
        self.layer_slots * self.layers
    }

    /// Bytes of a slot.
    pub fn slot_bytes(self) -> u64 {
        (u64::from(self.slot_rows) << self.width_shift) * texel_bytes(self.angular)
    }

    /// Layer and first row of a slot.
    pub fn place(self, slot: Slot) -> (u32, u32) {
        (
            slot.0 / self.layer_slots,
            slot.0 % self.layer_slots * self.slot_rows,
        )
    }

    /// The same, as an entry of the page table names them.
    pub fn address(self, slot: Slot) -> u32 {
        let (layer, row) = self.place(slot);
        layer << 16 | row
    }

    /// The slot at an address.
    pub fn slot(self, address: u32) -> Slot {
        Slot((address >> 16) * self.layer_slots + (address & 0xffff) / self.slot_rows)
    }
}

/// The texture.
pub(super) struct ColumnCache {
    pub(super) rows: Rows,
    texture: wgpu::Texture,
    pub(super) view: wgpu::TextureView,
}

impl ColumnCache {
    /// As many slots for columns of `quads` times four half floats as fit into the budget.
    ///
    /// # Errors
    /// [`Error::Budget`] if there is no room for one column.
    pub(super) fn rows(context: &Context, angular: Angular, quads: u64, budget_bytes: u64) -> Result<Rows> {
        let limits = context.device.limits();
        Rows::new(
            angular,
            quads,
            budget_bytes,
            limits.max_texture_dimension_2d,
            limits.max_texture_array_layers,
        )
        .ok_or_else(|| {
            Error::Budget(format!(
                "a column cache of {budget_bytes} bytes on this adapter has no room for one column of {} bytes",
                quads * QUAD_BYTES
            ))
        })
    }

    pub(super) fn new(context: &Context, rows: Rows) -> Self {
        let texture = super::targets::layers(
            context,
            "column cache",
            match rows.angular {
                Angular::Delaunay => super::targets::COLUMNS,
                Angular::Hemisphere => super::targets::MAPS,
            },
            (
                1 << rows.width_shift,
                rows.slot_rows * rows.layer_slots,
                rows.layers,
            ),
            // Columns move to caches of other sizes.
            wgpu::TextureUsages::COPY_SRC,
        );
        let view = super::targets::layers_view(&texture);
        Self { rows, texture, view }
    }

    /// Writes a column in the form that the cache has.
    pub(super) fn write(
        &self,
        context: &Context,
        uploads: &mut Uploads,
        slot: Slot,
        mut quads: Vec<[f16; 4]>,
    ) {
        let (layer, row) = self.rows.place(slot);
        quads.resize((self.rows.slot_bytes() / QUAD_BYTES) as usize, [f16::ZERO; 4]);
        uploads.write(
            context,
            &self.texture,
            wgpu::Origin3d {
                x: 0,
                y: row,
                z: layer,
            },
            (1 << self.rows.width_shift, self.rows.slot_rows),
            (texel_bytes(self.rows.angular) as u32) << self.rows.width_shift,
            bytemuck::cast_slice(&quads),
        );
    }

    /// Copies slots of another cache of the same form, whose slots may be smaller, each from where to where, on the GPU.
    pub(super) fn copy_from(&self, encoder: &mut wgpu::CommandEncoder, from: &Self, moves: &[(Slot, Slot)]) {
        for &(source, destination) in moves {
            for [from_place, to_place, size] in pieces(from.rows, self.rows, source, destination) {
                let origin = |[x, y, z]: [u32; 3]| wgpu::Origin3d { x, y, z };
                super::targets::copy(
                    encoder,
                    (&from.texture, origin(from_place)),
                    (&self.texture, origin(to_place)),
                    (size[0], size[1]),
                );
            }
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.rows.slots()) * self.rows.slot_bytes()
    }
}

/// The rectangles of a slot in two caches: column, row and layer there and here, and width, height and layers. One if
/// the layers are equally wide, otherwise pieces of rows of the narrower. What the larger slot has more stays as it is.
fn pieces(from: Rows, to: Rows, source: Slot, destination: Slot) -> Vec<[[u32; 3]; 3]> {
    let ((from_layer, from_row), (to_layer, to_row)) = (from.place(source), to.place(destination));
    if from.width_shift == to.width_shift {
        let rows = from.slot_rows.min(to.slot_rows);
        let size = [1 << from.width_shift, rows, 1];
        return vec![[[0, from_row, from_layer], [0, to_row, to_layer], size]];
    }
    let width = 1u32 << from.width_shift.min(to.width_shift);
    let texels =
        (u64::from(from.slot_rows) << from.width_shift).min(u64::from(to.slot_rows) << to.width_shift);
    let place = |rows: Rows, row: u32, layer: u32, texel: u64| {
        let x = texel & ((1 << rows.width_shift) - 1);
        [x as u32, row + (texel >> rows.width_shift) as u32, layer]
    };
    let starts = (0..texels).step_by(width as usize);
    starts
        .map(|texel| {
            let there = place(from, from_row, from_layer, texel);
            [there, place(to, to_row, to_layer, texel), [width, 1, 1]]
        })
        .collect()
}

/// A column as the cache holds it: `[view][light, then ambient][rgb]`; the ambient entry is the sum of the lights'
/// entries, weighted.
pub fn with_ambient(column: &Column, ambient_weights: &[f64]) -> Vec<[f16; 4]> {
    let view_texels = (ambient_weights.len() * 3).max(1);
    let views = column.texels.len() / view_texels;
    let mut texels = Vec::with_capacity(views * (view_texels + 3));
    for view in column.texels.chunks_exact(view_texels) {
        texels.extend_from_slice(view);
        let mut sums = [[0.0f64; 4]; 3];
        for (light, &weight) in view.chunks_exact(3).zip(ambient_weights) {
            for (sum, texel) in sums.iter_mut().flatten().zip(light.iter().flatten()) {
                *sum += weight * texel.to_f64();
            }
        }
        texels.extend(sums.map(|sum| sum.map(f16::from_f64)));
    }
    texels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_fit_the_budget_and_the_limits() {
        use Angular::{Delaunay, Hemisphere};
        let columns = [1, 255, 12 * 3, 81 * 82 * 3, 151 * 152 * 3].map(|quads| (Delaunay, quads));
        let maps = [1, 3 * 8 * 256, 3 * 32 * 19 * 256].map(|quads| (Hemisphere, quads));
        assert_eq!(Rows::new(Hemisphere, 8193 * 256, u64::MAX / 2, 8192, 256), None);
        for (angular, quads) in columns
            .into_iter()
            .chain(maps)
            .chain([(Delaunay, 4096 * 4097 * 3)])
        {
            let rows = |bytes| Rows::new(angular, quads, bytes, 8192, 256);
            let bytes = rows(u64::MAX / 2).unwrap().slot_bytes();
            assert!(bytes >= quads * 8 && bytes < most_slot_bytes(quads));
            assert_eq!(rows(bytes - 1), None);
            for slots in [1, 2, 255, 256, 257, 1000] {
                let rows = rows(bytes * slots).unwrap();
                assert!(u64::from(rows.slots()) <= slots && rows.layers <= 256);
                assert!(rows.slot_rows * rows.layer_slots <= 8192);
                let last = Slot(rows.slots() - 1);
                assert_eq!(rows.slot(rows.address(last)), last);
                let (layer, row) = rows.place(last);
                assert!(
                    layer == rows.layers - 1 && row + rows.slot_rows == rows.slot_rows * rows.layer_slots
                );
            }
        }
    }

    #[test]
    fn pieces_copy_a_column_between_layers_of_any_width() {
        let rows = |width_shift, slot_rows| Rows {
            angular: Angular::Delaunay,
            width_shift,
            slot_rows,
            layer_slots: 2,
            layers: 3,
        };
        for (from, to) in [
            (rows(7, 4), rows(7, 9)),
            (rows(7, 5), rows(9, 2)),
            (rows(8, 3), rows(7, 6)),
        ] {
            let (source, destination) = (Slot(3), Slot(4));
            let (from_place, to_place) = (from.place(source), to.place(destination));
            let mut copied = 0u64;
            for [there, here, [width, height, _]] in pieces(from, to, source, destination) {
                assert_eq!((there[2], here[2]), (from_place.0, to_place.0));
                let texel = |rows: Rows, row: u32, place: [u32; 3]| {
                    (u64::from(place[1] - row) << rows.width_shift) + u64::from(place[0])
                };
                assert_eq!(texel(from, from_place.1, there), copied);
                assert_eq!(texel(to, to_place.1, here), copied);
                copied += u64::from(width) * u64::from(height);
            }
            assert_eq!(copied, u64::from(from.slot_rows) << from.width_shift);
        }
    }

    #[test]
    fn the_ambient_entry_is_the_weighted_sum_over_lights() {
        let texel = |x: f32| [f16::from_f32(x), f16::from_f32(-x), f16::ZERO, f16::ONE];
        // Two views of two lights: value = 10 view + light, the same in all colours.
        let texels = (0..12).map(|i| texel((i / 6 * 10 + i / 3 % 2) as f32)).collect();
        let out = with_ambient(&Column { texels }, &[0.25, 0.5]);
        assert_eq!(out.len(), 18);
        assert_eq!(out[9..12], [texel(10.0); 3]);
        for (at, value) in [(6, 0.5), (15, 0.25 * 10.0 + 0.5 * 11.0)] {
            let [a, b, c, d] = out[at].map(f16::to_f32);
            assert_eq!([a, b, c, d], [value, -value, 0.0, 0.75]);
        }
    }
}
