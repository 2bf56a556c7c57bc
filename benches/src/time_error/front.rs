//! The Pareto front: settings that none beats in all that they are judged by.

use super::Point;

/// Work and bytes that differ by less than this share are equal.
const SAME: f64 = 0.01;
/// Errors likewise: they do not depend on the machine, but sums in f32 do on its threads.
const SAME_ERROR: f64 = 0.001;
/// Errors below this are rounding.
const NO_ERROR: f64 = 1e-6;

/// What tells which of two settings is slower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judge {
    /// Times, beyond their noise; where noise hides it, the count of work.
    Measured,
    /// The count of work alone: the same on every machine.
    Counted,
}

/// For each point another one that is surely no slower, no larger and no worse, and better in one of these.
pub(super) fn beaten(points: &[Point], judge: Judge) -> Vec<Option<usize>> {
    let by = |loser: &Point| {
        let better = points
            .iter()
            .enumerate()
            .filter(|(_, winner)| beats(winner, loser, judge));
        // The one with the least error, so that who reads of it finds one that is on the front.
        better
            .min_by(|a, b| a.1.error.total_cmp(&b.1.error))
            .map(|(at, _)| at)
    };
    points.iter().map(by).collect()
}

fn beats(a: &Point, b: &Point, judge: Judge) -> bool {
    let noise = a.noise + b.noise;
    let less_work = a.work < b.work * (1.0 - SAME);
    let (no_slower, faster) = match judge {
        Judge::Counted => (a.work <= b.work, less_work),
        Judge::Measured => {
            let faster = a.ratio + noise < b.ratio;
            (faster || a.work <= b.work && a.ratio <= b.ratio + noise, faster)
        }
    };
    let (bytes, other_bytes) = (a.bytes.unwrap_or(0) as f64, b.bytes.unwrap_or(0) as f64);
    let no_worse = a.error <= b.error * (1.0 + SAME_ERROR) + NO_ERROR && bytes <= other_bytes;
    let better = a.error < b.error * (1.0 - SAME_ERROR) - NO_ERROR;
    no_slower && no_worse && (faster || better || bytes < other_bytes * (1.0 - SAME))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(ratio: f64, work: f64, bytes: u64, error: f64) -> Point {
        Point {
            setting: format!("{ratio} {error}"),
            ms: 10.0 * ratio,
            ratio,
            noise: 0.02,
            work,
            bytes: Some(bytes),
            error,
            error_of_btf: None,
            beaten_by: None,
        }
    }

    #[test]
    fn what_is_worse_in_all_is_beaten() {
        let points = [
            point(1.0, 100.0, 10, 0.01),
            point(0.5, 50.0, 10, 0.05),
            point(0.8, 80.0, 10, 0.06),
            point(1.2, 120.0, 10, 0.01),
        ];
        for judge in [Judge::Measured, Judge::Counted] {
            assert_eq!(beaten(&points, judge), [None, None, Some(1), Some(0)]);
        }
    }

    #[test]
    fn noise_beats_nobody() {
        let points = [point(1.0, 100.0, 10, 0.01), point(0.98, 101.0, 10, 0.01)];
        assert_eq!(beaten(&points, Judge::Measured), [None, None]);
        // The same work with a better picture is better, unless it was surely slower.
        let points = [point(1.0, 100.0, 10, 0.01), point(1.03, 100.0, 10, 0.001)];
        assert_eq!(beaten(&points, Judge::Measured), [Some(1), None]);
        let points = [point(1.0, 100.0, 10, 0.01), point(1.1, 100.0, 10, 0.001)];
        assert_eq!(beaten(&points, Judge::Measured), [None, None]);
    }

    #[test]
    fn memory_is_a_reason_too() {
        let points = [
            point(1.0, 100.0, 10, 0.0),
            point(1.0, 100.0, 5, 0.02),
            point(1.0, 100.0, 10, 0.02),
        ];
        assert_eq!(beaten(&points, Judge::Counted), [None, None, Some(0)]);
    }
}
