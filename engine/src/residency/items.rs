//! The words of the contract.

use tileset::{PageId, Pyramid};

/// A material in the scene, in the order of registration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MaterialId(pub u16);

/// A place in the page cache, or in the column cache.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Slot(pub u32);

/// Something that can be resident.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Item {
    /// A page.
    Page(MaterialId, PageId),
    /// The eigen-ABRDF column of a component group.
    Column(MaterialId, u16),
}

impl Item {
    /// Index of the material.
    pub(super) fn material(self) -> usize {
        match self {
            Item::Page(material, _) | Item::Column(material, _) => material.0.into(),
        }
    }
}

/// What residency knows about a material.
#[derive(Clone, Debug)]
pub struct MaterialInfo {
    /// Geometry.
    pub pyramid: Pyramid,
    /// Component groups.
    pub groups: u16,
    /// w of each page (paper, equation 8): group by group, within a group by tile index.
    pub weights: Vec<f32>,
    /// What a squared error counts for where pixels want each tile, beside those of other places: by tile index; 1 where it is missing, or not positive
    /// and finite. Values and priorities are in this unit, what is reported is in that of reflectance.
    pub visibility: Vec<f32>,
    /// Bytes of the records of the pages, in the same order; those that are missing count as none.
    pub page_bytes: Vec<u32>,
    /// Bytes of the records of the columns, by group; those that are missing count as none.
    pub column_bytes: Vec<u32>,
}

/// Hard limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Slots of the page cache.
    pub page_slots: u32,
    /// Slots of the column cache.
    pub column_slots: u32,
    /// Most items asked for and not yet arrived.
    pub in_flight: usize,
    /// Most bytes of records asked for and not yet arrived. A record that is larger travels alone.
    pub bytes_in_flight: u64,
}

/// What new limits mean for what is resident and in flight. To be followed in this order: evict, move, cancel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Resized {
    /// Items that have lost their slots.
    pub evicted: Vec<(Item, Slot)>,
    /// Items that have moved, to slots that were free or have become so: copies can be made in any order.
    pub moved: Vec<Move>,
    /// Items in flight beyond the new limits.
    pub cancel: Vec<Item>,
}

/// An item that has changed its slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Move {
    /// What.
    pub item: Item,
    /// Where it was.
    pub from: Slot,
    /// Where it is.
    pub to: Slot,
}

/// Where an arrived item goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// Into this slot, after the item that was there is gone.
    Place {
        /// Where.
        slot: Slot,
        /// Who gives way: the swap of the paper's section 5.1.
        evicted: Option<Item>,
    },
    /// Nowhere: it is not worth a slot any more.
    Drop,
}

/// What to do after an update.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Items to ask for now, most important first.
    pub request: Vec<Item>,
    /// Items in flight that are not worth their slot any more.
    pub cancel: Vec<Item>,
}

/// Pixels of the feedback that want a tile: the tile itself, not its ancestors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vote {
    /// Material.
    pub material: MaterialId,
    /// [`Pyramid::tile_index`] of the wanted tile.
    pub tile: u32,
    /// Pixels.
    pub pixels: u32,
}

/// What the residency knows of itself after an update.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Pages that have votes, resident or not.
    pub pages_wanted: u32,
    /// Pages in the cache.
    pub pages_resident: u32,
    /// Columns in the cache.
    pub columns_resident: u32,
    /// Items asked for and not yet arrived.
    pub in_flight: u32,
    /// Pages and columns placed without an eviction, since the start.
    pub added: u64,
    /// Pages and columns placed by evicting another, since the start.
    pub swapped: u64,
    /// Mean over the voting pixels of the squared reflectance error that is predicted for what is resident,
    /// relative to everything resident (paper, equation 7).
    pub predicted_mse: f64,
    /// No operation is left that would lower the predicted error, and nothing that the votes want is in flight. Items
    /// that keep failing do not count after [`super::PATIENCE`] attempts, or a missing record would keep a program
    /// waiting forever.
    pub settled: bool,
    /// Something is left to ask for, or in flight, that only votes ahead want. It does not count for `settled`.
    pub prefetching: bool,
}
