//! What is known of one component group of a material.

use super::{
    rank::Rank,
    value::Blocks,
    wanted::{NONE, Wanted},
};

/// Votes of the present, and votes ahead.
#[derive(Clone, Copy)]
pub(super) enum Class {
    Now = 0,
    Ahead = 1,
}

/// One component group.
pub(super) struct Group {
    pub(super) column_slot: u32,
    /// The column is resident, in flight, or about to be asked for: without it pages are worth nothing.
    pub(super) open: bool,
    /// What the wanted pages are worth together, by class, and with them the column.
    pub(super) worth: [f64; 2],
    /// Σ w·v over the pages that are wanted now.
    pub(super) error: f64,
    /// The part of it that is not resident.
    pub(super) missing: f64,
    /// Tiles whose pages are resident, in no particular order.
    pub(super) residents: Vec<u32>,
    /// The lowest rank among the resident pages.
    pub(super) lowest: Option<Rank>,
    /// The highest rank among the pages that could be added to them.
    pub(super) highest: Option<Rank>,
    /// The values are those of the present votes. Groups that are not open have them worked out on demand.
    pub(super) valued: bool,
    /// Values of the pages of the wanted tiles, by class.
    values: [Vec<f64>; 2],
}

impl Default for Group {
    fn default() -> Self {
        Self {
            column_slot: NONE,
            open: false,
            worth: [0.0; 2],
            error: 0.0,
            missing: 0.0,
            residents: Vec::new(),
            lowest: None,
            highest: None,
            valued: false,
            values: Default::default(),
        }
    }
}

impl Group {
    /// Works out the values, unless they are known.
    pub(super) fn value(&mut self, weights: &[f32], wanted: &[Wanted; 2], blocks: &mut Blocks) {
        if !std::mem::replace(&mut self.valued, true) {
            for (wanted, values) in wanted.iter().zip(&mut self.values) {
                values.clear();
                values.extend(wanted.worths(weights));
                blocks.share(values, wanted.parents());
            }
        }
    }

    /// Values of the pages of the wanted tiles, in their order.
    pub(super) fn values(&self, class: Class) -> &[f64] {
        &self.values[class as usize]
    }

    /// Value of a tile's page, would the group be open; by the votes of this class, which are given.
    pub(super) fn value_of(&self, tile: u32, class: Class, wanted: &Wanted) -> f64 {
        wanted.pick(&self.values[class as usize], tile)
    }
}
