//! The order in which records are best fetched: predicted error reduction per byte, parents before children.
//!
//! Slots are all of one size, so who gets one is decided by value alone. Bytes are what the wire has few of: of two
//! items that both get a slot the one whose record takes less of it for the same value comes first.

use std::{
    cmp::{Ordering, Reverse},
    collections::{BinaryHeap, HashMap},
};

use super::{
    Item, MaterialId, Residency,
    rank::{Highest, Rank},
};

/// How soon an item is to come, the highest first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Urgency {
    /// Value a byte; what costs none comes before all others.
    per_byte: f64,
    rank: Rank,
    /// Of a column and its root, which count as one, the column is first.
    column: bool,
}

impl Eq for Urgency {}

impl Ord for Urgency {
    fn cmp(&self, other: &Self) -> Ordering {
        let class = |urgency: &Urgency| (urgency.rank.is_present(), urgency.rank.pinned);
        class(self)
            .cmp(&class(other))
            .then_with(|| self.per_byte.total_cmp(&other.per_byte))
            .then_with(|| self.rank.cmp(&other.rank))
            .then_with(|| self.column.cmp(&other.column))
    }
}

impl PartialOrd for Urgency {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// A page on the list.
struct Listed {
    item: Item,
    rank: Rank,
    /// What comes before it, by its place in the list.
    after: Option<usize>,
}

impl Residency {
    /// Everything that is in flight, and the pages that will be asked for once that is here, in the order in which records
    /// are best fetched: what is wanted now before what is wanted ahead, pinned items first, then by predicted
    /// error reduction per byte, columns before and parents never after their pages. At most `most` pages; none that would
    /// not get a slot, and none below an item that has failed and waits for its next attempt.
    ///
    /// Whoever fetches in this order pays one round trip for a chain of pages, where each is placed only under its resident
    /// parent. To be called after [`Residency::update`]: what the next call does not name any more is not worth fetching.
    pub fn upcoming(&mut self, most: usize) -> Vec<Item> {
        let quiet = self.in_flight.is_empty() && !self.unsettled && !self.prefetching;
        if quiet || self.limits.in_flight == 0 {
            return Vec::new();
        }
        let mut listed = self.best_pages(most);
        // Behind all pages, so that these keep their places.
        for &column in &self.in_flight {
            if let Item::Column(_, group) = column {
                let material = &mut self.materials[column.material()];
                let rank = material.root_rank(group, self.pin_pages, &mut self.blocks);
                listed.push(Listed {
                    item: column,
                    rank,
                    after: None,
                });
            }
        }
        self.in_order(&listed)
    }

    /// Whether the last votes, or those ahead, want an item whose group is open, resident or not. What they want but
    /// [`Residency::upcoming`] does not name stands further down than it looks.
    pub fn wants(&self, item: Item) -> bool {
        self.materials.get(item.material()).is_some() && self.rank(item).is_wanted()
    }

    /// How soon an item of this rank is to come. A column has the rank of its root.
    pub(super) fn urgency(&self, item: Item, rank: Rank) -> Urgency {
        let value = if rank.is_present() { rank.value } else { rank.ahead };
        let bytes = self.materials[item.material()].opening_bytes(item);
        Urgency {
            per_byte: if bytes > 0 {
                value / bytes as f64
            } else {
                f64::INFINITY
            },
            rank,
            column: matches!(item, Item::Column(..)),
        }
    }

    /// The pages with the highest ranks that are not resident, the highest first: those that get a slot. Ranks fall along the
    /// paths from the roots, so these are found from what could be added at once downwards.
    fn best_pages(&mut self, most: usize) -> Vec<Listed> {
        let free = self.pages.free() as usize;
        let most_places = most.saturating_add(self.failures.len());
        if most_places > free {
            self.pages.forget_order();
            self.order_pages(most_places);
        }
        let mut open = self.first_pages(most);
        let mut listed: Vec<Listed> = Vec::new();
        let mut places = 0usize;
        while let Some((rank, after)) = open.pop()
            && listed.len() < most
        {
            let material = &self.materials[usize::from(rank.material.0)];
            let Some(item) = material.page_of(&rank) else {
                continue;
            };
            let in_flight = self.in_flight.contains(&item);
            let gets_slot = match places.checked_sub(free) {
                None => true,
                Some(nth) => self.pages.nth_to_go(nth).is_some_and(|lowest| match in_flight {
                    true => rank.exceeds(lowest),
                    false => rank.exceeds_by_margin(lowest),
                }),
            };
            if !gets_slot {
                break;
            }
            if let Some(waits) = self.waits(item) {
                places += usize::from(waits);
                continue;
            }
            places += 1;
            let after_this = Reverse(listed.len());
            if self.column_comes(rank.material.0, rank.group.0) {
                material.for_each_child(rank.tile.0, |child| {
                    let rank = material.page_rank(rank.group.0.into(), child, self.pin_pages);
                    if rank.is_wanted() {
                        open.push((rank, after_this));
                    }
                });
            }
            let after = (after.0 < usize::MAX).then_some(after.0);
            listed.push(Listed { item, rank, after });
        }
        listed
    }

    /// The pages right below what is resident, and roots; each after nothing ([`usize::MAX`]).
    fn first_pages(&self, most: usize) -> BinaryHeap<(Rank, Reverse<usize>)> {
        let first = |rank: Rank| (rank, Reverse(usize::MAX));
        // The n highest of all are pages of the n groups with the highest of their own; some of these wait.
        let mut groups = Highest::new(most.saturating_add(self.failures.len()));
        for rank in self.materials.iter().flat_map(|material| material.groups()) {
            rank.highest.into_iter().for_each(|rank| groups.push(rank));
        }
        let mut open = BinaryHeap::new();
        for Rank { material, group, .. } in groups.into_vec() {
            let material = &self.materials[usize::from(material.0)];
            material.for_each_addable(group.0.into(), self.pin_pages, |rank| open.push(first(rank)));
        }
        for column in &self.in_flight {
            if let Item::Column(MaterialId(material), group) = *column {
                let material = &self.materials[usize::from(material)];
                material.for_each_below_residents(group.into(), |tile| {
                    let rank = material.page_rank(group.into(), tile, self.pin_pages);
                    if rank.is_wanted() {
                        open.push(first(rank));
                    }
                });
            }
        }
        open
    }

    /// Whether the column of a group is resident or in flight.
    fn column_comes(&self, material: u16, group: u16) -> bool {
        let column = Item::Column(MaterialId(material), group);
        self.slot(column).is_some() || self.in_flight.contains(&column)
    }

    /// Whether an item that has failed and is to be left alone for now keeps a place; `None` for all other items.
    fn waits(&self, item: Item) -> Option<bool> {
        let failure = self.failures.get(&item)?;
        (failure.retry > self.now && !self.in_flight.contains(&item))
            .then_some(failure.count < super::PATIENCE)
    }

    /// The most urgent first of those whose predecessor is on the list already.
    fn in_order(&self, listed: &[Listed]) -> Vec<Item> {
        let columns: HashMap<(u16, u16), usize> = listed
            .iter()
            .enumerate()
            .filter_map(|(at, listed)| match listed.item {
                Item::Column(MaterialId(material), group) => Some(((material, group), at)),
                Item::Page(..) => None,
            })
            .collect();
        let (mut first, mut next) = (vec![usize::MAX; listed.len()], vec![usize::MAX; listed.len()]);
        let mut open = BinaryHeap::new();
        for (at, one) in listed.iter().enumerate() {
            let Rank {
                material,
                group,
                tile,
                ..
            } = one.rank;
            let is_root = tile.0 == 0;
            let column = columns.get(&(material.0, group.0)).filter(|_| !is_root);
            match one.after.or(column.copied()) {
                Some(before) => next[at] = std::mem::replace(&mut first[before], at),
                None => open.push((self.urgency(one.item, one.rank), at)),
            }
        }
        let mut order = Vec::with_capacity(listed.len());
        while let Some((_, at)) = open.pop() {
            order.push(listed[at].item);
            let mut after = first[at];
            while let Some(one) = listed.get(after) {
                open.push((self.urgency(one.item, one.rank), after));
                after = next[after];
            }
        }
        order
    }
}
