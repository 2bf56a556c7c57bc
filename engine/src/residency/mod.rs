//! What to keep in the page cache: votes in, operations out.
//!
//! Pure and deterministic: no clock, no I/O, no GPU, and time is counted in updates. Source: Schwartz,
//! Ruiters, Klein 2013, section 5 (level-of-detail strategy and tile prioritization) and section 6
//! (columns).
//!
//! - `items`: the words of the contract: items, votes, plans, placements.
//! - `rank`: the order in which items deserve their places. `claim`: who gets one.
//! - `wanted`: tiles that votes want. `value`: values of pages that never grow from a page to its children.
//! - `material`: votes, values and slots of one material. `group`: what is known of one of its component groups.
//! - `pool`: the slots of one cache, and who gives way.
//! - `order`: what is best fetched first, and what will be asked for next.
//! - `update`: from votes to requests. `arrival`: from answers to placements. `limits`: budgets that change.
//!
//! # The resident set is closed
//!
//! A page is asked for and placed only while its parent is resident: the codec decodes it against its
//! parent, and trilinear filtering reads both. Finer pages of a group moreover need the group's column; the
//! group's root and its column are asked for together. The paper's `add` drops an ancestor that its
//! children cover; here ancestors stay, so the page that gives way is always a leaf, and what is lost with
//! it is w·v of that page alone: equation 10 with l' = l − 1. The paper's `swap` trades two pages for their
//! ancestor because its ancestors have gone; here the ancestor is there already.
//!
//! # Values
//!
//! P = w·v (equation 9; v counts the pixels that want the page or a descendant) is what the squared error
//! falls by when the page is added, and what it rises by when it goes. Priority and cost of a page are the
//! same number, so every swap raises the sum of the values of all that is resident, which cannot go on
//! forever: static votes settle.
//!
//! Where a program says how much errors are [seen](MaterialInfo::visibility), v counts each pixel by that of the tile for
//! which it votes. It is a factor of the pixel, not of the page, so all of the above holds as it is; what is reported
//! counts pixels as pixels.
//!
//! A plain P has one trap. The mips of a woven or porous material hold next to nothing until its structure
//! begins, so w·v of the pages on the way there may be (nearly) zero and would never be asked for, whatever
//! lies beneath them. So where a page's descendants are worth more than the page itself, they share: the
//! value of a page is the largest mean of w·v over any set of wanted pages that it is the top of (`value`).
//! Along a path from the root values then never grow, which makes three things true at once: where w·v does
//! not grow along a path either, values are the paper's P; the page with the least value is always a leaf;
//! and the best closed set of n pages is simply the n pages with the largest values, up to the last group
//! of pages that share one.
//!
//! The value of a column is the whole error that its group can remove from the picture, Σ w·v over all
//! wanted pages of the group: the paper's Σ v·‖T‖² (section 6) for the tiles that will be shown, because
//! residuals to the up-sampled parent are nearly orthogonal. It does not depend on what is resident, so
//! columns settle first and pages after them. In the order of requests a column counts as much as its root,
//! w_root·v before anything finer is there, because that is all that its arrival brings at first. A
//! column's swap can raise the predicted error until the pages of the new group are there; a page's swap
//! lowers it at once wherever values are the paper's P (a root's, once its column is there too).
//!
//! Pages of a group whose column is neither resident nor on its way are worth nothing. Items without votes
//! are worth nothing either; both stay while there is room and are the first to give way, least recently
//! wanted first.
//!
//! A column is asked for only if its root would be: if there is a free slot for pages, or the root is worth more by the
//! margin than the page that would give way for it. So columns do not fill up with groups of which no page would ever
//! be there, however many slots they have.
//!
//! # The order of records
//!
//! Slots are all of one size, records are not. Who gets a slot follows from values alone; what is asked for first, among those
//! that get one, is what lowers the predicted error most per byte of its record: a greedy schedule of the wire (Smith: Various
//! Optimizers for Single-Stage Production, 1956). A column and its root are worth nothing without each other, so
//! each counts the value of the root over the bytes of both. A record costs [`HEAD_BYTES`] more than it has; what is not stored costs none
//! and comes first, and pins before all.
//!
//! A page is asked for under a resident parent, so by itself a chain of pages would take a round trip each. But
//! what will be asked for next is known: [`Residency::upcoming`] walks down from what is resident and in flight, best page first,
//! counts slots as the update does, and names the pages in the order of their error per byte, parents before
//! children. Records of these can be fetched meanwhile; nothing is placed before its parent all the same.
//!
//! # Votes ahead
//!
//! A second set of votes says what may be seen soon. It makes ranks of a lower class: it counts only for items
//! that the present does not want at all, and the least item of the present ranks above the best of these. So what is
//! fetched ahead fills free slots and takes the places of what nobody wants, and the present takes them back like any
//! others. It is asked for when every request of the present has gone out, and is cancelled where it holds up a later one.
//!
//! # Votes are taken as they come
//!
//! Sparse jittered feedback is noisy, but it is the frame that smooths it: its window sums the newest votes of every
//! phase of the jitter, which is each pixel once and a moving mean over as many frames. A second filter here would
//! only lag behind it, and would change all votes in every frame where now only those change that have changed. A static
//! view has its exact votes when each phase has been seen, after finitely many updates. What noise the motion leaves is the
//! margin's business (below).
//!
//! # The cost of an update
//!
//! It follows what has changed. Votes that differ change the counts on the ways up to the root; their materials work out
//! worths, and the values of open groups, anew. Each group keeps the lowest rank of its resident pages and the highest
//! of those that could be added, found again only after a change in the group; the n best pages of all lie
//! in the n groups with the best bounds, so nothing else is looked at. The operations are those of a plain recomputation of
//! everything (engine/tests/residency/plain.rs).
//!
//! # Stability
//!
//! Free slots are filled first. With none left an item is asked for if it is worth more than what would give
//! way by a [margin](SWAP_MARGIN); once in flight it is cancelled only if it is worth no more than that,
//! without the margin, so small changes of the votes do not toggle it. Root and column of group 0 of every
//! visible material are pinned, that is asked for first and kept, while a cache has [enough](SLOTS_PER_PIN) slots for
//! each. With fewer they are items like all others: a material that a few pixels show is not worth what its root would
//! take from the rest, and shows its mean colour.

mod arrival;
mod claim;
mod group;
mod items;
mod limits;
mod material;
mod order;
mod pool;
mod rank;
mod update;
mod value;
mod wanted;

use std::collections::{BTreeSet, HashMap};

pub use items::{
    Item, Limits, MaterialId, MaterialInfo, Move, Placement, Plan, Resized, Slot, Summary, Vote,
};
use material::Material;
use pool::Pool;
use value::Blocks;

/// How much more an item must be worth than what gives way for it, before it is asked for: the 1.6 % that
/// votes jitter by while a camera drifts. Bounds what settling forgoes by the same share.
pub const SWAP_MARGIN: f64 = 1.0 / 64.0;

/// Slots of a cache for each visible material, from which on the material's first root, or column, is pinned there. So
/// pins take at most a sixteenth of a cache, and the predicted error of what is settled stays within 2 % of the least that
/// any closed set has (docs/results.md).
pub const SLOTS_PER_PIN: u32 = 16;

/// What a record costs on the line besides its own bytes, when records are put into order: the request, and the head of the answer.
pub const HEAD_BYTES: u64 = 300;

/// Failures in a row after which an item no longer keeps the cache from counting as settled. It is still
/// asked for now and then.
pub const PATIENCE: u32 = 5;

/// Longest time between two attempts at a failing item, in updates: a minute at 60 a second.
pub const LONGEST_BACK_OFF: u64 = 4096;

/// Most items whose failures are remembered; beyond, all are forgotten and tried again at once.
const MOST_FAILURES: usize = 1 << 14;

/// Tiles of a material with their votes: those of the present, and those ahead.
type TileVotes = [Vec<(u32, u64)>; 2];

/// The set of resident items and the rules by which it changes.
pub struct Residency {
    limits: Limits,
    materials: Vec<Material>,
    pages: Pool,
    columns: Pool,
    /// Ordered, because plans follow its order.
    in_flight: BTreeSet<Item>,
    /// Of their records.
    bytes_in_flight: u64,
    /// Columns whose groups are open, besides those that are resident.
    opened: Vec<Item>,
    failures: HashMap<Item, Failure>,
    /// Updates so far: the clock.
    now: u64,
    /// The last votes, and those ahead: what settled with them stays so.
    votes: [Vec<Vote>; 2],
    /// Pixels of the last votes.
    pixels: u64,
    /// First roots of visible materials are pinned, and their columns.
    pin_pages: bool,
    pin_columns: bool,
    /// The last update found something to ask for, or something has been placed since.
    unsettled: bool,
    /// The same of what only votes ahead want.
    prefetching: bool,
    added: u64,
    swapped: u64,
    /// Working memory: votes by material and class, and values.
    sorted: Vec<TileVotes>,
    blocks: Blocks,
}

/// Failures in a row, and the update from which on to try again.
struct Failure {
    count: u32,
    retry: u64,
}

impl Residency {
    /// An empty cache.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            materials: Vec::new(),
            pages: Pool::new(limits.page_slots),
            columns: Pool::new(limits.column_slots),
            in_flight: BTreeSet::new(),
            bytes_in_flight: 0,
            opened: Vec::new(),
            failures: HashMap::new(),
            now: 0,
            votes: Default::default(),
            pixels: 0,
            pin_pages: true,
            pin_columns: true,
            unsettled: true,
            prefetching: false,
            added: 0,
            swapped: 0,
            sorted: Vec::new(),
            blocks: Blocks::default(),
        }
    }

    /// Registers a material; ids count up from 0.
    ///
    /// Missing weights, and weights that are negative or not finite, count as zero. A scene has at most
    /// 65,535 materials: those beyond all get the id 65,535, under which nothing is ever resident.
    pub fn add_material(&mut self, info: MaterialInfo) -> MaterialId {
        let id = MaterialId(self.materials.len().min(usize::from(u16::MAX)) as u16);
        if id.0 != u16::MAX {
            self.materials.push(Material::new(id, info));
            self.unsettled = true;
        }
        id
    }

    /// Lets votes for a material count for nothing from now on (`true`), or lets them count again. What of it is in flight is
    /// so no more; what is resident stays until its place is needed.
    pub fn set_retired(&mut self, material: MaterialId, retired: bool) {
        let Some(at) = self.materials.get_mut(usize::from(material.0)) else {
            return;
        };
        at.set_retired(retired);
        self.unsettled = true;
        if retired {
            let in_flight = std::mem::take(&mut self.in_flight);
            let (gone, kept) = in_flight
                .into_iter()
                .partition(|item: &Item| item.material() == usize::from(material.0));
            self.in_flight = kept;
            let gone: BTreeSet<Item> = gone;
            self.bytes_in_flight -= gone
                .iter()
                .map(|item| self.materials[item.material()].bytes(*item))
                .sum::<u64>();
        }
    }

    /// Where an item is.
    pub fn slot(&self, item: Item) -> Option<Slot> {
        self.materials.get(item.material())?.slot(item)
    }

    /// Everything that is resident, in a fixed order: pages, then columns, each by slot.
    pub fn resident(&self) -> Vec<(Item, Slot)> {
        self.pages.iter().chain(self.columns.iter()).collect()
    }

    /// Whether an item stays as long as its material is seen.
    pub fn is_pinned(&self, item: Item) -> bool {
        item.material() < self.materials.len() && self.rank(item).pinned
    }

    /// Of a material the squared errors, summed over the voting pixels, of what is not resident, and of all that they want.
    pub fn errors(&self, material: MaterialId) -> [f64; 2] {
        let material = self.materials.get(usize::from(material.0));
        material.map_or([0.0; 2], Material::errors)
    }

    /// What is known after the last update and the arrivals since.
    pub fn summary(&self) -> Summary {
        let missing: f64 = self.materials.iter().map(Material::missing).sum();
        Summary {
            pages_wanted: self.materials.iter().map(Material::pages_wanted).sum(),
            pages_resident: self.pages.len(),
            columns_resident: self.columns.len(),
            in_flight: self.in_flight.len() as u32,
            added: self.added,
            swapped: self.swapped,
            predicted_mse: if self.pixels > 0 {
                missing / self.pixels as f64
            } else {
                0.0
            },
            settled: !self.unsettled && !self.in_flight.iter().any(|item| self.rank(*item).is_present()),
            prefetching: self.prefetching || self.in_flight.iter().any(|item| !self.rank(*item).is_present()),
        }
    }
}
