//! Running the cases.

use preprocess::factorize::factorize;
use preprocess::source::Repairs;
use preprocess::{Btf, Error, Settings};
use serde::Serialize;

use super::{Bounds, Case, Harm, Input, Measured, RepairMeasured, Shape, Sizes, cases, measure};
use crate::Result;

/// Memory of a factorization: far more than any case needs.
const MEMORY_BYTES: u64 = 1 << 30;

/// What one case came out like.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The case.
    pub case: &'static str,
    /// Sizes.
    pub shape: Shape,
    /// What was measured; nothing if the case failed before.
    pub measured: Option<Measured>,
    /// What is promised.
    pub bounds: Bounds,
    /// Why the bounds are what they are.
    pub reason: &'static str,
    /// What is broken of it, for people; empty if nothing is.
    pub broken: Vec<String>,
}

/// Runs all cases one after the other; `progress` gets the name of each before it begins. What should not have failed
/// is in [`Row::broken`], so that the other cases run all the same.
pub fn run(sizes: Sizes, progress: &dyn Fn(&str)) -> Vec<Row> {
    let run = |case: &Case| {
        progress(case.name);
        examine(case).unwrap_or_else(|error| Row {
            case: case.name,
            shape: case.shape,
            measured: None,
            bounds: case.bounds,
            reason: case.reason,
            broken: vec![format!("failed: {error}")],
        })
    };
    cases(sizes).iter().map(run).collect()
}

/// Runs one case.
///
/// # Errors
/// What should not have failed: [`crate::Error::Preprocess`], [`crate::Error::Archive`], [`crate::Error::Io`]. A broken
/// bound is no error, and neither is a harmed BTF that is not refused as it should be: [`Row::broken`] says so.
pub fn examine(case: &Case) -> Result<Row> {
    let original = case.input();
    let mut broken = Vec::new();
    let (input, btf, repairs) = match &case.harm {
        None => {
            let btf = original.btf(case.name)?;
            (original, btf, None)
        }
        Some(harm) => {
            let harmed = harm.applied(&original);
            broken.extend(not_refused(harm, &harmed.btf(case.name)?));
            let (btf, repairs) = harmed.btf(case.name)?.repaired();
            let repaired = Input::read(case.shape, &btf)?;
            let loss = difference(&repaired.samples, &original.samples);
            (repaired, btf, Some((harm, repairs, loss)))
        }
    };
    let settings = settings(case.components);
    let factors = factorize(&btf, &settings, &|_| ())?;
    let folder = tempfile::tempdir()
        .map_err(|source| crate::Error::io(&std::env::temp_dir(), "make a folder in")(source))?;
    let mut measured = measure(&input, &btf, &factors, case.components, folder.path())?;
    measured.repair = repairs.map(|(harm, repairs, loss)| repair(harm, &repairs, loss));
    broken.extend(case.bounds.broken(&measured));
    Ok(Row {
        case: case.name,
        shape: case.shape,
        measured: Some(measured),
        bounds: case.bounds,
        reason: case.reason,
        broken,
    })
}

/// The BTF of a case, repaired if it was harmed, and its samples.
///
/// # Errors
/// Those of making and reading it.
pub(super) fn prepared(case: &Case) -> Result<(Input, Btf)> {
    let original = case.input();
    let Some(harm) = &case.harm else {
        let btf = original.btf(case.name)?;
        return Ok((original, btf));
    };
    let (btf, _) = harm.applied(&original).btf(case.name)?.repaired();
    Ok((Input::read(case.shape, &btf)?, btf))
}

/// How the cases are factorized: with all that is usual.
pub(super) fn settings(components: usize) -> Settings {
    Settings {
        components: components as u32,
        memory_bytes: MEMORY_BYTES,
        ..Settings::default()
    }
}

fn repair(harm: &Harm, repairs: &Repairs, loss: f64) -> RepairMeasured {
    let report = repairs.report();
    RepairMeasured {
        samples: report.samples,
        harmed: harm.samples.len() as u64,
        images: report.images,
        loss,
    }
}

/// What is wrong with how a harmed BTF is refused, if anything.
fn not_refused(harm: &Harm, btf: &Btf) -> Option<String> {
    let error = match factorize(btf, &settings(1), &|_| ()) {
        Ok(_) => return Some("a bad sample was taken for good".to_owned()),
        Err(error) => error,
    };
    let right = match &error {
        Error::BadSample {
            view,
            light,
            channel,
            x,
            y,
            ..
        } => (*view, *light, *channel, *x, *y) == harm.first,
        _ => false,
    };
    (!right).then(|| {
        format!(
            "the first bad sample is at {:?}, but the error says: {error}",
            harm.first
        )
    })
}

/// ‖a − b‖ / ‖b‖.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    let squares = |sum: f64, value: f64| sum + value * value;
    let pairs = a.iter().zip(b);
    let difference = pairs
        .map(|(&a, &b)| f64::from(a) - f64::from(b))
        .fold(0.0, squares);
    (difference / b.iter().map(|&b| f64::from(b)).fold(0.0, squares)).sqrt()
}
