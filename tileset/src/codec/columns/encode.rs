//! Training of the shared tables, and the choice of levels for the least error at the bytes they will take.

use super::{
    context::{self, CLASSES, EMPTY, Profile},
    eigen::eigenvectors,
    symbols::{self, Counts, Models, SYMBOLS},
    tables::{self, ColumnTables, LARGEST, group_steps, round_colours},
    transform::Transform,
};
use crate::{
    Direction, Error, GROUP_COMPONENTS, MAX_COMPONENTS, Result,
    codec::{symbols::MAX_LEVEL, texel::Texel},
};

/// Squared error, in squared steps, that one bit may save: the slope of rate and distortion at high rates, as
/// for pages.
const ERROR_PER_BIT: f32 = std::f32::consts::LN_2 / 6.0;
/// Rounding before anything is known of the distribution. 0.3 to 0.35 are best for a fixed one.
const FIRST_ROUNDING: f32 = 0.33;
/// Bits of a symbol that has not occurred in its class.
const UNSEEN_BITS: f32 = 14.0;

/// All eigen-ABRDFs of an archive as bytes.
#[derive(Clone, Debug)]
pub struct EncodedColumns {
    /// Shared by all groups; also decodes the records.
    pub tables: ColumnTables,
    /// One a group, in order.
    pub records: Vec<Vec<u8>>,
}

/// The quantizer step of a component's eigen-ABRDF (in units of U', whose root mean square is 1) that has the
/// same slope of rate and distortion as a page's step (in units of reflectance).
///
/// An error δ in U'ₖ adds σₖ²·mean(δ²) to the mean squared error, so a step s gives σₖ²s²/12 for m/ln 2·ln(1/s)
/// bits, and a page's Δ gives Δ²/12 for n/ln 2·ln(1/Δ): the derivatives are equal at s = Δ/σₖ·√(m/n). m is
/// `rows` (views × lights × 3), n `texels`, σₖ `singular_value` as the manifest has it. Infinite for a
/// component that contributes nothing.
pub fn column_step(page_step: f64, singular_value: f64, rows: usize, texels: u64) -> f64 {
    page_step * (rows as f64 / texels as f64).sqrt() / singular_value
}

/// Codes all columns of an archive. `samples` is U', `[component][view][light][rgb]`, `steps` the quantizer step
/// of each component in the same unit; where a step is infinite, or larger than what the component holds, the
/// component is zero and takes no bytes. No coefficient is off by a whole step.
///
/// # Errors
/// [`Error::Invalid`] for sizes that do not fit, values that no half float can hold, and steps that are not
/// positive or too small for the values; [`Error::OverLimit`] for too many directions.
pub fn encode_columns(
    views: &[Direction],
    lights: &[Direction],
    samples: &[f32],
    steps: &[f64],
) -> Result<EncodedColumns> {
    tables::check_directions(views, lights)?;
    let rows = views.len() * lights.len() * 3;
    if steps.is_empty() || steps.len() > MAX_COMPONENTS as usize || samples.len() != rows * steps.len() {
        return Err(Error::Invalid {
            what: "eigen-ABRDFs".into(),
            detail: format!(
                "{} samples and {} steps, but a component has {rows} samples and there are 1 to {MAX_COMPONENTS}",
                samples.len(),
                steps.len()
            ),
        });
    }
    if let Some(at) = samples
        .iter()
        .position(|value| value.is_nan() || value.abs() > LARGEST)
    {
        return Err(Error::Invalid {
            what: format!("sample {} of eigen-ABRDF {}", at % rows, at / rows),
            detail: format!("{} is no finite half float", samples[at]),
        });
    }
    let groups = steps.len().div_ceil(GROUP_COMPONENTS);
    let steps: Vec<[f32; 4]> = (0..groups)
        .map(|group| group_steps(steps, group))
        .collect::<Result<_>>()?;

    let colours = round_colours(&colour_basis(samples, rows, &steps));
    let mut tables = ColumnTables::new(
        colours,
        [0; 2],
        Profile::default(),
        Models::train(&[[0; SYMBOLS]; CLASSES]),
        |matrix| Transform::new(views, lights, matrix),
    )
    .expect("eigenvectors are orthonormal");
    let groups: Vec<Vec<Texel>> = samples
        .chunks(rows * GROUP_COMPONENTS)
        .zip(&steps)
        .map(|(samples, steps)| in_steps(&tables.transform, samples, rows, steps))
        .collect::<Result<_>>()?;
    let mut trainer = Trainer::new(&groups, &steps, [views.len(), lights.len()]);
    trainer.refine();
    trainer.refine();

    tables.shifts = trainer.shifts;
    tables.models = Models::train(&trainer.counts());
    tables.profile = trainer.profile;
    let records = trainer
        .levels
        .iter()
        .zip(&trainer.component_levels)
        .map(|(levels, &component_levels)| {
            let mut record = component_levels.map(|level| level as u8).to_vec();
            record.extend(symbols::encode(
                &tables.profile,
                component_levels,
                &tables.models,
                levels,
            ));
            record
        })
        .collect();
    Ok(EncodedColumns { tables, records })
}

/// Principal axes of the three colours over all components, each in its steps so that large ones count more.
fn colour_basis(samples: &[f32], rows: usize, steps: &[[f32; 4]]) -> Vec<f64> {
    let mut covariance = vec![0.0; 9];
    for (component, samples) in samples.chunks_exact(rows).enumerate() {
        let mut sum = [0f64; 9];
        for rgb in samples.as_chunks::<3>().0 {
            for (i, sum) in sum.iter_mut().enumerate() {
                *sum += f64::from(rgb[i / 3]) * f64::from(rgb[i % 3]);
            }
        }
        let step = f64::from(steps[component / 4][component % 4]);
        for (covariance, sum) in covariance.iter_mut().zip(sum) {
            *covariance += sum / step;
        }
    }
    eigenvectors(covariance, 3)
}

/// The coefficients of a group, in steps.
fn in_steps(transform: &Transform, samples: &[f32], rows: usize, steps: &[f32; 4]) -> Result<Vec<Texel>> {
    let mut column = vec![Texel::default(); rows];
    for (c, samples) in samples.chunks_exact(rows).enumerate() {
        for (texel, &sample) in column.iter_mut().zip(samples) {
            texel.0[c] = sample;
        }
    }
    let mut coefficients = transform.forward(&column);
    for texel in &mut coefficients {
        for (value, step) in texel.0.iter_mut().zip(steps) {
            *value /= step;
            if value.abs() > MAX_LEVEL as f32 - 1.0 {
                return Err(Error::Invalid {
                    what: "quantizer step of a column".into(),
                    detail: format!(
                        "{step} is too small for the values, which need {value} steps of {MAX_LEVEL}"
                    ),
                });
            }
        }
    }
    Ok(coefficients)
}

/// Levels and all that is derived from them.
struct Trainer<'a> {
    groups: &'a [Vec<Texel>],
    steps: &'a [[f32; 4]],
    /// `[group][place][component]`
    levels: Vec<Vec<[i32; 4]>>,
    profile: Profile,
    component_levels: Vec<[i8; 4]>,
    shifts: [i8; 2],
}

impl<'a> Trainer<'a> {
    fn new(groups: &'a [Vec<Texel>], steps: &'a [[f32; 4]], directions: [usize; 2]) -> Self {
        let round = |value: f32| (value.abs() + FIRST_ROUNDING).floor().copysign(value) as i32;
        let levels = groups
            .iter()
            .map(|group| group.iter().map(|texel| texel.0.map(round)).collect())
            .collect();
        let mut trainer = Self {
            groups,
            steps,
            levels,
            profile: Profile {
                views: vec![0; directions[0]],
                lights: vec![0; directions[1]],
                colours: [0; 3],
            },
            component_levels: Vec::new(),
            shifts: [0; 2],
        };
        trainer.measure();
        trainer
    }

    /// Derives profile, levels of components and shifts from the levels.
    fn measure(&mut self) {
        let lights = self.profile.lights.len();
        let mut views_sum = vec![0f64; self.profile.views.len()];
        let mut lights_sum = vec![0f64; lights];
        let mut colours_sum = [0f64; 3];
        let mut excess = [(0f64, 0f64); 2];
        self.component_levels.clear();
        for ((group, levels), steps) in self.groups.iter().zip(&self.levels).zip(self.steps) {
            let mut sums = [0f64; 4];
            for (place, (texel, levels)) in group.iter().zip(levels).enumerate() {
                let mut sum = 0.0;
                for c in 0..4 {
                    let magnitude = levels[c].unsigned_abs();
                    if magnitude > 0 {
                        sums[c] += f64::from(magnitude);
                        sum += f64::from(magnitude) * f64::from(steps[c]);
                        let (total, count) = &mut excess[usize::from(magnitude > 1)];
                        *total += f64::from(texel.0[c].abs()) - f64::from(magnitude);
                        *count += 1.0;
                    }
                }
                views_sum[place / (3 * lights)] += sum;
                lights_sum[place / 3 % lights] += sum;
                colours_sum[place % 3] += sum;
            }
            self.component_levels.push(sums.map(|sum| match sum {
                0.0 => EMPTY,
                _ => context::quarter_octaves(sum / group.len() as f64),
            }));
        }
        let relative = |sums: &[f64]| -> Vec<i8> {
            let mean = sums.iter().sum::<f64>() / sums.len() as f64;
            sums.iter()
                .map(|sum| context::quarter_octaves(sum / mean))
                .collect()
        };
        self.profile.views = relative(&views_sum);
        self.profile.lights = relative(&lights_sum);
        self.profile.colours.copy_from_slice(&relative(&colours_sum));
        // As i8 stops at -128 and 127, shifts are within half a step.
        self.shifts = excess.map(|(total, count)| (total / f64::max(count, 1.0) * 256.0).round() as i8);
    }

    fn counts(&self) -> Counts {
        let mut counts = [[0; SYMBOLS]; CLASSES];
        for (levels, &component_levels) in self.levels.iter().zip(&self.component_levels) {
            context::walk(&self.profile, component_levels, |place, c, class| {
                let magnitude = levels[place][c].unsigned_abs();
                counts[class][symbols::symbol(magnitude).0] += 1;
                magnitude
            });
        }
        counts
    }

    /// Chooses each level anew, of the two next to its coefficient, by squared error and code length, with the
    /// statistics of the levels before; then measures again.
    fn refine(&mut self) {
        let costs: Vec<[f32; SYMBOLS]> = self.counts().iter().map(costs).collect();
        let shifts = self.shifts.map(|shift| f32::from(shift) / 256.0);
        let cost = |class: usize, magnitude: u32, value: f32| {
            let (symbol, bits) = symbols::symbol(magnitude);
            let bits = costs[class][symbol] + bits as f32 + if magnitude > 0 { 1.0 } else { 0.0 };
            let shift = if magnitude > 0 {
                shifts[usize::from(magnitude > 1)]
            } else {
                0.0
            };
            let error = value - (magnitude as f32 + shift);
            error * error + ERROR_PER_BIT * bits
        };
        for ((group, levels), &component_levels) in self
            .groups
            .iter()
            .zip(&mut self.levels)
            .zip(&self.component_levels)
        {
            context::walk(&self.profile, component_levels, |place, c, class| {
                let value = group[place].0[c].abs();
                let below = value as u32;
                let above = cost(class, below + 1, value) < cost(class, below, value);
                let magnitude = below + u32::from(above);
                let sign = if group[place].0[c] < 0.0 { -1 } else { 1 };
                levels[place][c] = magnitude as i32 * sign;
                magnitude
            });
        }
        self.measure();
    }
}

/// Bits of each symbol of a class.
fn costs(counts: &[u32; SYMBOLS]) -> [f32; SYMBOLS] {
    let sum: f32 = counts.iter().map(|&count| count as f32).sum();
    counts.map(|count| match count {
        0 => UNSEEN_BITS,
        _ => (sum / count as f32).log2(),
    })
}
