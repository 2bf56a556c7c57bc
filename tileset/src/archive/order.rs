//! The order of records in a file: what lowers the error most per byte comes first.

use std::{cmp::Reverse, collections::BinaryHeap};

use super::Record;
use crate::{PageId, Pyramid, Tile};

/// A record to be placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Item {
    /// A group's column.
    Column(u16),
    /// A page.
    Page(PageId),
}

/// Gives all stored records, columns by group and pages group by group, their offsets, the first `start`; returns them
/// in the order in which they stand, and where the last one ends.
///
/// Lengths and weights say it all, so a directory needs no offsets.
pub(super) fn place(
    pyramid: &Pyramid,
    columns: &mut [Record],
    pages: &mut [Record],
    start: u64,
) -> (Vec<Item>, u64) {
    let tiles = pyramid.tile_count() as usize;
    let place = |page: PageId| {
        let tile = pyramid.tile_index(page.tile).expect("tiles of the pyramid") as usize;
        usize::from(page.group) * tiles + tile
    };
    let order = streaming_order(
        pyramid,
        columns.len() as u16,
        &Records {
            columns,
            pages,
            place,
        },
    );
    let mut end = start;
    for &item in &order {
        let record = match item {
            Item::Column(group) => &mut columns[usize::from(group)],
            Item::Page(page) => &mut pages[place(page)],
        };
        record.offset = end;
        end += u64::from(record.length);
    }
    (order, end)
}

/// Entries of the directory.
struct Records<'a, P> {
    columns: &'a [Record],
    pages: &'a [Record],
    /// The index of a page's entry.
    place: P,
}

impl<P: Fn(PageId) -> usize> Sizes for Records<'_, P> {
    fn column_bytes(&self, group: u16) -> usize {
        self.columns[usize::from(group)].length as usize
    }

    fn page(&self, page: PageId) -> (usize, f64) {
        let record = self.pages[(self.place)(page)];
        (record.length as usize, record.weight.into())
    }
}

/// Bytes and weight of records, as the directory has them.
trait Sizes {
    /// Of a group's column.
    fn column_bytes(&self, group: u16) -> usize;
    /// Of a page: bytes, and mean squared difference to its up-sampled parent.
    fn page(&self, page: PageId) -> (usize, f64);
}

/// An entry of the queue. Ties go to the lower group and the coarser tile, so that the order is the same
/// everywhere.
#[derive(PartialEq)]
struct Candidate {
    gain_per_byte: f64,
    item: Item,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.gain_per_byte
            .total_cmp(&other.gain_per_byte)
            .then_with(|| Reverse(self.item).cmp(&Reverse(other.item)))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// All records that are stored, greedily by predicted reduction of squared error per byte: a column comes
/// before its group's pages, a page before its children.
///
/// A page's gain is its weight times the share of the material that it covers. A column alone shows
/// nothing, so it is judged together with the root behind it.
fn streaming_order(pyramid: &Pyramid, groups: u16, sizes: &impl Sizes) -> Vec<Item> {
    let root = |group| PageId {
        group,
        tile: pyramid.root(),
    };
    let mut queue: BinaryHeap<Candidate> = (0..groups)
        .map(|group| {
            let (bytes, weight) = sizes.page(root(group));
            let gain_per_byte = weight / (sizes.column_bytes(group) + bytes) as f64;
            Candidate {
                gain_per_byte,
                item: Item::Column(group),
            }
        })
        .collect();
    let mut order = Vec::new();
    let mut ready = Vec::new();
    while let Some(Candidate { item, .. }) = queue.pop() {
        order.push(item);
        match item {
            Item::Column(group) => ready.push(root(group)),
            Item::Page(page) => ready.extend(children(pyramid, page)),
        }
        while let Some(page) = ready.pop() {
            match sizes.page(page) {
                // Not stored: it costs nothing and its children are allowed at once.
                (0, _) => ready.extend(children(pyramid, page)),
                (bytes, weight) => {
                    let gain_per_byte = weight * share(pyramid, page.tile) / bytes as f64;
                    queue.push(Candidate {
                        gain_per_byte,
                        item: Item::Page(page),
                    });
                }
            }
        }
    }
    order
}

fn children(pyramid: &Pyramid, page: PageId) -> impl Iterator<Item = PageId> + use<> {
    pyramid.children(page.tile).map(move |tile| PageId {
        group: page.group,
        tile,
    })
}

/// Share of the material that a page's payload covers.
fn share(pyramid: &Pyramid, tile: Tile) -> f64 {
    let (width, height) = pyramid.payload(tile);
    let (mip_width, mip_height) = pyramid.mip_size(tile.mip);
    f64::from(width * height) / (f64::from(mip_width) * f64::from(mip_height))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes and weights by rule.
    struct Rule(fn(Item) -> (usize, f64));

    impl Sizes for Rule {
        fn column_bytes(&self, group: u16) -> usize {
            self.0(Item::Column(group)).0
        }

        fn page(&self, page: PageId) -> (usize, f64) {
            self.0(Item::Page(page))
        }
    }

    /// Two groups of a pyramid with pages in three mips.
    fn order(rule: fn(Item) -> (usize, f64)) -> Vec<Item> {
        streaming_order(&Pyramid::new(128, 100, true).unwrap(), 2, &Rule(rule))
    }

    fn page(group: u16, mip: u8, x: u16, y: u16) -> Item {
        Item::Page(PageId {
            group,
            tile: Tile { mip, x, y },
        })
    }

    #[test]
    fn the_heavier_group_comes_first_as_a_whole() {
        let order = order(|item| match item {
            Item::Column(_) => (100, 0.0),
            Item::Page(page) => (10, if page.group == 1 { 1.0 } else { 1e-3 }),
        });
        assert_eq!(order.len(), 2 * (1 + 1 + 1 + 4));
        assert_eq!(order[..3], [Item::Column(1), page(1, 2, 0, 0), page(1, 1, 0, 0)]);
        // Pages of the lower row show 36 of 100 rows of texels, the upper ones 64.
        assert_eq!(
            order[3..7],
            [
                page(1, 0, 0, 0),
                page(1, 0, 1, 0),
                page(1, 0, 0, 1),
                page(1, 0, 1, 1)
            ]
        );
    }

    #[test]
    fn a_column_is_judged_with_its_root() {
        let order = order(|item| match item {
            Item::Column(group) => (if group == 0 { 1000 } else { 10 }, 0.0),
            Item::Page(_) => (10, 1.0),
        });
        assert_eq!(order[0], Item::Column(1));
        assert_eq!(*order.last().unwrap(), page(0, 0, 1, 1));
    }

    #[test]
    fn pages_that_are_not_stored_release_their_children() {
        let order = order(|item| match item {
            Item::Column(_) => (10, 0.0),
            Item::Page(page) => (if page.tile.mip > 0 { 0 } else { 10 }, 1.0),
        });
        assert_eq!(order.len(), 2 * (1 + 4));
        assert_eq!(order[0], Item::Column(0));
    }
}
