//! Filling the holes of one channel of one image from what surrounds them.

use crate::npy::MAX_SAMPLE;

/// Whether a sample is one that no reflectance can have: NaN, infinite, or beyond [`MAX_SAMPLE`].
pub(super) fn is_bad(value: f64) -> bool {
    !value.is_finite() || value.abs() > MAX_SAMPLE
}

/// Replaces every bad sample of `plane`, `[y][x]` in rows of `width`, and says whether that was possible: it is not
/// where no sample is good.
///
/// Each becomes the mean of the good samples among its eight neighbours; where there are none it waits until its
/// neighbours are filled, so that a hole closes from its rim, ring by ring. A mean over a window that grows until it
/// meets good samples would look the same, but costs the square of the hole's radius for every texel.
pub(super) fn fill(plane: &mut [f32], width: usize, wrap: bool) -> bool {
    let mut front: Vec<u32> = Vec::new(); // 65,536² texels are numbered by 32 bits
    for (texel, sample) in plane.iter_mut().enumerate() {
        if is_bad((*sample).into()) {
            *sample = f32::NAN;
            front.push(texel as u32);
        }
    }
    if front.len() == plane.len() {
        return false;
    }
    let grid = Grid {
        width,
        height: plane.len() / width,
        wrap,
    };
    while !front.is_empty() {
        let ring: Vec<(u32, f32)> = front
            .iter()
            .filter_map(|&texel| Some((texel, grid.mean_around(plane, texel)?)))
            .collect();
        for &(texel, mean) in &ring {
            plane[texel as usize] = mean;
        }
        front.clear();
        for &(texel, _) in &ring {
            front.extend(grid.around(texel).filter(|&next| plane[next as usize].is_nan()));
        }
        front.sort_unstable();
        front.dedup();
    }
    true
}

/// Who is whose neighbour.
struct Grid {
    width: usize,
    height: usize,
    wrap: bool,
}

impl Grid {
    /// The neighbours of a texel: eight, or fewer at an edge that does not wrap.
    fn around(&self, texel: u32) -> impl Iterator<Item = u32> {
        let (x, y) = (texel as usize % self.width, texel as usize / self.width);
        let step = |at: usize, by: usize, size: usize| match at + by {
            // `by` is one more than the step, so that it has no sign.
            0 if self.wrap => Some(size - 1),
            0 => None,
            next if next <= size => Some(next - 1),
            _ if self.wrap => Some(0),
            _ => None,
        };
        (0..9).filter(|&place| place != 4).filter_map(move |place| {
            let x = step(x, place % 3, self.width)?;
            let y = step(y, place / 3, self.height)?;
            Some((y * self.width + x) as u32)
        })
    }

    /// Mean of the good neighbours of a texel, if there are any.
    fn mean_around(&self, plane: &[f32], texel: u32) -> Option<f32> {
        let (mut sum, mut count) = (0.0, 0u32);
        for sample in self.around(texel).map(|next| plane[next as usize]) {
            if !sample.is_nan() {
                sum += f64::from(sample);
                count += 1;
            }
        }
        (count > 0).then(|| (sum / f64::from(count)) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_becomes_the_mean_of_its_rim() {
        let mut plane = [1.0, 2.0, 3.0, 4.0, f32::NAN, 6.0, 7.0, 8.0, 9.0];
        assert!(fill(&mut plane, 3, false));
        assert_eq!(plane, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    }

    #[test]
    fn corners_see_the_other_side_only_where_the_material_repeats() {
        // At the corner: 1 to the right, 3 below, 5 across; where it repeats, the far edges as well.
        let with = |wrap| {
            let mut plane = [f32::INFINITY, 1.0, 9.0, 3.0, 5.0, 9.0, 9.0, 9.0, 9.0];
            assert!(fill(&mut plane, 3, wrap));
            plane[0]
        };
        assert_eq!(with(false), 3.0);
        assert_eq!(with(true), (1.0 + 3.0 + 5.0 + 5.0 * 9.0) / 8.0);
    }

    #[test]
    fn large_holes_close_ring_by_ring_within_the_range_of_what_is_good() {
        let (width, height) = (301, 200);
        let mut plane = vec![-f32::INFINITY; width * height];
        plane[0] = 2.0;
        plane[width * height - 1] = 4.0;
        assert!(fill(&mut plane, width, false));
        assert!(plane.iter().all(|sample| (2.0..=4.0).contains(sample)));
        assert_eq!((plane[1], plane[width * height - 2]), (2.0, 4.0));
    }

    #[test]
    fn planes_of_one_row_or_texel() {
        for wrap in [false, true] {
            let mut row = [f32::NAN, 2e12, 3.0, f32::NAN];
            assert!(fill(&mut row, 4, wrap));
            assert_eq!(row, [3.0; 4]);
            let mut column = [f32::NAN, 7.0];
            assert!(fill(&mut column, 1, wrap));
            assert_eq!(column, [7.0; 2]);
            assert!(!fill(&mut [f32::NAN], 1, wrap));
            assert!(!fill(&mut [f32::NAN; 6], 3, wrap));
        }
    }
}
