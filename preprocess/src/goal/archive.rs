//! Trials on real archives.

use tileset::Pyramid;

use super::Goal;
use super::search::{Outcome, descend, step_for_bytes, step_for_error};
use crate::build::{DEFAULT_QUALITY, Encoded, encode};
use crate::progress::ProgressFn;
use crate::{Btf, Error, Factors, Result};

/// Shares of the squared error that the rank is given in trials, falling: from few components to many.
const RANK_SHARES: [f64; 5] = [0.96, 0.92, 0.8, 0.65, 0.5];
/// Shares of the components at hand that are tried for a number of bytes, rising.
const RANKS: [f64; 8] = [0.06, 0.1, 0.16, 0.25, 0.4, 0.6, 0.8, 1.0];
/// Components of a group share pages: fewer than a whole group save next to nothing.
const GROUP: usize = tileset::GROUP_COMPONENTS;

/// An archive that meets the goal, and what led to it.
pub(crate) struct Found {
    pub(crate) encoded: Encoded,
    /// Its quantizer step in root mean squares of the BTF.
    pub(crate) quality: f64,
    /// Archives that were coded on the way.
    pub(crate) trials: u32,
}

/// What part of a total relative error the factorization may leave out at most, so that the search has a choice.
pub(crate) fn rank_error_for(error: f64) -> f64 {
    error * RANK_SHARES[RANK_SHARES.len() - 1].sqrt()
}

/// The most terms worth computing for an archive of so many bytes: their eigen-ABRDFs alone, at a quarter of their size
/// in half floats, would fill it.
pub(crate) fn terms_within(bytes: u64, rows: usize, most: u32) -> u32 {
    let terms = bytes.saturating_mul(4) / (2 * rows as u64).max(1);
    terms.clamp((GROUP as u64).min(most.into()), most.into()) as u32
}

/// A guess of what a file has beside its records, for as many components: text of directions, entries of the
/// directory before they are compressed.
pub(crate) fn overhead_bytes(btf: &Btf, components: usize) -> u64 {
    let groups = components.div_ceil(GROUP) as u64;
    let tiles = Pyramid::new(btf.width(), btf.height(), btf.wrap()).map_or(1, |pyramid| pyramid.tile_count());
    let directions = (btf.views().len() + btf.lights().len()) as u64;
    1024 + 20 * directions + 10 * components as u64 + 18 * groups * (u64::from(tiles) + 1)
}

/// Codes `factors` so that they meet `goal`; `overhead` is how many times larger than guessed a file is beside its
/// records.
///
/// # Errors
/// [`Error::Unreachable`] if no rank and step do, and those of [`encode`].
pub(crate) fn reach(
    btf: &Btf,
    factors: &Factors,
    goal: Goal,
    overhead: f64,
    progress: ProgressFn<'_>,
) -> Result<Found> {
    let mut trials = Trials {
        btf,
        factors,
        overhead,
        progress,
        guess: DEFAULT_QUALITY,
        count: 0,
        last: None,
        best: None,
    };
    match goal {
        Goal::Bytes(bytes) => trials.for_bytes(bytes as f64)?,
        Goal::RelativeError(_) | Goal::Psnr(_) => {
            trials.for_error(goal.relative_error(factors.btf_rms()).unwrap_or(0.0))?;
        }
    }
    match trials.best {
        Some((encoded, quality)) => Ok(Found {
            encoded,
            quality,
            trials: trials.count,
        }),
        None => Err(trials.unreachable(goal)),
    }
}

struct Trials<'a> {
    btf: &'a Btf,
    factors: &'a Factors,
    overhead: f64,
    progress: ProgressFn<'a>,
    /// Step to try first: the last that was good.
    guess: f64,
    count: u32,
    /// The last archive and its step.
    last: Option<(Encoded, f64)>,
    /// The archive that meets the goal best.
    best: Option<(Encoded, f64)>,
}

impl Trials<'_> {
    fn run(&mut self, components: usize, quality: f64) -> Result<Outcome> {
        self.last = None; // its memory first
        let truncated;
        let factors = if components < self.factors.components {
            truncated = self.factors.truncated(components);
            &truncated
        } else {
            self.factors
        };
        let encoded = encode(self.btf, factors, quality, self.progress)?;
        let ledger = encoded.ledger();
        let relative = |rms: f64| {
            if ledger.btf_rms > 0.0 {
                rms / ledger.btf_rms
            } else {
                0.0
            }
        };
        let outcome = Outcome {
            bytes: self.bytes(&encoded, factors.components),
            error: ledger.total_relative(),
            floor: relative((ledger.rank_rms.powi(2) + ledger.half_rms.powi(2)).sqrt()),
        };
        self.count += 1;
        self.last = Some((encoded, quality));
        Ok(outcome)
    }

    /// Bytes of a whole file, those beside the records guessed.
    fn bytes(&self, encoded: &Encoded, components: usize) -> f64 {
        encoded.record_bytes() as f64 + self.overhead * overhead_bytes(self.btf, components) as f64
    }

    /// What can be reached instead.
    fn unreachable(&self, goal: Goal) -> Error {
        let factors = self.factors;
        let ledger = self
            .last
            .as_ref()
            .map(|(encoded, _)| encoded.ledger())
            .unwrap_or_default();
        let floor = (factors.rank_rms().powi(2) + ledger.half_rms.powi(2)).sqrt();
        let best = match goal {
            Goal::Bytes(_) => {
                let components = GROUP.min(factors.components);
                let bytes = self
                    .last
                    .as_ref()
                    .map_or(0.0, |(encoded, _)| self.bytes(encoded, components));
                format!("at the coarsest step {components} components take about {bytes:.0} bytes")
            }
            Goal::Psnr(_) => format!(
                "{} components leave {:.2} dB",
                factors.components,
                super::psnr(floor).unwrap_or(f64::INFINITY)
            ),
            Goal::RelativeError(_) => format!(
                "{} components leave {:.6}",
                factors.components,
                floor / factors.btf_rms().max(f64::MIN_POSITIVE)
            ),
        };
        Error::Unreachable {
            goal: goal.to_string(),
            best,
        }
    }

    /// Searches the step at one rank and keeps the best archive of all ranks so far. `price` is what is to be `least`,
    /// `None` for an outcome that misses the goal; gives that of the step found.
    fn search(
        &mut self,
        rank: usize,
        least: &mut f64,
        price: impl Fn(&Outcome) -> Option<f64>,
        find: impl FnOnce(f64, &mut dyn FnMut(f64) -> Result<Outcome>) -> Result<Option<(f64, Outcome)>>,
    ) -> Result<Option<f64>> {
        let guess = self.guess;
        let mut kept = None;
        let found = find(guess, &mut |step| {
            let outcome = self.run(rank, step)?;
            if let Some(price) = price(&outcome).filter(|price| price < least) {
                *least = price;
                kept = self.last.take();
            }
            Ok(outcome)
        })?;
        if kept.is_some() {
            self.best = kept;
        }
        if let Some((step, _)) = found {
            self.guess = step;
        }
        Ok(found.and_then(|(_, outcome)| price(&outcome)))
    }

    /// The cheapest archive with at most this relative error.
    fn for_error(&mut self, limit: f64) -> Result<()> {
        let factors = self.factors;
        let mut ranks: Vec<usize> = RANK_SHARES
            .iter()
            .filter_map(|share| {
                let allowed = share * limit * limit * factors.energy;
                (1..=factors.components).find(|&rank| factors.residual_energy_of(rank) <= allowed)
            })
            .map(|rank| rank.next_multiple_of(GROUP).min(factors.components))
            .chain([factors.components])
            .collect();
        ranks.dedup();
        // The rank that shares the error evenly, or the next best.
        let start = (ranks.len() - 1).min(2);
        let mut least = f64::INFINITY;
        descend(&ranks, start, |rank| {
            if factors.residual_energy_of(rank) > limit * limit * factors.energy {
                return Ok(None);
            }
            let price = |outcome: &Outcome| (outcome.error <= limit).then_some(outcome.bytes);
            self.search(rank, &mut least, price, |guess, trial| {
                step_for_error(limit, guess, trial)
            })
        })?;
        if self.best.is_none() && self.last.is_none() {
            // For what can be reached.
            self.run(factors.components, DEFAULT_QUALITY)?;
        }
        Ok(())
    }

    /// The least error within so many bytes of records.
    fn for_bytes(&mut self, limit: f64) -> Result<()> {
        let factors = self.factors;
        let mut ranks: Vec<usize> = RANKS
            .iter()
            .map(|share| ((share * factors.components as f64) as usize).max(1))
            .map(|rank| rank.next_multiple_of(GROUP).min(factors.components))
            .collect();
        ranks.dedup();
        let mut least = f64::INFINITY;
        descend(&ranks, ranks.len() / 2, |rank| {
            let price = |outcome: &Outcome| (outcome.bytes <= limit).then_some(outcome.error);
            self.search(rank, &mut least, price, |guess, trial| {
                step_for_bytes(limit, guess, trial)
            })
        })?;
        Ok(())
    }
}
