//! Ratios, noise, and what changed beyond it.

use serde::Serialize;

use super::{Direction, Figures};
use crate::engine::median;

/// What became of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The same number.
    Same,
    /// No more than noise.
    Noise,
    /// More than noise, and in the right direction.
    Better,
    /// More than noise, and in the wrong direction.
    Worse,
    /// More than noise; the name does not tell which way it should go.
    Changed,
}

/// One figure of both reports.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    /// Its place.
    pub place: String,
    /// Medians of the rounds and reports.
    pub before: f64,
    /// See above.
    pub after: f64,
    /// After over before; infinite (null) where it was zero.
    pub ratio: f64,
    /// What repeated runs differ by, in parts of the figure.
    pub noise: f64,
    /// Which way it should go.
    pub direction: Direction,
    /// What became of it.
    pub verdict: Verdict,
}

/// Two reports of one measurement.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// All figures that both have, by place.
    pub figures: Vec<Change>,
    /// Texts that differ: place, before, after.
    pub texts: Vec<[String; 3]>,
    /// Figures that only one has.
    pub only_before: Vec<String>,
    /// See above.
    pub only_after: Vec<String>,
}

impl Change {
    /// How far it has moved, in parts of the larger one: 0 for nothing, 1 for all.
    pub fn distance(&self) -> f64 {
        let larger = self.before.abs().max(self.after.abs());
        if larger > 0.0 {
            (self.after - self.before).abs() / larger
        } else {
            0.0
        }
    }

    /// Whether it has become worse by more than a share of what it was, and by more than noise.
    pub fn fails(&self, share: f64) -> bool {
        let moved = (self.after - self.before).abs();
        self.verdict == Verdict::Worse && moved > share * self.before.abs()
    }
}

impl Comparison {
    /// Figures that became worse by more than this share, and than noise.
    pub fn failures(&self, share: f64) -> impl Iterator<Item = &Change> {
        self.figures.iter().filter(move |change| change.fails(share))
    }
}

/// Compares two reports.
pub fn compare(before: &Figures, after: &Figures) -> Comparison {
    let missing = |from: &Figures, of: &Figures| -> Vec<String> {
        let places = of
            .numbers
            .keys()
            .filter(|place| !from.numbers.contains_key(*place));
        places.cloned().collect()
    };
    let both = before
        .numbers
        .iter()
        .filter_map(|(place, values)| Some((place, values, after.numbers.get(place)?)));
    let texts = before.texts.iter().filter_map(|(place, text)| {
        let other = after.texts.get(place)?;
        (other != text).then(|| [place.clone(), text.clone(), other.clone()])
    });
    Comparison {
        figures: both
            .map(|(place, old, new)| {
                let noise = spread(old)
                    .max(spread(new))
                    .max(tail(place, before))
                    .max(tail(place, after));
                change(place, middle(old), middle(new), noise)
            })
            .collect(),
        texts: texts.collect(),
        only_before: missing(after, before),
        only_after: missing(before, after),
    }
}

fn change(place: &str, before: f64, after: f64, noise: f64) -> Change {
    let direction = Direction::of(place);
    let ratio = if before == after { 1.0 } else { after / before };
    let beyond = (after - before).abs() > noise * before.abs().max(after.abs());
    let verdict = match (before == after, beyond, direction) {
        (true, ..) => Verdict::Same,
        (_, false, _) => Verdict::Noise,
        (.., Direction::Unknown) => Verdict::Changed,
        (.., Direction::Less) if after < before => Verdict::Better,
        (.., Direction::More) if after > before => Verdict::Better,
        _ => Verdict::Worse,
    };
    Change {
        place: place.to_owned(),
        before,
        after,
        ratio,
        noise,
        direction,
        verdict,
    }
}

fn middle(values: &[f64]) -> f64 {
    median(&mut values.to_vec())
}

/// The range of several values, in parts of their median; 0 of one.
fn spread(values: &[f64]) -> f64 {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    relative(most - least, middle(values))
}

/// The distance of a median to its 95th percentile, where both stand there: that of `a.ms.b` is `a.ms_95.b`.
fn tail(place: &str, figures: &Figures) -> f64 {
    let parts: Vec<&str> = place.split('.').collect();
    let at = |place: &str| figures.numbers.get(place).map(|values| middle(values));
    let Some(here) = at(place) else { return 0.0 };
    let beside = (0..parts.len()).filter_map(|which| {
        let mut parts: Vec<String> = parts.iter().map(|part| (*part).to_owned()).collect();
        parts[which] = match parts[which].strip_suffix("_95") {
            Some(plain) => plain.to_owned(),
            None => format!("{}_95", parts[which]),
        };
        at(&parts.join("."))
    });
    beside.fold(0.0, |most: f64, other| {
        most.max(relative((other - here).abs(), here))
    })
}

fn relative(part: f64, whole: f64) -> f64 {
    if whole != 0.0 && part.is_finite() {
        part / whole.abs()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn verdict(before: Value, after: Value) -> (Verdict, f64) {
        let compared = compare(&Figures::of(&before), &Figures::of(&after));
        (compared.figures[0].verdict, compared.figures[0].ratio)
    }

    #[test]
    fn what_changed_is_told_from_noise() {
        assert_eq!(verdict(json!({"ms": 2}), json!({"ms": 2})), (Verdict::Same, 1.0));
        assert_eq!(verdict(json!({"ms": 2}), json!({"ms": 3})), (Verdict::Worse, 1.5));
        assert_eq!(
            verdict(json!({"ms": 2}), json!({"ms": 1})),
            (Verdict::Better, 0.5)
        );
        assert_eq!(
            verdict(json!({"ssim": 0.9}), json!({"ssim": 0.45})),
            (Verdict::Worse, 0.5)
        );
        assert_eq!(
            verdict(json!({"pages": 2}), json!({"pages": 3})),
            (Verdict::Changed, 1.5)
        );
        let rounds = |values: [f64; 3]| json!({ "ms_rounds": values });
        assert_eq!(
            verdict(rounds([1.0, 2.0, 3.0]), rounds([2.0, 2.5, 3.0])).0,
            Verdict::Noise
        );
        assert_eq!(
            verdict(rounds([1.9, 2.0, 2.1]), rounds([2.9, 3.0, 3.1])),
            (Verdict::Worse, 1.5)
        );
        let tailed = |ms: f64| json!({ "cpu_ms": { "all": ms }, "cpu_ms_95": { "all": 2.0 } });
        assert_eq!(verdict(tailed(1.5), tailed(1.2)).0, Verdict::Noise);
        assert_eq!(
            verdict(json!({"bytes": 0}), json!({"bytes": 3})).0,
            Verdict::Worse
        );
    }

    #[test]
    fn several_reports_are_repeated_runs() {
        let mut before = Figures::of(&json!({ "ms": 1.0, "device": "a" }));
        before.add(&json!({ "ms": 1.2 }));
        before.add(&json!({ "ms": 1.4 }));
        let after = Figures::of(&json!({ "ms": 1.5, "device": "b", "bytes": 1 }));
        let compared = compare(&before, &after);
        assert_eq!(compared.figures[0].before, 1.2);
        assert_eq!(compared.figures[0].verdict, Verdict::Noise);
        assert_eq!(compared.texts, [["device", "a", "b"].map(str::to_owned)]);
        assert_eq!(
            (&compared.only_before[..], &compared.only_after[..]),
            (&[][..], &["bytes".to_owned()][..])
        );
        let after = Figures::of(&json!({ "ms": 2.4 }));
        let compared = compare(&before, &after);
        assert_eq!(compared.failures(0.05).count(), 1);
        assert_eq!(compared.failures(1.1).count(), 0);
    }
}
