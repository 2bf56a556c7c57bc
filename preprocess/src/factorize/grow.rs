//! The whole factorization: which passes, when to stop, and what comes out.

use std::time::Instant;

use faer::MatRef;

use super::checkpoint::{Checkpoint, Saver};
use super::factors::square_sum;
use super::krylov::{State, Step};
use super::once::{self, Probe};
use super::passes;
use super::plan::plan;
use super::refine::refine;
use super::ritz::Projection;
use super::stream::{Stream, weigh};
use super::{Factors, Settings, Weighted, low_rank, products};
use crate::progress::ProgressFn;
use crate::{Btf, Error, Result};

/// Below this share of ‖B‖² the difference ‖B‖² − ‖B·Q‖² is too close to the rounding of the f32 products (about
/// 1e-7 of ‖B‖², up to some 1e-6 where many samples are equal) to be trusted to a percent: one more pass measures the
/// residual itself, and refines the factors by it.
const DIRECT_RESIDUAL_SHARE: f64 = 2e-4;
/// Rows read at a time to compare factors with the BTF.
const VERIFY_ROWS: usize = 126;

/// Factorizes a BTF.
///
/// The error stated, [`Factors::relative_error`], is exact to about a percent down to 1e-7, where f32 ends: it is
/// √(‖B‖² − ‖B·Q‖²)/‖B‖ in f64, or measured by another pass where that difference would cancel. A BTF whose file holds
/// factors ([`Btf::low_rank`]) is not read: its factors are brought into this form.
///
/// # Errors
/// [`Error::Invalid`] for settings out of range, [`Error::OverBudget`], [`Error::BadSample`], and those of the format.
pub fn factorize(btf: &Btf, settings: &Settings, progress: ProgressFn<'_>) -> Result<Factors> {
    factorize_resumable(btf, settings, None, progress)
}

/// [`factorize`], which continues from where an interrupted run of the same work saved its state; the bits that come out
/// are those of a run without interruption. The state stays until [`Checkpoint::delete`].
///
/// # Errors
/// As [`factorize`], and [`Error::Io`] if the state cannot be saved.
pub fn factorize_resumable(
    btf: &Btf,
    settings: &Settings,
    checkpoint: Option<&Checkpoint>,
    progress: ProgressFn<'_>,
) -> Result<Factors> {
    check(settings)?;
    if let Some(product) = btf.low_rank()? {
        return low_rank::factorize_product(btf, product, settings);
    }
    let plan = plan(btf, settings)?;
    let mut saver = checkpoint.map(|checkpoint| Saver::new(checkpoint, btf, settings, &plan));
    let mut stream = Stream::new(btf, plan.block_rows, progress);
    let saved = saver.as_ref().and_then(|saver| saver.load(btf, &plan));
    let mut state = saved.unwrap_or_else(|| {
        if settings.passes == Some(1) {
            once::start(btf.rows(), btf.columns(), plan.width, settings.seed)
        } else {
            State::new(btf.columns(), plan.width)
        }
    });
    stream.statistics.resumed_rows = u64::from(state.passes) * btf.rows() as u64;
    let directions = settings.weights.of_directions(btf.sampling());
    let mut weights = directions;
    let (mut basis_seconds, mut probe) = (0.0, None);
    loop {
        // Known from the directions, or from the first pass on.
        if weights.is_none() && !matches!(state.pass.step, Step::Sketch | Step::Once) {
            weights = settings.weights.of_energies(&state.totals.energies);
        }
        state.run(&mut stream, weights.as_deref(), settings.seed, |state| {
            saver.as_mut().map_or(Ok(()), |saver| saver.save_when_due(state))
        })?;
        let next = timed(&mut basis_seconds, || {
            let next = passes::next(&state, &plan, settings, weights.as_deref())?;
            match next {
                Some(step) => {
                    let width = plan.width.min(plan.most - state.width() - state.pass.q.nrows());
                    state.advance(step, width, btf.rows(), settings.seed)?;
                }
                None if state.pass.step == Step::Once => {
                    let (block, kept) = once::solve(&mut state.pass, settings.seed)?;
                    state.blocks.push(block);
                    probe = Some(kept);
                }
                None => state.keep(),
            }
            Ok::<_, Error>(next)
        })?;
        stream.statistics.sample_memory();
        if next.is_none() {
            break;
        }
    }
    stream.statistics.basis_seconds = basis_seconds;
    stream.statistics.save_seconds = saver.map_or(0.0, |saver| saver.seconds);
    if weights.is_none() {
        weights = settings.weights.of_energies(&state.totals.energies);
    }
    finish(state, stream, weights, probe, settings)
}

/// ‖B − U·V‖² by rows, in one pass over the BTF; `u` `[component][row]`, `v` `[component][texel]`.
///
/// # Errors
/// Those of the format.
pub(crate) fn left_out(btf: &Btf, u: &[f32], v: &[f32], progress: ProgressFn<'_>) -> Result<Vec<f64>> {
    let components = u.len() / btf.rows();
    let mut stream = Stream::new(btf, VERIFY_ROWS.min(btf.rows()), progress);
    let u = MatRef::from_column_major_slice(u, btf.rows(), components);
    let v = MatRef::from_row_major_slice(v, components, btf.columns());
    Ok(products::residual(&mut stream, u, v, false)?.energies)
}

/// Factors from a subspace, and their exact error.
fn finish(
    state: State,
    mut stream: Stream<'_>,
    weights: Option<Vec<f32>>,
    probe: Option<Probe>,
    settings: &Settings,
) -> Result<Factors> {
    let (rows, columns) = (stream.rows(), stream.columns());
    let scale = state.scale();
    let State { blocks, totals, .. } = state;
    let energy = totals.energy();
    let mut decompose_seconds = 0.0;
    let mut ritz = timed(&mut decompose_seconds, || {
        let all = blocks.iter().map(|block| (block.q.as_ref(), block.y.as_ref()));
        let projection = Projection::new(all.collect(), weights.as_deref())?;
        // With weights it is another norm in which the terms would be counted.
        let samples = rows as f64 * columns as f64;
        let enough = |captured: f64| match (settings.enough, &weights) {
            (Some(enough), None) => energy - captured <= enough.of_scaled(scale).energy(samples, energy),
            _ => false,
        };
        projection.ritz(settings.components as usize, enough)
    })?;
    stream.statistics.subspace = blocks.iter().map(|block| block.q.nrows()).sum();
    drop(blocks);
    stream.statistics.sample_memory();

    let mut residual_energy = energy - square_sum(&ritz.norms);
    let mut by_rows = None;
    if let Some(probe) = &probe {
        by_rows = Some(probe.left_out(&ritz.u, &ritz.v));
    } else if residual_energy < DIRECT_RESIDUAL_SHARE * energy {
        let components = ritz.norms.len();
        let u = MatRef::from_column_major_slice(&ritz.u, rows, components);
        let v = MatRef::from_row_major_slice(&ritz.v, components, columns);
        let rest = products::residual(&mut stream, u, v, true)?;
        let refined = timed(&mut decompose_seconds, || refine(ritz, rest, weights.as_deref()))?;
        by_rows = Some(refined.1);
        ritz = refined.0;
    }
    let mut weighted_residual = None;
    if let Some(energies) = by_rows {
        // A term may turn out to be rounding only when it is refined.
        let cut = if probe.is_none() { ritz.cut_energy } else { 0.0 };
        residual_energy = energies.iter().sum::<f64>() + cut;
        weighted_residual = weights.as_ref().map(|weights| weigh(&energies, weights) + cut);
    }
    let weighted = weights.map(|weights| {
        let energy = totals.weighted_energy(&weights);
        Weighted {
            energy,
            residual_energy: weighted_residual.unwrap_or_else(|| energy - square_sum(&ritz.singular_values)),
            singular_values: ritz.singular_values,
            weights,
        }
    });
    let samples_per_channel = rows as f64 / 3.0 * columns as f64;
    stream.statistics.decompose_seconds = decompose_seconds;
    let mut factors = Factors {
        rows,
        columns,
        components: ritz.norms.len(),
        u: ritz.u,
        v: ritz.v,
        singular_values: ritz.norms,
        energy,
        residual_energy,
        estimated: probe.is_some(),
        weighted,
        mean_rgb: totals.sums.map(|sum| sum / samples_per_channel),
        statistics: stream.statistics,
    };
    factors.multiply(scale.recip());
    Ok(factors)
}

fn check(settings: &Settings) -> Result<()> {
    if !(1..=tileset::MAX_COMPONENTS).contains(&settings.components) {
        return Err(Error::Invalid {
            what: "number of components",
            found: settings.components.to_string(),
            expected: "from 1 to 1024",
        });
    }
    Ok(())
}

/// Runs `work` and adds the seconds it takes.
fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = work();
    *seconds += began.elapsed().as_secs_f64();
    result
}
