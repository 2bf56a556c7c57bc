//! Who gets a place.

use std::cmp::Reverse;

use super::{Item, Plan, pool::Pool, rank::Rank};

/// An item that asks for a place.
#[derive(Clone, Copy)]
pub(super) struct Claim {
    pub(super) rank: Rank,
    pub(super) item: Item,
    pub(super) state: State,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum State {
    /// Asked for already.
    InFlight,
    /// Could be asked for now.
    New,
    /// Has failed and must wait for its next attempt.
    Waiting,
}

/// The claims that are worth their places: the highest takes the first free slot or the place of the lowest
/// resident, the second the next, and so on. Those in flight that are not are cancelled.
///
/// An accepted claim is worth more than what gives way for it and for all claims above it, so whatever the
/// order of arrival, each finds something of less worth.
pub(super) fn choose(pool: &Pool, mut claims: Vec<Claim>, plan: &mut Plan) -> Vec<Claim> {
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
