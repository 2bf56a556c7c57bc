//! Residency worked out anew from everything in every update: nothing is kept but slots, what is in flight, failures, and
//! when each tile was last wanted. The rules are those of `engine::residency`.

mod worth;

use std::collections::{BTreeMap, BTreeSet};

use engine::residency::{
    HEAD_BYTES, Item, LONGEST_BACK_OFF, Limits, MaterialId, MaterialInfo, Move, PATIENCE, Placement, Plan,
    Resized, Slot, Vote,
};
use tileset::{PageId, Tile};
use worth::{Rank, compare, exceeds, exceeds_by_margin, is_wanted};

pub(crate) struct Plain {
    limits: Limits,
    materials: Vec<MaterialInfo>,
    /// By slot; pages, columns.
    pages: Vec<Item>,
    columns: Vec<Item>,
    in_flight: BTreeSet<Item>,
    failures: BTreeMap<Item, (u32, u64)>,
    now: u64,
    last_wanted: BTreeMap<(u16, u32), u64>,
    votes: [Vec<Vote>; 2],
    /// By material, group, tile and class; what follows from the votes.
    values: BTreeMap<(u16, u16, Tile, usize), f64>,
    /// By material, group and class.
    worths: BTreeMap<(u16, u16, usize), f64>,
    /// Groups whose columns are about to be asked for, or in flight.
    opened: BTreeSet<(u16, u16)>,
}

impl Plain {
    pub(crate) fn new(limits: Limits, materials: &[MaterialInfo]) -> Self {
        Self {
            limits,
            materials: materials.to_vec(),
            pages: Vec::new(),
            columns: Vec::new(),
            in_flight: BTreeSet::new(),
            failures: BTreeMap::new(),
            now: 0,
            last_wanted: BTreeMap::new(),
            votes: Default::default(),
            values: BTreeMap::new(),
            worths: BTreeMap::new(),
            opened: BTreeSet::new(),
        }
    }

    pub(crate) fn resident(&self) -> Vec<(Item, Slot)> {
        let slots = |items: &[Item]| {
            (0..)
                .map(Slot)
                .zip(items.to_vec())
                .map(|(slot, item)| (item, slot))
                .collect()
        };
        let [pages, columns]: [Vec<_>; 2] = [slots(&self.pages), slots(&self.columns)];
        [pages, columns].concat()
    }

    fn has(&self, item: Item) -> bool {
        self.pages.contains(&item) || self.columns.contains(&item)
    }

    fn reachable(&self, item: Item) -> bool {
        let Item::Page(material, page) = item else {
            return true;
        };
        let pyramid = self.materials[usize::from(material.0)].pyramid;
        pyramid.parent(page.tile).is_none_or(|tile| {
            self.has(Item::Page(material, PageId { tile, ..page }))
                && self.has(Item::Column(material, page.group))
        })
    }

    /// All pages and columns that there are.
    fn items(&self, pages: bool) -> Vec<Item> {
        let mut items = Vec::new();
        for (material, info) in (0..).map(MaterialId).zip(&self.materials) {
            for group in 0..info.groups {
                if pages {
                    items.extend(
                        info.pyramid
                            .tiles()
                            .map(|tile| Item::Page(material, PageId { group, tile })),
                    );
                } else {
                    items.push(Item::Column(material, group));
                }
            }
        }
        items
    }

    fn bytes(&self, item: Item) -> u64 {
        let (Item::Page(MaterialId(material), _) | Item::Column(MaterialId(material), _)) = item;
        let info = &self.materials[usize::from(material)];
        let bytes = match item {
            Item::Page(_, page) => {
                let tile = info.pyramid.tile_index(page.tile).expect("a tile");
                info.page_bytes
                    .get((u32::from(page.group) * info.pyramid.tile_count() + tile) as usize)
            }
            Item::Column(_, group) => info.column_bytes.get(usize::from(group)),
        };
        bytes.copied().unwrap_or(0).into()
    }

    fn sorted(&self, items: &[Item]) -> Vec<(Rank, usize)> {
        let mut ranks: Vec<_> = items
            .iter()
            .enumerate()
            .map(|(slot, item)| (self.rank(*item), slot))
            .collect();
        ranks.sort_by(|a, b| compare(&a.0, &b.0));
        ranks
    }

    pub(crate) fn update(&mut self, votes: &[Vote], ahead: &[Vote]) -> Plan {
        self.now += 1;
        let valid = |votes: &[Vote]| -> Vec<Vote> {
            let known = |vote: &&Vote| {
                let info = self.materials.get(usize::from(vote.material.0));
                vote.pixels > 0 && info.is_some_and(|info| info.pyramid.tile_at(vote.tile).is_some())
            };
            votes.iter().filter(known).copied().collect()
        };
        let votes = [valid(votes), valid(ahead)];
        if self.votes != votes {
            self.votes = votes;
            self.find_values();
        }
        for (material, info) in (0..).zip(self.materials.clone()) {
            for (index, tile) in (0..).zip(info.pyramid.tiles()) {
                if self.count(material, tile, 0) > 0 {
                    self.last_wanted.insert((material, index), self.now);
                }
            }
        }
        let mut plan = Plan::default();
        let columns = self.choose(false, &mut plan);
        self.opened = columns.iter().map(|(_, item, _)| column_of(*item)).collect();
        let columns = columns.into_iter().map(|(mut rank, item, new)| {
            let (material, group) = column_of(item);
            let root = self.root_rank(material, group);
            (rank.0, rank.1, rank.2) = (root.0, root.1, root.2);
            (rank, item, new)
        });
        let columns: Vec<_> = columns.collect();
        let pages = self.choose(true, &mut plan);
        let mut claims = [columns, pages].concat();
        // Stable: a column, which came first, stays before its root.
        claims.sort_by(|a, b| self.urgency(b).partial_cmp(&self.urgency(a)).expect("numbers"));
        self.request(claims, &mut plan);
        plan
    }

    /// Error per byte, within pins, within the present. A column and its root count as one.
    fn urgency(&self, (rank, item, _): &(Rank, Item, Option<bool>)) -> (bool, bool, f64, Rank) {
        let (material, group) = column_of(*item);
        let tile = self.materials[usize::from(material)].pyramid.root();
        let [column, root] = [
            Item::Column(MaterialId(material), group),
            Item::Page(MaterialId(material), PageId { group, tile }),
        ];
        let cost = |item| match self.bytes(item) {
            0 => 0,
            bytes => bytes + HEAD_BYTES,
        };
        let mut bytes = cost(*item);
        for (one, other) in [(column, root), (root, column)] {
            if *item == one && !self.has(other) {
                bytes += cost(other);
            }
        }
        let value = if rank.1 > 0.0 { rank.1 } else { rank.2 };
        let per_byte = if bytes > 0 {
            value / bytes as f64
        } else {
            f64::INFINITY
        };
        (rank.1 > 0.0, rank.0, per_byte, *rank)
    }

    /// What is in flight, and the best pages that can follow it, most error per byte first.
    pub(crate) fn upcoming(&self, most: usize) -> Vec<Item> {
        if self.limits.in_flight == 0 {
            return Vec::new();
        }
        let column_comes = |item: Item| {
            let (material, group) = column_of(item);
            let column = Item::Column(MaterialId(material), group);
            self.has(column) || self.in_flight.contains(&column)
        };
        let parent = |item: Item| match item {
            Item::Page(material, page) => {
                let pyramid = self.materials[usize::from(material.0)].pyramid;
                let tile = pyramid.parent(page.tile)?;
                Some(Item::Page(material, PageId { tile, ..page }))
            }
            Item::Column(..) => None,
        };
        let mut pages: Vec<(Rank, Item)> = self
            .items(true)
            .into_iter()
            .map(|item| (self.rank(item), item))
            .collect();
        pages.retain(|(rank, item)| is_wanted(rank) && !self.has(*item));
        pages.sort_by(|a, b| compare(&b.0, &a.0));
        let order = self.sorted(&self.pages);
        let free = self.limits.page_slots as usize - self.pages.len();
        let (mut listed, mut places): (Vec<(Rank, Item, Option<bool>)>, usize) = (Vec::new(), 0);
        for (rank, item) in pages {
            let follows = |parent: Item| self.has(parent) || listed.iter().any(|one| one.1 == parent);
            if parent(item).is_some_and(|parent| !(follows(parent) && column_comes(item))) {
                continue;
            }
            let in_flight = self.in_flight.contains(&item);
            let exceeds = if in_flight { exceeds } else { exceeds_by_margin };
            let gives_way = places.checked_sub(free).map(|n| order.get(n));
            if listed.len() == most
                || gives_way.is_some_and(|lowest| !lowest.is_some_and(|lowest| exceeds(&rank, &lowest.0)))
            {
                break;
            }
            match self.failures.get(&item) {
                Some((count, retry)) if *retry > self.now && !in_flight => {
                    places += usize::from(*count < PATIENCE);
                }
                _ => {
                    places += 1;
                    listed.push((rank, item, None));
                }
            }
        }
        for item in &self.in_flight {
            if let Item::Column(MaterialId(material), group) = item {
                listed.push((self.root_rank(*material, *group), *item, None));
            }
        }
        // Columns come last, and are taken first of equals.
        let mut found = Vec::new();
        while !listed.is_empty() {
            let waits = |one: &(Rank, Item, Option<bool>)| {
                let (material, group) = column_of(one.1);
                let column = Item::Column(MaterialId(material), group);
                parent(one.1)
                    .is_some_and(|parent| listed.iter().any(|other| other.1 == parent || other.1 == column))
            };
            let next = (0..listed.len())
                .filter(|&at| !waits(&listed[at]))
                .max_by(|&a, &b| {
                    self.urgency(&listed[a])
                        .partial_cmp(&self.urgency(&listed[b]))
                        .expect("numbers")
                })
                .expect("roots wait for nothing");
            found.push(listed.remove(next).1);
        }
        found
    }

    /// Claims that get a place: rank, item, and whether it is to be asked for; `None` where it has to wait.
    fn choose(&mut self, pages: bool, plan: &mut Plan) -> Vec<(Rank, Item, Option<bool>)> {
        let (slots, residents) = if pages {
            (self.limits.page_slots, &self.pages)
        } else {
            (self.limits.column_slots, &self.columns)
        };
        let lowest_page = self.sorted(&self.pages).first().map(|(rank, _)| *rank);
        let page_fits = |rank: &Rank| {
            self.pages.len() < self.limits.page_slots as usize
                || lowest_page.is_some_and(|lowest| exceeds_by_margin(rank, &lowest))
        };
        let mut claims = Vec::new();
        let mut candidates = self.items(pages);
        // No more of them than could be asked for if all that is in flight and has failed ranked above.
        let present = self
            .in_flight
            .iter()
            .filter(|item| self.rank(**item).1 > 0.0)
            .count();
        let most = self.limits.in_flight + present + self.failures.len();
        candidates.retain(|item| {
            let (material, group) = column_of(*item);
            let fits = if pages {
                self.reachable(*item) && page_fits(&self.rank(*item))
            } else {
                page_fits(&self.root_rank(material, group))
            };
            !self.has(*item) && is_wanted(&self.rank(*item)) && fits
        });
        candidates.sort_by(|a, b| compare(&self.rank(*b), &self.rank(*a)));
        candidates.truncate(most);
        candidates.retain(|item| !self.in_flight.contains(item));
        let in_flight = self.in_flight.iter().copied();
        candidates.extend(in_flight.filter(|item| matches!(item, Item::Page(..)) == pages));
        for item in candidates {
            let rank = self.rank(item);
            if self.in_flight.contains(&item) {
                if is_wanted(&rank) && self.reachable(item) {
                    claims.push((rank, item, Some(false)));
                } else {
                    plan.cancel.push(item);
                }
            } else if is_wanted(&rank) && self.reachable(item) && !self.has(item) {
                match self.failures.get(&item) {
                    Some((count, retry)) if *retry > self.now && *count >= PATIENCE => {}
                    Some((_, retry)) if *retry > self.now => claims.push((rank, item, None)),
                    _ => claims.push((rank, item, Some(true))),
                }
            }
        }
        claims.sort_by(|a, b| compare(&b.0, &a.0));
        let order = self.sorted(residents);
        let free = slots as usize - residents.len();
        let mut chosen: Vec<(Rank, Item, Option<bool>)> = Vec::new();
        for claim in claims {
            let gives_way = chosen.len().checked_sub(free).map(|n| order.get(n));
            let worth_it = match gives_way {
                None => true,
                Some(None) => false,
                Some(Some((lowest, _))) if claim.2 == Some(false) => exceeds(&claim.0, lowest),
                Some(Some((lowest, _))) => exceeds_by_margin(&claim.0, lowest),
            };
            if worth_it {
                chosen.push(claim);
            } else if claim.2 == Some(false) {
                plan.cancel.push(claim.1);
            }
        }
        plan.cancel.iter().for_each(|item| {
            self.in_flight.remove(item);
        });
        chosen
    }

    fn fits(&self, bytes: u64, without: &[Item]) -> bool {
        let staying = self.in_flight.iter().filter(|item| !without.contains(item));
        let sizes: Vec<u64> = staying.map(|item| self.bytes(*item)).collect();
        sizes.len() < self.limits.in_flight
            && (sizes.is_empty() || sizes.iter().sum::<u64>() + bytes <= self.limits.bytes_in_flight)
    }

    fn request(&mut self, claims: Vec<(Rank, Item, Option<bool>)>, plan: &mut Plan) {
        let ahead = claims
            .iter()
            .filter(|(rank, _, new)| *new == Some(false) && rank.1 == 0.0);
        let mut ahead: Vec<Item> = ahead.map(|claim| claim.1).collect();
        for (rank, item, _) in claims.into_iter().filter(|claim| claim.2 == Some(true)) {
            let bytes = self.bytes(item);
            if rank.1 > 0.0 && self.fits(bytes, &ahead) {
                while !self.fits(bytes, &[]) {
                    let lowest = ahead.pop().expect("one that gives way");
                    self.in_flight.remove(&lowest);
                    plan.cancel.push(lowest);
                }
            }
            if !self.fits(bytes, &[]) {
                return;
            }
            self.in_flight.insert(item);
            plan.request.push(item);
        }
    }

    pub(crate) fn arrived(&mut self, item: Item) -> Placement {
        if !self.in_flight.remove(&item) {
            return Placement::Drop;
        }
        self.failures.remove(&item);
        let placement = self.place(item);
        if let Item::Column(MaterialId(material), group) = item {
            self.opened.remove(&(material, group));
        }
        if let Placement::Place {
            evicted: Some(Item::Column(MaterialId(material), group)),
            ..
        } = placement
        {
            self.opened.remove(&(material, group));
        }
        placement
    }

    fn place(&mut self, item: Item) -> Placement {
        if !self.reachable(item) {
            return Placement::Drop;
        }
        let rank = self.rank(item);
        let (slots, residents) = match item {
            Item::Page(..) => (self.limits.page_slots, &self.pages),
            Item::Column(..) => (self.limits.column_slots, &self.columns),
        };
        let order = self.sorted(residents);
        let free = residents.len() < slots as usize;
        let residents = match item {
            Item::Page(..) => &mut self.pages,
            Item::Column(..) => &mut self.columns,
        };
        if free {
            residents.push(item);
            let slot = Slot(residents.len() as u32 - 1);
            return Placement::Place { slot, evicted: None };
        }
        match order.first() {
            Some((lowest, slot)) if exceeds(&rank, lowest) => Placement::Place {
                slot: Slot(*slot as u32),
                evicted: Some(std::mem::replace(&mut residents[*slot], item)),
            },
            _ => Placement::Drop,
        }
    }

    pub(crate) fn failed(&mut self, item: Item) {
        if !self.in_flight.remove(&item) {
            return;
        }
        if let Item::Column(MaterialId(material), group) = item {
            self.opened.remove(&(material, group));
        }
        let failure = self.failures.entry(item).or_insert((0, 0));
        failure.0 += 1;
        failure.1 = self.now + (1u64 << failure.0.min(40)).min(LONGEST_BACK_OFF);
    }

    pub(crate) fn set_limits(&mut self, limits: Limits) -> Resized {
        self.limits = limits;
        let mut resized = Resized::default();
        for pages in [false, true] {
            let (items, slots) = if pages {
                (self.pages.clone(), limits.page_slots as usize)
            } else {
                (self.columns.clone(), limits.column_slots as usize)
            };
            let mut gone: Vec<usize> = self.sorted(&items).into_iter().map(|(_, slot)| slot).collect();
            gone.truncate(items.len().saturating_sub(slots));
            gone.sort_unstable();
            resized
                .evicted
                .extend(gone.iter().map(|&slot| (items[slot], Slot(slot as u32))));
            let mut kept = items.clone();
            let mut free = gone.iter().filter(|slot| **slot < slots);
            for (from, &item) in items.iter().enumerate().skip(slots) {
                if !gone.contains(&from) {
                    let &to = free.next().expect("as many free slots as there are to move");
                    kept[to] = item;
                    let (from, to) = (Slot(from as u32), Slot(to as u32));
                    resized.moved.push(Move { item, from, to });
                }
            }
            kept.truncate(slots);
            *(if pages { &mut self.pages } else { &mut self.columns }) = kept;
        }
        let mut in_flight: Vec<Item> = self.in_flight.iter().copied().collect();
        in_flight.sort_by(|a, b| compare(&self.rank(*a), &self.rank(*b)));
        for item in in_flight {
            let bytes: u64 = self.in_flight.iter().map(|item| self.bytes(*item)).sum();
            let count = self.in_flight.len();
            if count > limits.in_flight || (bytes > limits.bytes_in_flight && count > 1) {
                self.in_flight.remove(&item);
                resized.cancel.push(item);
            }
        }
        resized
    }
}

fn column_of(item: Item) -> (u16, u16) {
    match item {
        Item::Column(MaterialId(material), group)
        | Item::Page(MaterialId(material), PageId { group, .. }) => (material, group),
    }
}
