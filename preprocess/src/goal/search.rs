//! Finding a step and a rank, given a way to try them out.

use crate::Result;

/// What one trial came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Outcome {
    /// Bytes of the archive.
    pub(super) bytes: f64,
    /// Error of all stages together, relative to the BTF.
    pub(super) error: f64,
    /// The part of it that does not depend on the step: rank and half floats.
    pub(super) floor: f64,
}

impl Outcome {
    /// The part of the error that depends on the step.
    fn codec(&self) -> f64 {
        (self.error.powi(2) - self.floor.powi(2)).max(0.0).sqrt()
    }
}

/// Quantizer steps in root mean squares of the BTF that are tried: finer ones lose far less than half floats do.
const FINEST: f64 = 2e-5;
const COARSEST: f64 = 10.0;
/// Trials of one rank at most.
const MAX_TRIALS: u32 = 12;
/// A step is good enough when this share of the limit is used.
const CLOSE: f64 = 0.98;
/// What a trial aims at, to fall on the right side of the limit.
const AIM: f64 = 0.992;

/// Looks for the step at which a smooth, monotonic quantity has a certain size. Errors and bytes are nearly straight in
/// logarithms: a secant between the closest trials on both sides needs two or three.
#[derive(Default)]
struct Root {
    /// Logarithms of the closest steps with less and with more than wanted, and of what the quantity was there.
    less: Option<(f64, f64)>,
    more: Option<(f64, f64)>,
    trials: u32,
}

impl Root {
    /// Takes a trial; the next step to try, or `None` when no better will be found. `slope` is the guess of how many
    /// times the quantity's logarithm changes with the step's.
    fn next(&mut self, step: f64, quantity: f64, wanted: f64, slope: f64) -> Option<f64> {
        self.trials += 1;
        let [x, y, goal] = [step, quantity, wanted].map(|value| value.max(f64::MIN_POSITIVE).ln());
        if y <= goal {
            self.less = Some((x, y));
        } else {
            self.more = Some((x, y));
        }
        let next = match (self.less, self.more) {
            (Some((x0, y0)), Some((x1, y1))) => {
                // Never so close to an end that nothing is learnt; bisection where the secant does not converge.
                let bisect = self.trials > MAX_TRIALS / 2 || y1 <= y0;
                let share = if bisect {
                    0.5
                } else {
                    ((goal - y0) / (y1 - y0)).clamp(0.05, 0.95)
                };
                x0 + share * (x1 - x0)
            }
            _ => x + ((goal - y) / slope).clamp(-3.0, 3.0),
        };
        let next = next.clamp(FINEST.ln(), COARSEST.ln());
        // Not at the end of the range, nor between steps that are all but the same.
        ((next - x).abs() > 1e-4 && self.trials < MAX_TRIALS).then(|| next.exp().clamp(FINEST, COARSEST))
    }
}

/// Tries steps at one rank until the error is at most `limit` and close to it. Gives the best step and its outcome, or
/// `None` if none is within.
pub(super) fn step_for_error(
    limit: f64,
    guess: f64,
    mut trial: impl FnMut(f64) -> Result<Outcome>,
) -> Result<Option<(f64, Outcome)>> {
    let (mut best, mut step, mut root) = (None, guess.clamp(FINEST, COARSEST), Root::default());
    loop {
        let outcome = trial(step)?;
        if outcome.error <= limit {
            best = Some((step, outcome));
        }
        // Only the codec's part follows the step, and there may be no room for it at all.
        let room = (limit * AIM).powi(2) - outcome.floor.powi(2);
        if (CLOSE * limit..=limit).contains(&outcome.error) || room <= 0.0 {
            return Ok(best);
        }
        match root.next(step, outcome.codec(), room.sqrt(), 0.8) {
            Some(next) => step = next,
            None => return Ok(best),
        }
    }
}

/// Tries steps at one rank until the bytes are at most `limit` and close to it. Gives the best step and its outcome, or
/// `None` if none is within.
pub(super) fn step_for_bytes(
    limit: f64,
    guess: f64,
    mut trial: impl FnMut(f64) -> Result<Outcome>,
) -> Result<Option<(f64, Outcome)>> {
    let (mut best, mut step, mut root) = (
        None::<(f64, Outcome)>,
        guess.clamp(FINEST, COARSEST),
        Root::default(),
    );
    loop {
        let outcome = trial(step)?;
        if outcome.bytes <= limit && best.is_none_or(|(_, best)| outcome.error < best.error) {
            best = Some((step, outcome));
        }
        if (CLOSE * limit..=limit).contains(&outcome.bytes) {
            return Ok(best);
        }
        match root.next(step, outcome.bytes, AIM * limit, -0.8) {
            Some(next) => step = next,
            None => return Ok(best),
        }
    }
}

/// Walks over `ranks`, which rise, from the one at `start` in the direction in which `cost` falls; stops where it rises.
/// `cost` is `None` where a rank cannot meet the goal.
pub(super) fn descend(
    ranks: &[usize],
    start: usize,
    mut cost: impl FnMut(usize) -> Result<Option<f64>>,
) -> Result<Option<usize>> {
    let mut best: Option<(usize, f64)> = None;
    // Whether to go on in this direction: a rank that cannot meet the goal says nothing about the next.
    let mut visit = |index: usize, best: &mut Option<(usize, f64)>| -> Result<bool> {
        let Some(value) = cost(ranks[index])? else {
            return Ok(true);
        };
        let better = best.is_none_or(|(_, least)| value < least);
        if better {
            *best = Some((index, value));
        }
        Ok(better)
    };
    visit(start, &mut best)?;
    for index in start + 1..ranks.len() {
        if !visit(index, &mut best)? {
            break;
        }
    }
    if best.is_none_or(|(index, _)| index == start) {
        for index in (0..start).rev() {
            if !visit(index, &mut best)? {
                break;
            }
        }
    }
    Ok(best.map(|(index, _)| ranks[index]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An archive of a falling spectrum: error of rank and codec, bytes of columns and pages.
    fn model(rank: usize, step: f64) -> Outcome {
        let floor = 0.1 / (rank as f64).sqrt();
        let codec = (0.3 * step.powf(0.8)).min(1.0);
        Outcome {
            bytes: rank as f64 * (1000.0 + 4000.0 * (1.0 + 1.0 / step).log2()),
            error: (floor * floor + codec * codec).sqrt(),
            floor,
        }
    }

    #[test]
    fn steps_meet_errors_closely_in_few_trials() {
        for (rank, limit) in [(100, 0.02), (100, 0.0103), (30, 0.05), (1000, 0.3)] {
            for guess in [1e-5, 0.02, 3.0] {
                let mut trials = 0;
                let (_, found) = step_for_error(limit, guess, |step| {
                    trials += 1;
                    Ok(model(rank, step))
                })
                .unwrap()
                .unwrap();
                assert!(
                    found.error <= limit && found.error >= 0.97 * limit,
                    "{found:?} for {limit}"
                );
                assert!(trials <= 8, "{trials} trials");
            }
        }
        assert_eq!(
            step_for_error(0.009, 0.1, |step| Ok(model(100, step))).unwrap(),
            None
        );
    }

    #[test]
    fn steps_fill_bytes_closely() {
        for (rank, limit) in [(10, 2e5), (100, 5e5), (100, 3e6)] {
            let (_, found) = step_for_bytes(limit, 0.02, |step| Ok(model(rank, step)))
                .unwrap()
                .unwrap();
            assert!(
                found.bytes <= limit && found.bytes >= 0.97 * limit,
                "{found:?} for {limit}"
            );
        }
        assert_eq!(
            step_for_bytes(1000.0, 0.02, |step| Ok(model(10, step))).unwrap(),
            None
        );
    }

    #[test]
    fn the_cheapest_rank_is_found_from_both_sides() {
        let ranks = [1, 2, 4, 8, 16, 32, 64];
        for start in 0..ranks.len() {
            let cost = |rank: usize| Ok((rank > 2).then(|| (rank as f64 - 9.0).powi(2)));
            assert_eq!(descend(&ranks, start, cost).unwrap(), Some(8));
            assert_eq!(descend(&ranks, start, |_| Ok(None)).unwrap(), None);
        }
    }
}
