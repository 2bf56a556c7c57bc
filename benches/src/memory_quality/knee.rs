//! Where a curve bends.
//!
//! Source: Satopää, Albrecht, Irwin, Raghavan: Finding a "Kneedle" in a Haystack, 2011: the point farthest below the straight
//! line between the ends, both axes scaled to one; without the smoothing, which a few exact points do not need.

/// Index of the knee of a falling curve, given by rising x. `None` for fewer than three points, or where none lies below the line.
pub(super) fn knee(points: &[(f64, f64)]) -> Option<usize> {
    let (first, last) = (points.first()?, points.last()?);
    let (across, down) = (last.0 - first.0, first.1 - last.1);
    if points.len() < 3 || !(across > 0.0 && down > 0.0) {
        return None;
    }
    let below = |point: &(f64, f64)| 1.0 - (point.0 - first.0) / across - (point.1 - last.1) / down;
    let depths = points.iter().map(below).enumerate();
    let (at, depth) = depths.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (depth > 1e-9).then_some(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_knee_is_where_a_curve_turns() {
        let elbow = [(0.0, 10.0), (1.0, 6.0), (2.0, 1.0), (3.0, 0.8), (9.0, 0.0)];
        assert_eq!(knee(&elbow), Some(2));
        let hyperbola: Vec<_> = (1..=9).map(|x| (f64::from(x), 1.0 / f64::from(x))).collect();
        // 1/x is as steep as its chord at x = 3.
        assert_eq!(knee(&hyperbola), Some(2));
    }

    #[test]
    fn what_does_not_bend_has_none() {
        assert_eq!(knee(&[]), None);
        assert_eq!(knee(&[(0.0, 1.0), (1.0, 0.0)]), None);
        assert_eq!(knee(&[(0.0, 2.0), (1.0, 1.0), (2.0, 0.0)]), None);
        assert_eq!(knee(&[(0.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), None);
        assert_eq!(knee(&[(0.0, f64::NAN), (1.0, 1.0), (2.0, f64::NAN)]), None);
    }
}
