//! The order of a block's coefficients: by diagonals of rising frequency, so that those of one diagonal know all
//! neighbours of lower frequency.

use super::context::grid_index;
use super::transform::SIDE;

/// Diagonals of a full block; `u + v` is the number of a diagonal.
pub(super) const DIAGONALS: usize = 2 * SIDE - 1;

/// One coefficient that is coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// Index in the block, `u`·16 + `v`.
    pub at: u8,
    /// The place for its neighbours; see [`super::context::grid_index`].
    pub grid: u16,
    /// Index of the place in a full block that has this share of the highest frequency: whose statistics hold.
    pub like: u8,
}

/// The coefficients of a block of some size.
#[derive(Clone, Debug)]
pub(super) struct Scan {
    places: Vec<Place>,
    /// First place of each diagonal, and the number of places.
    starts: [u16; DIAGONALS + 1],
    full: bool,
}

impl Scan {
    /// Coefficients of a block of `width` × `height`, but for the lowest `low.0` × `low.1`, which come from the parent.
    pub(super) fn new((width, height): (usize, usize), low: (usize, usize)) -> Self {
        let mut places = Vec::new();
        let mut starts = [0; DIAGONALS + 1];
        for (diagonal, start) in starts.iter_mut().enumerate() {
            *start = places.len() as u16;
            let rows = diagonal.saturating_sub(width - 1)..height.min(diagonal + 1);
            places.extend(rows.filter_map(|v| {
                let u = diagonal - v;
                (u >= low.0 || v >= low.1).then_some(Place {
                    at: (u * SIDE + v) as u8,
                    grid: grid_index(u, v),
                    like: (v * SIDE / height * SIDE + u * SIDE / width) as u8,
                })
            }));
        }
        Self {
            places,
            starts,
            full: (width, height) == (SIDE, SIDE),
        }
    }

    /// The places of the first `diagonals` diagonals.
    #[inline(always)]
    pub(super) fn places(&self, diagonals: usize) -> &[Place] {
        &self.places[..usize::from(self.starts[diagonals.min(DIAGONALS)])]
    }

    /// The places of the `count` diagonals behind the first `diagonals`.
    #[inline(always)]
    pub(super) fn behind(&self, diagonals: usize, count: usize) -> &[Place] {
        let first = usize::from(self.starts[diagonals.min(DIAGONALS)]);
        &self.places[first..usize::from(self.starts[(diagonals + count).min(DIAGONALS)])]
    }

    /// Whether it is that of a full block.
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.full
    }
}

/// The number of a place in the scan of a block of `size` without the lowest `low`, in closed form: as decoders find it
/// that begin at the place.
#[cfg(test)]
pub(super) fn index(size: (usize, usize), low: (usize, usize), (u, v): (usize, usize)) -> Option<usize> {
    if u < low.0 && v < low.1 {
        return None;
    }
    let diagonal = (u + v) as i32;
    let triangle = |n: i32| n.max(0) * (n.max(0) + 1) / 2;
    // Places of a rectangle on the diagonals before, and on this one in the rows before.
    let before = |(width, height): (usize, usize)| {
        let (width, height, v) = (width as i32, height as i32, v as i32);
        let diagonals = triangle(diagonal) - triangle(diagonal - width) - triangle(diagonal - height)
            + triangle(diagonal - width - height);
        diagonals + (v.min(height).min(diagonal + 1) - (diagonal - width + 1).max(0)).max(0)
    };
    Some((before(size) - before(low)) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closed_form_is_the_scan() {
        for (width, height) in (1..=SIDE).flat_map(|width| (1..=SIDE).map(move |height| (width, height))) {
            let low = (width.div_ceil(2), height.div_ceil(2));
            let scan = Scan::new((width, height), low);
            let mut found: Vec<_> = (0..width)
                .flat_map(|u| (0..height).map(move |v| (u, v)))
                .filter_map(|(u, v)| Some((index((width, height), low, (u, v))?, u * SIDE + v)))
                .collect();
            found.sort_unstable();
            let wanted: Vec<_> = (0..)
                .zip(scan.places.iter().map(|place| usize::from(place.at)))
                .collect();
            assert_eq!(found, wanted, "{width}x{height}");
        }
    }

    #[test]
    fn each_coefficient_comes_once_and_after_its_neighbours() {
        for (size, low) in [
            ((16, 16), (8, 8)),
            ((16, 16), (0, 0)),
            ((1, 1), (0, 0)),
            ((5, 16), (3, 8)),
            ((1, 2), (1, 1)),
        ] {
            let scan = Scan::new(size, low);
            let places = &scan.places;
            assert_eq!(places.len(), size.0 * size.1 - low.0 * low.1);
            let order: Vec<_> = places.iter().map(|place| place.at).collect();
            let mut sorted = order.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), order.len());
            let sums: Vec<_> = order
                .iter()
                .map(|&at| usize::from(at) / SIDE + usize::from(at) % SIDE)
                .collect();
            assert!(sums.is_sorted());
            assert!(scan.places(0).is_empty());
            for diagonals in 0..=DIAGONALS {
                let count = sums.iter().filter(|&&sum| sum < diagonals).count();
                assert_eq!(scan.places(diagonals), &places[..count]);
            }
        }
        assert_eq!(
            Scan::new((8, 8), (4, 4)).places.last().unwrap().like,
            14 * 16 + 14
        );
    }
}
