//! Where the names of points stand: beside them, and not on other names, points and curves.

use plotters::style::text_anchor::HPos;

/// What is drawn, and what was written, in pixels.
pub(super) struct Labels {
    /// Left, right, top, bottom of where names may stand.
    within: [f64; 4],
    pub(super) points: Vec<(f64, f64)>,
    pub(super) lines: Vec<[(f64, f64); 2]>,
    /// Boxes like `within`.
    written: Vec<[f64; 4]>,
}

/// Half a letter's height.
const HIGH: f64 = 5.5;

impl Labels {
    /// Nothing is drawn yet; names stand `within` left, right, top, bottom.
    pub(super) fn new(within: [f64; 4]) -> Self {
        Self {
            within,
            points: Vec::new(),
            lines: Vec::new(),
            written: Vec::new(),
        }
    }

    /// The place of which least is covered: x, the middle of the letters' height, and what of the text stands at x. `None` where it would
    /// cover another name.
    pub(super) fn place(&mut self, (x, y): (f64, f64), label: &str) -> Option<(f64, f64, HPos)> {
        let wide = 6.0 * label.chars().count() as f64;
        let sides = [(x + 9.0, HPos::Left), (x - 9.0, HPos::Right), (x, HPos::Center)];
        let places = sides.into_iter().flat_map(|(x, at)| {
            let rises = match at {
                HPos::Center => [-14.5, 14.5, -14.5],
                _ => [-8.5, 9.5, 0.5],
            };
            rises.map(|rise| (x, y + rise, at))
        });
        let boxed = |&(x, y, at): &(f64, f64, HPos)| {
            let left = match at {
                HPos::Left => x,
                HPos::Right => x - wide,
                HPos::Center => x - wide / 2.0,
            };
            [left, left + wide, y - HIGH, y + HIGH]
        };
        let cost = |place: &(f64, f64, HPos)| {
            let [left, right, top, bottom] = boxed(place);
            let [least_x, most_x, least_y, most_y] = self.within;
            let outside = left < least_x || right > most_x || top < least_y || bottom > most_y;
            let over = |of: &[f64; 4]| of[0] < right && left < of[1] && of[2] < bottom && top < of[3];
            if outside || self.written.iter().any(over) {
                return None;
            }
            let inside = |x: f64, y: f64| left < x && x < right && top < y && y < bottom;
            let points = self.points.iter().filter(|point| {
                let [x, y] = [point.0.clamp(left, right), point.1.clamp(top, bottom)];
                (x - point.0).hypot(y - point.1) < 4.0
            });
            let steps = |[from, to]: &&[(f64, f64); 2]| {
                (0..=64).any(|step| {
                    let share = f64::from(step) / 64.0;
                    inside(from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share)
                })
            };
            Some(10 * points.count() + self.lines.iter().filter(steps).count())
        };
        let found = places.filter_map(|place| Some((cost(&place)?, place)));
        let (_, place) = found.min_by_key(|(cost, _)| *cost)?;
        self.written.push(boxed(&place));
        Some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_cover_each_other() {
        let mut labels = Labels {
            points: vec![(200.0, 100.0), (203.0, 100.0), (420.0, 100.0)],
            lines: vec![[(100.0, 0.0), (300.0, 200.0)]],
            ..Labels::new([62.0, 478.0, 22.0, 244.0])
        };
        for point in labels.points.clone() {
            labels.place(point, "a setting").unwrap();
        }
        let [a, b, last] = labels.written[..] else {
            panic!("three names are written")
        };
        assert!(
            a[1] <= b[0] || b[1] <= a[0] || a[3] <= b[2] || b[3] <= a[2],
            "{a:?} {b:?}"
        );
        // Of the right edge names are on the left.
        assert!(last[1] < 420.0, "{last:?}");
        // Where all is full, none is written over another.
        let many = (0..50).filter(|_| labels.place((200.0, 100.0), "a setting").is_some());
        assert!(many.count() < 10);
    }
}
