//! The quantizer step that meets an error: the coarsest whose error is not above the target.
//!
//! Error over step is close to a power law, but neither smooth nor quite monotone: rounding of levels by rate and
//! distortion moves it by a few thousandths. So the search is a regula falsi of the logarithms with bisection where that
//! stalls, and it ends as soon as an error is just below the target.

use crate::{Error, Result};

/// An error within this share below the target meets it: a few thousandths of a bit per sample.
const TOLERANCE: f64 = 0.002;
/// Accepted steps in root mean squares of the BTF, as archives accept them.
const QUALITIES: std::ops::RangeInclusive<f64> = 1e-6..=10.0;
/// Coders are run no more often than this for one target; then the best step so far is taken.
const MAX_TRIALS: usize = 24;

/// A step that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Trial {
    /// Quantizer step in root mean squares of the BTF.
    pub(super) quality: f64,
    /// Relative root mean square error that it gives.
    pub(super) error: f64,
}

/// The step for `target`. `trials` are those made before, which save some, and receives the new ones.
///
/// # Errors
/// [`Error::Unreachable`] if the finest step is too coarse or the coarsest too fine; those of `measure`.
pub(super) fn search(
    target: f64,
    trials: &mut Vec<Trial>,
    mut measure: impl FnMut(f64) -> Result<f64>,
) -> Result<Trial> {
    if !(target.is_finite() && target > 0.0) {
        return Err(Error::Invalid {
            what: "target of the relative error",
            found: target.to_string(),
            expected: "a number above 0",
        });
    }
    for round in 0..MAX_TRIALS {
        let below = extreme(
            trials,
            |trial| trial.error <= target,
            |a, b| a.quality > b.quality,
        );
        if let Some(found) = below.filter(|trial| trial.error >= target * (1.0 - TOLERANCE)) {
            return Ok(found);
        }
        let coarser =
            |trial: &Trial| trial.error > target && below.is_none_or(|below| trial.quality > below.quality);
        let above = extreme(trials, coarser, |a, b| a.quality < b.quality);
        let quality = next(target, below, above, round);
        if let Some(end) = [below, above]
            .into_iter()
            .flatten()
            .find(|trial| trial.quality == quality)
        {
            return Err(Error::Unreachable {
                target,
                quality,
                error: end.error,
                advice: if end.error > target { "larger" } else { "smaller" },
            });
        }
        let error = measure(quality)?;
        trials.push(Trial { quality, error });
    }
    let met = extreme(trials, |trial| trial.error <= target, |a, b| a.error > b.error);
    met.ok_or(Error::Unreachable {
        target,
        quality: *QUALITIES.start(),
        error: f64::NAN,
        advice: "larger",
    })
}

/// The step to try next, between a step that is fine enough and one that is too coarse.
fn next(target: f64, below: Option<Trial>, above: Option<Trial>, round: usize) -> f64 {
    // Just below the target, for an error just above it is of no use.
    let aim = target * (1.0 - 0.5 * TOLERANCE);
    let quality = match (below, above) {
        (None, None) => target,
        // Far from the power law at either end: at least a factor of two, at most of eight.
        (Some(trial), None) => trial.quality * (aim / trial.error).clamp(2.0, 8.0),
        (None, Some(trial)) => trial.quality * (aim / trial.error).clamp(0.125, 0.5),
        (Some(below), Some(above)) => {
            let share = (aim / below.error).ln() / (above.error / below.error).ln();
            // Every third time the middle, in case one end never moves.
            let share = if round % 3 == 2 || !share.is_finite() {
                0.5
            } else {
                share
            };
            below.quality * (above.quality / below.quality).powf(share.clamp(0.02, 0.98))
        }
    };
    quality.clamp(*QUALITIES.start(), *QUALITIES.end())
}

/// The trial that goes before all others among those that `accepted` takes.
fn extreme(
    trials: &[Trial],
    accepted: impl Fn(&Trial) -> bool,
    before: impl Fn(&Trial, &Trial) -> bool,
) -> Option<Trial> {
    trials
        .iter()
        .filter(|trial| accepted(trial))
        .copied()
        .reduce(|best, trial| if before(&trial, &best) { trial } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Saturates at 1, as an error does when all coefficients are zero, and does not fall below what half floats lose;
    /// wiggles by a thousandth.
    fn error(quality: f64) -> f64 {
        let rough = 1.0 + 0.001 * (quality * 1e4).sin();
        ((0.9 * quality).powf(0.9).min(1.0).powi(2) + 1e-8).sqrt() * rough
    }

    #[test]
    fn targets_are_met_in_few_trials() {
        let mut trials = Vec::new();
        for target in [0.12, 0.05, 0.015, 0.9, 0.0005] {
            let before = trials.len();
            let found = search(target, &mut trials, |quality| Ok(error(quality))).unwrap();
            assert!(
                found.error <= target && found.error >= 0.998 * target,
                "{found:?}"
            );
            assert_eq!(found.error, error(found.quality));
            assert!(trials.len() - before <= 10, "{target}: {trials:?}");
        }
    }

    #[test]
    fn what_was_tried_is_not_tried_again() {
        let mut trials = Vec::new();
        let first = search(0.05, &mut trials, |quality| Ok(error(quality))).unwrap();
        let again = search(0.05, &mut trials, |_| panic!("nothing is left to try")).unwrap();
        assert_eq!(first, again);
    }

    #[test]
    fn a_step_function_ends_below_the_target() {
        let stairs = |quality: f64| if quality < 0.3 { 0.01 } else { 0.5 };
        let found = search(0.1, &mut Vec::new(), |quality| Ok(stairs(quality))).unwrap();
        assert_eq!(found.error, 0.01);
    }

    #[test]
    fn what_no_step_meets_is_said() {
        let said = |target| {
            search(target, &mut Vec::new(), |quality| Ok(error(quality)))
                .unwrap_err()
                .to_string()
        };
        assert!(said(1e-5).contains("larger"), "{}", said(1e-5));
        assert!(said(2.0).contains("smaller"), "{}", said(2.0));
        for target in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(said(target).contains("above 0"), "{target}");
        }
    }
}
