//! Scales, their ranges and ticks.

use std::ops::Range;

use plotters::coord::ranged1d::{BoldPoints, KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;

/// How values become places.
#[derive(Clone, Copy)]
pub(crate) enum Scale {
    Linear,
    /// Linear, and begins at zero.
    FromZero,
    /// Linear, of whole numbers.
    Count,
    /// Logarithmic. What lies below the least is drawn there, and its tick is `0`; without one, it is not drawn.
    Log {
        least: Option<f64>,
    },
}

/// Beyond it, up and down, nothing is drawn: differences would be lost or infinite.
const LIMIT: f64 = 1e100;

impl Scale {
    /// The place of a value: itself, or its exponent; `None` for what has none.
    pub(super) fn place(self, value: f64) -> Option<f64> {
        let place = match self {
            Self::Log { least } => least.map_or(value, |least| value.max(least)).log10(),
            _ => value,
        };
        // f64::max drops what is not a number.
        (place.abs() < LIMIT && !value.is_nan()).then_some(place)
    }
}

/// A scale, the range that is shown, and where its ticks stand.
pub(super) struct Axis {
    scale: Scale,
    /// Places.
    low: f64,
    high: f64,
    ticks: Vec<(f64, String)>,
}

impl Axis {
    /// The range of all values, with some room. `None` if there are none.
    pub(super) fn new(scale: Scale, values: impl Iterator<Item = f64>) -> Option<Self> {
        let from_zero = matches!(scale, Scale::FromZero).then_some(0.0);
        let places = values.filter_map(|value| scale.place(value)).chain(from_zero);
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), place| {
            (low.min(place), high.max(place))
        });
        let size = low.abs().max(high.abs());
        let room = if high - low > 1e-9 * size {
            0.06 * (high - low)
        } else {
            (1e-3 * size).max(0.5)
        };
        let begins = from_zero.filter(|zero| *zero == low);
        let (low, high) = (begins.unwrap_or(low - room), high + room);
        (low < high).then(|| Self {
            scale,
            low,
            high,
            ticks: ticks(scale, low, high),
        })
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let place = self.scale.place(*value).unwrap_or(self.low);
        let share = (place.clamp(self.low, self.high) - self.low) / (self.high - self.low);
        from + (f64::from(to - from) * share).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let shown = if hint.weight().allow_light_points() {
            &[]
        } else {
            &self.ticks[..]
        };
        shown.iter().map(|(tick, _)| *tick).collect()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        let of = self.ticks.iter().find(|(tick, _)| tick == value);
        of.map(|(_, label)| label.clone()).unwrap_or_default()
    }
}

fn ticks(scale: Scale, low: f64, high: f64) -> Vec<(f64, String)> {
    match scale {
        Scale::Linear | Scale::FromZero => linear(low, high),
        Scale::Count => {
            let mut ticks = linear(low, high);
            ticks.retain(|(tick, _)| tick.fract() == 0.0);
            for (tick, label) in &mut ticks {
                *label = format!("{tick:.0}");
            }
            ticks
        }
        Scale::Log { least } => {
            let mut ticks = logarithmic(low, high);
            // Where two powers of ten are too far away, even steps.
            if ticks.len() < 3 && high - low < 2.0 {
                ticks = linear(10f64.powf(low), 10f64.powf(high));
            }
            for (tick, label) in &mut ticks {
                if least.is_some_and(|least| *tick <= least * 1.001) {
                    *label = "0".into();
                }
            }
            ticks
        }
    }
}

/// Powers of ten, halved and doubled where there are few of them, between two exponents.
fn logarithmic(low: f64, high: f64) -> Vec<(f64, String)> {
    let factors: &[f64] = if high - low > 3.2 {
        &[1.0]
    } else {
        &[1.0, 2.0, 5.0]
    };
    let apart = ((high - low) / 8.0).ceil().max(1.0) as usize;
    let powers = (low.floor() as i32..=high.ceil() as i32).step_by(apart);
    let ticks = powers.flat_map(|power| factors.iter().map(move |factor| factor * 10f64.powi(power)));
    ticks
        .filter(|tick| (low - 1e-9..=high + 1e-9).contains(&tick.log10()))
        .map(|tick| (tick, number(tick)))
        .collect()
}

/// At most eight, with as many digits as tell them apart.
fn linear(low: f64, high: f64) -> Vec<(f64, String)> {
    let ticks = RangedCoordf64::from(low..high).key_points(BoldPoints(8));
    let step = match ticks[..] {
        [first, second, ..] => second - first,
        _ => high - low,
    };
    let digits = (-(step * 1.001).log10().floor()).clamp(0.0, 12.0) as usize;
    ticks
        .into_iter()
        .map(|tick| (tick, format!("{tick:.digits$}")))
        .collect()
}

fn number(value: f64) -> String {
    if !(1e-6..1e7).contains(&value) {
        return format!("{value:.0e}");
    }
    let digits = (2 - value.log10().floor() as i32).clamp(0, 8) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: Vec<(f64, String)>) -> Vec<String> {
        ticks.into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_lie_in_range_and_read_well() {
        assert_eq!(
            labels(logarithmic(0.0, 2.0)),
            ["1", "2", "5", "10", "20", "50", "100"]
        );
        assert_eq!(
            labels(logarithmic(-3.0, 1.0)),
            ["0.001", "0.01", "0.1", "1", "10"]
        );
        assert!((3..=9).contains(&logarithmic(-90.0, 90.0).len()));
        assert_eq!(labels(linear(0.1, 0.52)), ["0.1", "0.2", "0.3", "0.4", "0.5"]);
        let mut close = labels(linear(0.99992, 0.99998));
        close.dedup();
        assert!(
            close.len() >= 3 && close.iter().all(|label| label.len() == 7),
            "{close:?}"
        );
        assert_eq!(
            labels(linear(20.0, 140.0)),
            ["20", "40", "60", "80", "100", "120", "140"]
        );
        assert_eq!(
            ["0.05", "1", "0.0001", "200", "12.5", "1e-9", "1e12"],
            [0.05, 1.0, 1e-4, 200.0, 12.5, 1e-9, 1e12].map(number)
        );
    }

    #[test]
    fn a_logarithmic_axis_within_one_power_of_ten_has_ticks() {
        let log = Scale::Log { least: None };
        let axis = Axis::new(log, [0.94, 0.967].into_iter()).unwrap();
        assert!((3..=8).contains(&axis.ticks.len()), "{:?}", axis.ticks);
        assert!(axis.ticks.iter().all(|(tick, _)| (0.93..0.98).contains(tick)));
    }

    #[test]
    fn places_are_in_order_and_what_has_none_is_left_out() {
        let least = Scale::Log { least: Some(1e-6) };
        let axis = Axis::new(least, [0.0, 1.0, f64::NAN, f64::INFINITY].into_iter()).unwrap();
        let at = |value: f64| axis.map(&value, (0, 1000));
        assert!(at(0.0) == at(1e-6) && at(0.0) > 0 && at(1e-3) == 500 && at(1.0) < 1000);
        assert_eq!(axis.ticks[0].1, "0");
        assert!(least.place(f64::NAN).is_none() && Scale::Log { least: None }.place(0.0).is_none());
        for values in [[1e22, 1e22], [-1e99, 1e99], [1e-300, 2e-300], [0.0, 0.0]] {
            let axis = Axis::new(Scale::Linear, values.into_iter()).unwrap();
            assert!(
                axis.low < values[0] && values[1] < axis.high && axis.ticks.len() < 20,
                "{values:?}"
            );
        }
        let counts = Axis::new(Scale::Count, [1.0, 3.0].into_iter()).unwrap();
        assert_eq!(labels(counts.ticks), ["1", "2", "3"]);
        let zero = Axis::new(Scale::FromZero, [7.0].into_iter()).unwrap();
        assert_eq!((zero.low, &*zero.ticks[0].1), (0.0, "0"));
        assert!(Axis::new(Scale::Linear, [f64::NAN].into_iter()).is_none());
    }
}
