//! From votes to requests.

use std::cmp::Reverse;

#[cfg(not(target_arch = "wasm32"))]
use rayon::prelude::*;

use super::{
    Item, MaterialId, PATIENCE, Plan, Residency, Vote,
    material::Material,
    pool::Pool,
    rank::{Highest, Rank},
    value::Blocks,
};

/// An item that asks for a place.
#[derive(Clone, Copy)]
struct Claim {
    rank: Rank,
    item: Item,
    state: State,
}

#[derive(Clone, Copy, PartialEq)]
enum State {
    /// Asked for already.
    InFlight,
    /// Could be asked for now.
    New,
    /// Has failed and must wait for its next attempt.
    Waiting,
}

impl Residency {
    /// Takes the votes of the newest feedback, which replace all earlier ones, and says what to ask for.
    /// Votes for unknown materials or tiles are ignored.
    pub fn update(&mut self, votes: &[Vote]) -> Plan {
        if self.settled() && self.failures.is_empty() && self.votes == votes {
            return Plan::default();
        }
        self.now += 1;
        self.take_votes(votes);
        self.pages.forget_order();
        self.columns.forget_order();
        let mut plan = Plan::default();
        let columns = self.choose_columns(&mut plan);
        let pages = self.choose_pages(&mut plan);
        self.unsettled = [&columns, &pages]
            .into_iter()
            .flatten()
            .any(|claim| claim.state != State::InFlight);

        let mut wanted: Vec<Claim> = columns
            .into_iter()
            .chain(pages)
            .filter(|claim| claim.state == State::New)
            .collect();
        // Stable: where a column and its root rank the same, the column, which came first, stays first.
        wanted.sort_by_key(|claim| Reverse(claim.rank));
        wanted.truncate(self.room_in_flight());
        plan.request = wanted.into_iter().map(|claim| claim.item).collect();
        self.in_flight.extend(&plan.request);
        plan
    }

    fn take_votes(&mut self, votes: &[Vote]) {
        let mut by_material = vec![Vec::new(); self.materials.len()];
        self.pixels = 0;
        self.votes.clear();
        self.votes.extend_from_slice(votes);
        for vote in votes {
            let at = usize::from(vote.material.0);
            if vote.pixels > 0
                && self
                    .materials
                    .get(at)
                    .is_some_and(|material| material.has_tile(vote.tile))
            {
                by_material[at].push((vote.tile, u64::from(vote.pixels)));
                self.pixels += u64::from(vote.pixels);
            }
        }
        let now = self.now;
        // Materials do not touch each other, so the result is the same with any number of threads.
        #[cfg(not(target_arch = "wasm32"))]
        (self.materials.par_iter_mut(), by_material)
            .into_par_iter()
            .for_each_init(Blocks::default, |blocks, (material, votes)| {
                material.set_votes(votes, now, blocks)
            });
        #[cfg(target_arch = "wasm32")]
        {
            let mut blocks = Blocks::default();
            let votes = self.materials.iter_mut().zip(by_material);
            votes.for_each(|(material, votes)| material.set_votes(votes, now, &mut blocks));
        }
    }

    /// Whether each visible material can have one item of its first group in the pool for sure.
    pub(super) fn pins(&self, pool: &Pool) -> bool {
        self.materials
            .iter()
            .filter(|material| material.visible())
            .count()
            <= pool.capacity() as usize
    }

    fn choose_columns(&mut self, plan: &mut Plan) -> Vec<Claim> {
        let pin = self.pins(&self.columns);
        let columns: Vec<Item> = self
            .in_flight
            .iter()
            .copied()
            .filter(|item| matches!(item, Item::Column(..)))
            .collect();
        let mut claims = self.claims_in_flight(columns, pin, plan);
        let mut highest = Highest::new(self.most_claims());
        for material in &self.materials {
            material.for_each_addable_column(pin, |rank| highest.push(rank));
        }
        for rank in highest.into_vec() {
            let item = Item::Column(MaterialId(rank.material.0), rank.group.0);
            claims.extend(self.new_claim(rank, item));
        }
        if claims.len() > self.columns.free() as usize {
            let materials = &self.materials;
            self.columns
                .order(claims.len(), |item| materials[item.material()].rank(item, pin));
        }
        let mut chosen = choose(&self.columns, claims, plan);
        self.forget_cancelled(plan);

        self.materials.iter_mut().for_each(Material::close_groups);
        for claim in &mut chosen {
            let Item::Column(_, group) = claim.item else {
                continue;
            };
            let material = &mut self.materials[claim.item.material()];
            material.groups[usize::from(group)].open = true;
            claim.rank = material.column_urgency(group.into(), claim.rank);
        }
        chosen
    }

    fn choose_pages(&mut self, plan: &mut Plan) -> Vec<Claim> {
        let pin = self.pins(&self.pages);
        let pages: Vec<Item> = self
            .in_flight
            .iter()
            .copied()
            .filter(|item| matches!(item, Item::Page(..)))
            .collect();
        let mut claims = self.claims_in_flight(pages, pin, plan);
        let lowest = (self.pages.free() == 0).then(|| {
            self.pages
                .iter()
                .map(|(item, _)| self.materials[item.material()].rank(item, pin))
                .min()
        });
        let mut highest = Highest::new(self.most_claims());
        for material in &self.materials {
            material.for_each_addable_page(pin, |rank| match lowest {
                Some(Some(lowest)) if !rank.exceeds_by_margin(&lowest) => {}
                Some(None) => {}
                _ => highest.push(rank),
            });
        }
        for rank in highest.into_vec() {
            let item = self.materials[usize::from(rank.material.0)].page_of(&rank);
            claims.extend(item.and_then(|item| self.new_claim(rank, item)));
        }
        if claims.len() > self.pages.free() as usize {
            let materials = &self.materials;
            self.pages
                .order(claims.len(), |item| materials[item.material()].rank(item, pin));
        }
        let chosen = choose(&self.pages, claims, plan);
        self.forget_cancelled(plan);
        chosen
    }

    /// Claims of what is in flight and still of use; the rest is cancelled.
    fn claims_in_flight(&self, items: Vec<Item>, pin: bool, plan: &mut Plan) -> Vec<Claim> {
        let mut claims = Vec::new();
        for item in items {
            let material = &self.materials[item.material()];
            let rank = material.rank(item, pin);
            let reachable = match item {
                Item::Page(_, page) => material.reachable(page),
                Item::Column(..) => true,
            };
            if reachable && rank.value > 0.0 {
                claims.push(Claim {
                    rank,
                    item,
                    state: State::InFlight,
                });
            } else {
                plan.cancel.push(item);
            }
        }
        claims
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

    fn room_in_flight(&self) -> usize {
        self.limits.in_flight.saturating_sub(self.in_flight.len())
    }

    /// Enough of the highest ranks to find every item that can be asked for now among them, though those in
    /// flight and those waiting rank above it.
    fn most_claims(&self) -> usize {
        self.limits
            .in_flight
            .saturating_add(self.in_flight.len())
            .saturating_add(self.failures.len())
    }

    fn forget_cancelled(&mut self, plan: &Plan) {
        for item in &plan.cancel {
            self.in_flight.remove(item);
        }
    }
}

/// The claims that are worth their places: the highest takes the first free slot or the place of the lowest
/// resident, the second the next, and so on. Those in flight that are not are cancelled.
///
/// An accepted claim is worth more than what gives way for it and for all claims above it, so whatever the
/// order of arrival, each finds something of less worth.
fn choose(pool: &Pool, mut claims: Vec<Claim>, plan: &mut Plan) -> Vec<Claim> {
    claims.sort_unstable_by_key(|claim| Reverse(claim.rank));
    let free = pool.free() as usize;
    let mut chosen = Vec::new();
    for claim in claims {
        let place = chosen.len();
        let worth_it = place < free
            || pool
                .nth_to_go(place - free)
                .is_some_and(|lowest| match claim.state {
                    State::InFlight => claim.rank.exceeds(lowest),
                    State::New | State::Waiting => claim.rank.exceeds_by_margin(lowest),
                });
        match claim.state {
            _ if worth_it => chosen.push(claim),
            State::InFlight => plan.cancel.push(claim.item),
            State::New | State::Waiting => {}
        }
    }
    chosen
}
