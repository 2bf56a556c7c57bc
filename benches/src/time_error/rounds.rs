//! Times of a setting and of the default, by turns.

use crate::Result;
use crate::engine::{median, quantile};

/// What they took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Times {
    /// Milliseconds of the setting, median.
    pub(super) ms: f64,
    /// Time over that of the default beside it, median.
    pub(super) ratio: f64,
    /// Half the distance of the quartiles of that.
    pub(super) noise: f64,
}

/// Runs the default (`false`) and the setting (`true`) so often; each run gives its milliseconds. Who goes first changes.
pub(super) fn alternate(rounds: usize, mut run: impl FnMut(bool) -> Result<f64>) -> Result<Times> {
    let (mut times, mut ratios) = (Vec::new(), Vec::new());
    for round in 0..rounds.max(1) {
        let first = round % 2 == 1;
        let (mut with, mut without) = (0.0, 0.0);
        for which in [first, !first] {
            *(if which { &mut with } else { &mut without }) = run(which)?;
        }
        times.push(with);
        ratios.push(with / f64::max(without, 1e-9));
    }
    Ok(Times {
        ms: median(&mut times),
        ratio: median(&mut ratios),
        noise: (quantile(&mut ratios, 0.75) - quantile(&mut ratios, 0.25)) / 2.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_of_neighbours() {
        let mut calls = Vec::new();
        // The machine becomes slower with each run; the setting takes twice as long.
        let times = alternate(5, |which| {
            calls.push(which);
            Ok((100.0 + calls.len() as f64) * if which { 2.0 } else { 1.0 })
        });
        let times = times.unwrap();
        assert!(
            (times.ratio - 2.0).abs() < 0.05 && times.noise < 0.05,
            "{times:?}"
        );
        assert!(times.ms > 200.0);
        assert_eq!(calls[..4], [false, true, true, false]);
    }
}
