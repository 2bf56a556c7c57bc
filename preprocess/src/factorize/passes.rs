//! Which pass comes next, and when there have been enough.
//!
//! Where a rank is asked for, a pass is worth it for what it may add to the energy ‖B·Q‖² of as many terms. Three limits
//! are known without another pass: no more can be added than all that the subspace leaves out; later blocks add less than
//! the last one did; and a subspace that has more vectors than B has terms already holds B.

use super::krylov::{State, Step};
use super::plan::Plan;
use super::ritz::{Projection, RANK_TOLERANCE};
use super::{Enough, Settings};
use crate::Result;

/// No more passes where they could take at most this share off the squared error: half of it off the error.
const WORTHLESS: f64 = 0.01;
/// More passes than usual where each adds more than this share of the energy that the terms have.
const WORTHWHILE: f64 = 0.004;
/// What a block adds is about this share of what the one before it added: from a sixth to a thirtieth on ray-traced
/// materials at rank 100 and at rank 16.
const FALL: f64 = 1.0 / 6.0;

/// What to do after the pass that has just ended; `None` if the subspace is good enough.
pub(super) fn next(
    state: &State,
    plan: &Plan,
    settings: &Settings,
    weights: Option<&[f32]>,
) -> Result<Option<Step>> {
    let width = state.width() + state.pass.q.nrows();
    match state.pass.step {
        Step::Project | Step::Once => return Ok(None),
        Step::Both => match settings.enough {
            // The first block alone would do, but with far more terms than after the second.
            Some(enough) if !state.blocks.is_empty() && is_enough(state, enough) => return Ok(None),
            None if settings.passes.is_none() => return adapted(state, plan, settings, weights),
            _ => {}
        },
        Step::Sketch => {}
    }
    Ok(Some(up_to(plan.usual, width, plan)))
}

/// The last block needs only be projected.
fn up_to(most: usize, width: usize, plan: &Plan) -> Step {
    if most.saturating_sub(width) <= plan.width {
        Step::Project
    } else {
        Step::Both
    }
}

/// The same where neither an error nor a number of passes is asked for.
fn adapted(state: &State, plan: &Plan, settings: &Settings, weights: Option<&[f32]>) -> Result<Option<Step>> {
    let blocks = state
        .blocks
        .iter()
        .map(|block| (block.q.as_ref(), block.y.as_ref()))
        .chain([(state.pass.q.as_ref(), state.pass.y.as_ref())])
        .collect();
    let energy = match weights {
        Some(weights) => state.totals.weighted_energy(weights),
        None => state.totals.energy(),
    };
    let projection = Projection::new(blocks, weights)?;
    let width = projection.width();
    let values = projection.values(width)?;
    let squares = |values: &[f64]| -> f64 { values.iter().map(|value| value * value).sum() };
    let terms = (settings.components as usize).min(width);
    let (kept, captured) = (squares(&values[..terms]), squares(&values));
    let exhausted = values[width - 1] <= RANK_TOLERANCE * values[0];
    let can_gain = energy - captured;
    if exhausted || (width > terms && can_gain <= WORTHLESS * (energy - kept)) || width >= plan.most {
        return Ok(None);
    }
    // What the last block added to the terms that there were before it.
    let before = state.width();
    let mut gained = 0.0;
    if before > 0 {
        let values_before = projection.values(before)?;
        let terms = terms.min(before);
        gained = squares(&values[..terms]) - squares(&values_before[..terms]);
    }
    let worthwhile = |passes: i32| gained * FALL.powi(passes) > WORTHWHILE * kept;
    if width >= plan.usual && !worthwhile(1) {
        return Ok(None);
    }
    let most = if worthwhile(2) { plan.most } else { plan.usual };
    Ok(Some(up_to(most, width, plan)))
}

/// Whether ‖B‖² − ‖B·Q‖² of all blocks and that of the pass is small enough.
fn is_enough(state: &State, enough: Enough) -> bool {
    let projections = state.blocks.iter().map(|block| &block.y).chain([&state.pass.y]);
    let captured: f64 = projections.map(|y| y.squared_norm_l2()).map(f64::from).sum();
    let energy = state.totals.energy();
    let samples = state.totals.energies.len() as f64 * state.pass.q.ncols() as f64;
    energy - captured <= enough.of_scaled(state.scale()).energy(samples, energy)
}
