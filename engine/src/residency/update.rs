//! From votes to requests.

use std::cmp::Reverse;

#[cfg(not(target_arch = "wasm32"))]
use rayon::prelude::*;

use super::{
    Item, MaterialId, PATIENCE, Plan, Residency, SLOTS_PER_PIN, TileVotes, Vote,
    claim::{Claim, State, choose},
    material::Material,
    rank::{Highest, Rank},
    value::Blocks,
};

/// Pages to value from which on more than one thread is worth waking.
#[cfg(not(target_arch = "wasm32"))]
const PARALLEL_PAGES: usize = 1 << 16;

/// What the rank of a page that is not resident must exceed.
enum Floor {
    /// There is a free slot.
    Free,
    /// The lowest rank of the cache.
    Lowest(Rank),
    /// There are no slots at all.
    Closed,
}

impl Floor {
    fn admits(&self, rank: &Rank) -> bool {
        match self {
            Floor::Free => true,
            Floor::Lowest(lowest) => rank.exceeds_by_margin(lowest),
            Floor::Closed => false,
        }
    }
}

impl Residency {
    /// Takes the votes of the newest feedback, which replace all earlier ones, and says what to ask for.
    ///
    /// `ahead` are votes for what may be seen soon. They never displace or delay what `votes` want: see the module's
    /// documentation. Votes for unknown materials or tiles are ignored.
    pub fn update(&mut self, votes: &[Vote], ahead: &[Vote]) -> Plan {
        let quiet = !self.unsettled && !self.prefetching && self.in_flight.is_empty();
        if quiet && self.failures.is_empty() && self.votes[0] == votes && self.votes[1] == ahead {
            return Plan::default();
        }
        self.now += 1;
        self.take_votes([votes, ahead]);
        self.pages.forget_order();
        self.columns.forget_order();
        let mut plan = Plan::default();
        let columns = self.choose_columns(&mut plan);
        let pages = self.choose_pages(&mut plan);
        let mut claims: Vec<Claim> = columns.into_iter().chain(pages).collect();
        claims.sort_by_cached_key(|claim| Reverse(self.urgency(claim.item, claim.rank)));
        let open = |claim: &&Claim| claim.state != State::InFlight;
        self.unsettled = claims.iter().filter(open).any(|claim| claim.rank.is_present());
        self.prefetching = claims.iter().filter(open).any(|claim| !claim.rank.is_present());
        self.request(claims, &mut plan);
        plan
    }

    /// Asks for the first claims, as far as the limits go; what is in flight for votes ahead gives way to the present.
    fn request(&mut self, claims: Vec<Claim>, plan: &mut Plan) {
        let (in_flight, new): (Vec<Claim>, Vec<Claim>) = claims
            .into_iter()
            .filter(|claim| claim.state != State::Waiting)
            .partition(|claim| claim.state == State::InFlight);
        let mut ahead = in_flight;
        ahead.retain(|claim| !claim.rank.is_present());
        let mut ahead_bytes: u64 = ahead.iter().map(|claim| self.bytes(claim.item)).sum();
        for claim in new {
            let bytes = self.bytes(claim.item);
            if claim.rank.is_present() && self.has_room(bytes, ahead.len(), ahead_bytes) {
                while !self.has_room(bytes, 0, 0) {
                    let Some(lowest) = ahead.pop() else { break };
                    ahead_bytes -= self.bytes(lowest.item);
                    self.take_off(lowest.item);
                    plan.cancel.push(lowest.item);
                    self.prefetching = true;
                }
            }
            if !self.has_room(bytes, 0, 0) {
                break;
            }
            self.in_flight.insert(claim.item);
            self.bytes_in_flight += bytes;
            plan.request.push(claim.item);
        }
    }

    /// Whether a record of this size can be asked for once this much in flight is cancelled.
    fn has_room(&self, bytes: u64, cancelled: usize, cancelled_bytes: u64) -> bool {
        let items = self.in_flight.len() - cancelled;
        let in_flight = self.bytes_in_flight - cancelled_bytes;
        items < self.limits.in_flight
            && (items == 0 || in_flight.saturating_add(bytes) <= self.limits.bytes_in_flight)
    }

    fn take_votes(&mut self, votes: [&[Vote]; 2]) {
        let mut sorted = std::mem::take(&mut self.sorted);
        sorted.resize_with(self.materials.len(), Default::default);
        self.pixels = 0;
        for (class, votes) in votes.into_iter().enumerate() {
            if self.votes[class] != votes {
                self.votes[class].clear();
                self.votes[class].extend_from_slice(votes);
            }
            sorted.iter_mut().for_each(|votes| votes[class].clear());
            for vote in votes {
                let at = usize::from(vote.material.0);
                let known = self
                    .materials
                    .get(at)
                    .is_some_and(|material| material.has_tile(vote.tile));
                if vote.pixels > 0 && known {
                    sorted[at][class].push((vote.tile, u64::from(vote.pixels)));
                    self.pixels += if class == 0 { u64::from(vote.pixels) } else { 0 };
                }
            }
            sorted.iter_mut().for_each(|votes| sort(&mut votes[class]));
        }
        let (now, pin) = (self.now, self.pin_pages);
        let changed = self.materials.iter_mut().zip(&mut sorted);
        let changed: Vec<_> = changed
            .filter(|(material, votes)| !material.has_votes(votes))
            .collect();
        let set = |blocks: &mut Blocks, (material, votes): (&mut Material, &mut TileVotes)| {
            material.set_votes(votes, now, pin, blocks);
        };
        #[cfg(not(target_arch = "wasm32"))]
        let pages: usize = changed
            .iter()
            .map(|(material, votes)| material.groups().len() * (votes[0].len() + votes[1].len()))
            .sum();
        // Materials do not touch each other, so the result is the same with any number of threads.
        #[cfg(not(target_arch = "wasm32"))]
        if pages >= PARALLEL_PAGES {
            changed.into_par_iter().for_each_init(Blocks::default, set);
        } else {
            changed.into_iter().for_each(|one| set(&mut self.blocks, one));
        }
        #[cfg(target_arch = "wasm32")]
        changed.into_iter().for_each(|one| set(&mut self.blocks, one));
        self.sorted = sorted;
        self.find_pins();
    }

    /// Whether the caches have slots enough to pin the column and the root of each visible material's first group.
    pub(super) fn find_pins(&mut self) {
        let visible = self
            .materials
            .iter()
            .filter(|material| material.visible())
            .count();
        let enough = |slots: u32| visible <= (slots / SLOTS_PER_PIN) as usize;
        self.pin_columns = enough(self.columns.capacity());
        let pin = enough(self.pages.capacity());
        if std::mem::replace(&mut self.pin_pages, pin) != pin {
            self.materials
                .iter_mut()
                .for_each(|material| material.pins_changed(pin));
        }
    }

    fn floor(&self) -> Floor {
        if self.pages.free() > 0 {
            return Floor::Free;
        }
        let groups = self.materials.iter().flat_map(Material::groups);
        groups
            .filter_map(|group| group.lowest)
            .min()
            .map_or(Floor::Closed, Floor::Lowest)
    }

    fn choose_columns(&mut self, plan: &mut Plan) -> Vec<Claim> {
        let pin = self.pin_columns;
        let columns = self
            .in_flight
            .iter()
            .copied()
            .filter(|item| matches!(item, Item::Column(..)));
        let mut claims = self.claims_in_flight(columns, plan);
        let floor = self.floor();
        let mut highest = Highest::new(self.most_claims());
        let mut worth_asking = Vec::new();
        let lowest =
            (self.columns.free() == 0).then(|| self.columns.iter().map(|(item, _)| self.rank(item)).min());
        for material in &mut self.materials {
            material.for_each_addable_column(pin, |rank| match lowest {
                Some(Some(lowest)) if !rank.exceeds_by_margin(&lowest) => {}
                Some(None) => {}
                _ => worth_asking.push(rank),
            });
            for rank in worth_asking.drain(..) {
                // A column without a place for any page of its group is of no use.
                let may_matter = match &floor {
                    Floor::Free => true,
                    Floor::Lowest(lowest) => {
                        (self.pin_pages && rank.group.0 == 0)
                            || material.root_bound(rank.group.0) >= lowest.value
                    }
                    Floor::Closed => false,
                };
                let mut root = || material.root_rank(rank.group.0, self.pin_pages, &mut self.blocks);
                let useful = may_matter && (matches!(floor, Floor::Free) || floor.admits(&root()));
                if useful {
                    highest.push(rank);
                }
            }
        }
        for rank in highest.into_vec() {
            let item = Item::Column(MaterialId(rank.material.0), rank.group.0);
            claims.extend(self.new_claim(rank, item));
        }
        if claims.len() > self.columns.free() as usize {
            self.order_columns(claims.len());
        }
        let mut chosen = choose(&self.columns, claims, plan);
        self.forget_cancelled(plan);
        self.open_groups(&mut chosen);
        chosen
    }

    /// Opens the groups of these columns besides those whose columns are resident, and no others; gives the columns
    /// their ranks in the order of requests.
    fn open_groups(&mut self, columns: &mut [Claim]) {
        let pin = self.pin_pages;
        let before = std::mem::take(&mut self.opened);
        self.opened.extend(columns.iter().map(|claim| claim.item));
        for &item in &before {
            if self.slot(item).is_none() && !self.opened.contains(&item) {
                self.set_open(item, false);
            }
        }
        for claim in columns {
            self.set_open(claim.item, true);
            if let Item::Column(_, group) = claim.item {
                let material = &mut self.materials[claim.item.material()];
                let root = material.root_rank(group, pin, &mut self.blocks);
                let rank = &mut claim.rank;
                (rank.pinned, rank.value, rank.ahead) = (root.pinned, root.value, root.ahead);
            }
        }
    }

    /// Opens or closes the group of a column.
    pub(super) fn set_open(&mut self, column: Item, open: bool) {
        if let Item::Column(_, group) = column {
            self.materials[column.material()].set_open(group, open, self.pin_pages, &mut self.blocks);
        }
    }

    fn choose_pages(&mut self, plan: &mut Plan) -> Vec<Claim> {
        let pages = self
            .in_flight
            .iter()
            .copied()
            .filter(|item| matches!(item, Item::Page(..)));
        let mut claims = self.claims_in_flight(pages, plan);
        let most = self.most_claims();
        // The n highest of all are pages of the n groups with the highest of their own.
        let floor = self.floor();
        let mut groups = Highest::new(most);
        for group in self.materials.iter().flat_map(Material::groups) {
            if let Some(rank) = group.highest.filter(|rank| floor.admits(rank)) {
                groups.push(rank);
            }
        }
        let mut highest = Highest::new(most);
        for Rank { material, group, .. } in groups.into_vec() {
            let material = &self.materials[usize::from(material.0)];
            material.for_each_addable(group.0.into(), self.pin_pages, |rank| {
                if floor.admits(&rank) {
                    highest.push(rank);
                }
            });
        }
        for rank in highest.into_vec() {
            let item = self.materials[usize::from(rank.material.0)].page_of(&rank);
            claims.extend(item.and_then(|item| self.new_claim(rank, item)));
        }
        if claims.len() > self.pages.free() as usize {
            self.order_pages(claims.len());
        }
        let chosen = choose(&self.pages, claims, plan);
        self.forget_cancelled(plan);
        chosen
    }

    /// Finds the pages that give way first, unless they are known: the n lowest of all are pages of the n groups with
    /// the lowest of their own.
    pub(super) fn order_pages(&mut self, at_most: usize) {
        if self.pages.ordered() {
            return;
        }
        let groups = self.materials.iter().flat_map(Material::groups);
        let mut lowest: Vec<Rank> = groups.filter_map(|group| group.lowest).collect();
        if (1..lowest.len()).contains(&at_most) {
            lowest.select_nth_unstable(at_most - 1);
            lowest.truncate(at_most);
        }
        let mut ranks = Vec::new();
        for Rank { material, group, .. } in lowest {
            let material = &self.materials[usize::from(material.0)];
            material.for_each_resident(group.0.into(), self.pin_pages, |rank, slot| {
                ranks.push((rank, slot.0))
            });
        }
        self.pages.order(at_most, ranks);
    }

    /// The same of columns.
    pub(super) fn order_columns(&mut self, at_most: usize) {
        if !self.columns.ordered() {
            let ranks = self
                .columns
                .iter()
                .map(|(item, slot)| (self.rank(item), slot.0))
                .collect();
            self.columns.order(at_most, ranks);
        }
    }

    /// Claims of what is in flight and still of use; the rest is cancelled.
    fn claims_in_flight(&self, items: impl Iterator<Item = Item>, plan: &mut Plan) -> Vec<Claim> {
        let mut claims = Vec::new();
        for item in items {
            let material = &self.materials[item.material()];
            let rank = self.rank(item);
            let reachable = match item {
                Item::Page(_, page) => material.reachable(page),
                Item::Column(..) => true,
            };
            if reachable && rank.is_wanted() {
                let state = State::InFlight;
                claims.push(Claim { rank, item, state });
            } else {
                plan.cancel.push(item);
            }
        }
        claims
    }

    /// What an item is worth now.
    pub(super) fn rank(&self, item: Item) -> Rank {
        let pin = match item {
            Item::Page(..) => self.pin_pages,
            Item::Column(..) => self.pin_columns,
        };
        self.materials[item.material()].rank(item, pin)
    }

    fn new_claim(&self, rank: Rank, item: Item) -> Option<Claim> {
        let state = match self.failures.get(&item) {
            _ if self.in_flight.contains(&item) => return None,
            Some(failure) if failure.retry > self.now && failure.count >= PATIENCE => return None,
            Some(failure) if failure.retry > self.now => State::Waiting,
            _ => State::New,
        };
        Some(Claim { rank, item, state })
    }

    /// Enough of the highest ranks to find every item that can be asked for now among them, though those in
    /// flight and those waiting rank above it. What is in flight for votes ahead ranks below all of the present, and
    /// takes room in flight itself.
    fn most_claims(&self) -> usize {
        let present = self
            .in_flight
            .iter()
            .filter(|item| self.rank(**item).is_present())
            .count();
        self.limits
            .in_flight
            .saturating_add(present)
            .saturating_add(self.failures.len())
    }

    fn forget_cancelled(&mut self, plan: &Plan) {
        plan.cancel.iter().for_each(|item| {
            self.take_off(*item);
        });
    }

    /// An item is no longer in flight. Returns whether it was.
    pub(super) fn take_off(&mut self, item: Item) -> bool {
        let was = self.in_flight.remove(&item);
        if was {
            self.bytes_in_flight -= self.bytes(item);
        }
        was
    }

    fn bytes(&self, item: Item) -> u64 {
        self.materials[item.material()].bytes(item)
    }
}

/// Brings votes into the order of tiles and adds up those for the same one.
fn sort(votes: &mut Vec<(u32, u64)>) {
    if votes.is_sorted_by(|a, b| a.0 < b.0) {
        return;
    }
    votes.sort_unstable();
    votes.dedup_by(|later, earlier| {
        let same = later.0 == earlier.0;
        if same {
            earlier.1 += later.1;
        }
        same
    });
}
