//! Which model codes a coefficient: the magnitude that is expected of it, in classes.
//!
//! Expected is a weighted sum of the mean magnitude at this frequency, which stands in the tables, and of the
//! magnitudes of five neighbours of lower frequency in the block: of the same component, and with less weight of the
//! other three. The weights are those of a least-squares fit to eigen-textures of cloth, rounded. Integers, and one
//! conversion to f32 that rounds the same way everywhere.

use super::scan::Scan;
use super::transform::{AREA, SIDE};

/// Models of coefficients.
pub(super) const MODELS: usize = 48;
/// The unit of expected magnitudes is 1/4096.
const UNIT: f32 = 4096.0;
/// Weight of the mean magnitude in the tables.
const MEAN_WEIGHT: f32 = 0.65;
/// What a magnitude adds to what is expected of the same component, and of all four, in the same unit: as left or upper
/// neighbour, as the one between, and as the second to the left or above.
pub(super) const SIDE_WEIGHTS: [i32; 2] = [11 * 32, 3 * 32];
pub(super) const CORNER_WEIGHTS: [i32; 2] = [5 * 32, 32];
pub(super) const SECOND_WEIGHTS: [i32; 2] = [8 * 32, 32];
/// Magnitudes beyond this are taken for it; sums stay below 2³¹.
const LARGEST: u32 = 1 << 15;

/// Side of the grid of [`Expected`]: a block, and the neighbours that its last rows and columns name.
pub(super) const GRID_SIDE: usize = SIDE + 2;
pub(super) const GRID_AREA: usize = GRID_SIDE * GRID_SIDE;

/// Where those lie in the grid whose neighbour a place is, and with which weights.
const NEIGHBOURS: [(&[usize], [i32; 2]); 3] = [
    (&[1, GRID_SIDE], SIDE_WEIGHTS),
    (&[GRID_SIDE + 1], CORNER_WEIGHTS),
    (&[2, 2 * GRID_SIDE], SECOND_WEIGHTS),
];

/// Where a place of a block lies in the grid of [`Expected`].
#[inline(always)]
pub(super) fn grid_index(u: usize, v: usize) -> u16 {
    (u * GRID_SIDE + v) as u16
}

/// What a context says about a level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Context {
    /// The model.
    pub model: u8,
    /// Lowest bits of the level that are not modelled: where large levels are expected, these are noise.
    pub shift: u8,
}

/// A level as neighbours see it.
#[inline(always)]
pub(super) fn magnitude(level: i32) -> i32 {
    level.unsigned_abs().min(LARGEST) as i32
}

/// Classes of the mean magnitude in the tables: four an octave.
pub(super) const MEAN_CLASSES: u8 = 88;

/// Largest and least factor of a component, in quarters of an octave.
pub(super) const FACTOR_QUARTERS: std::ops::RangeInclusive<i8> = -24..=12;
/// Factors of components are multiples of 1/64.
const FACTOR_BITS: u32 = 6;

/// Mean magnitudes at the places of a full block, as [`mean_of_class`] gives them, and how many times more the components
/// of a group have.
#[derive(Clone, Copy)]
pub(in crate::codec::pyramid_dct) struct Means<'a> {
    pub(in crate::codec::pyramid_dct) places: &'a [i32; AREA],
    /// From [`factor`].
    pub(in crate::codec::pyramid_dct) factors: [i32; 4],
}

impl Means<'_> {
    /// The share of the means at a place in the expected magnitudes.
    #[inline(always)]
    pub(super) fn at(&self, place: u8) -> [i32; 4] {
        // Far from overflow: the largest mean times the largest factor is less than 2³¹.
        self.factors
            .map(|factor| (factor.wrapping_mul(self.places[usize::from(place)]) >> FACTOR_BITS) + 1)
    }
}

/// A component's factor: 64·2^(quarters/4), rounded.
pub(super) fn factor(quarters: i8) -> i32 {
    const MANTISSAS: [u64; 4] = [1 << 16, 77_936, 92_682, 110_218];
    let quarters = i32::from(quarters.clamp(*FACTOR_QUARTERS.start(), *FACTOR_QUARTERS.end()));
    let mantissa = MANTISSAS[quarters.rem_euclid(4) as usize];
    let shift = 16 - FACTOR_BITS as i32 - quarters.div_euclid(4);
    ((mantissa + (1 << (shift - 1))) >> shift) as i32
}

/// The share of the mean magnitude's class in the expected magnitude.
pub(super) fn mean_of_class(class: u8) -> i32 {
    let class = i32::from(class.min(MEAN_CLASSES - 1));
    ((4 + (class & 3)) << (class >> 2)) >> 2
}

/// What a mean magnitude of one is in [`mean_of_class`].
pub(super) fn mean_unit() -> f64 {
    f64::from(MEAN_WEIGHT * UNIT)
}

/// The class of a mean magnitude: the last one that is not larger than it by more than half a class.
pub(super) fn class_of_mean(mean: f64) -> u8 {
    let wanted = mean * mean_unit();
    let above = |class: u8| f64::from(mean_of_class(class) + mean_of_class(class + 1)) / 2.0 <= wanted;
    (0..MEAN_CLASSES - 1)
        .find(|&class| !above(class))
        .unwrap_or(MEAN_CLASSES - 1)
}

/// What is expected at each place of a block from the magnitudes known so far, one lane a component; without the means.
///
/// Known magnitudes are handed on to the places whose neighbours they are, rather than gathered there: most are zero,
/// and cost nothing.
#[repr(C, align(16))]
pub(super) struct Expected(pub(super) [[i32; 4]; GRID_AREA]);

impl Expected {
    /// Nothing known.
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self([[0; 4]; GRID_AREA])
    }

    /// Takes the magnitudes at a place ([`magnitude`], [`grid_index`]) into account.
    #[inline(always)]
    pub(super) fn add(&mut self, place: u16, magnitudes: [i32; 4]) {
        let all: i32 = magnitudes.iter().sum();
        let share = |[own, others]: [i32; 2]| magnitudes.map(|magnitude| own * magnitude + others * all);
        let place = usize::from(place);
        for (offsets, weights) in NEIGHBOURS {
            for &offset in offsets {
                for (sum, share) in self.0[place + offset].iter_mut().zip(share(weights)) {
                    // Far from overflow, as a test says.
                    *sum = sum.wrapping_add(share);
                }
            }
        }
    }

    /// The contexts at a place with these means, from [`Means::at`]. What was known for the place is forgotten.
    #[inline(always)]
    pub(super) fn take(&mut self, place: u16, means: [i32; 4]) -> [Context; 4] {
        let sums = std::mem::take(&mut self.0[usize::from(place)]);
        std::array::from_fn(|c| context(class(sums[c].wrapping_add(means[c]))))
    }

    /// Forgets what is known for the next block, all places of the first `end` diagonals being taken.
    #[inline(always)]
    pub(super) fn forget(&mut self, scan: &Scan, end: usize) {
        if scan.is_full() {
            // Neighbours are at most two diagonals away; no block has those beyond a full one.
            for place in scan.behind(end, 2) {
                self.0[usize::from(place.grid)] = [0; 4];
            }
        } else {
            *self = Self::new();
        }
    }
}

/// The class of an expected magnitude of at least 1: four an octave.
#[inline(always)]
fn class(expected: i32) -> i32 {
    // Exponent and the first two bits of the mantissa.
    ((expected as f32).to_bits() >> 21) as i32 - (127 << 2)
}

/// Classes below, of magnitudes less than 1/64, have a model in pairs.
pub(super) const FIRST_WHOLE: i32 = 4 * 6;
/// Classes from here on, of magnitudes from 8 on, have the models of 4 to 8, shifted.
pub(super) const FIRST_SHIFTED: i32 = 4 * 15;
/// Models of 4 to 8 begin here.
pub(super) const FIRST_SHIFTED_MODEL: i32 = MODELS as i32 - 4;

/// The context of a class: a quarter of an octave each, from 1/64 to 8; below it half an octave; above it those of 4 to
/// 8, shifted.
#[inline(always)]
pub(super) fn context(class: i32) -> Context {
    if class < FIRST_SHIFTED {
        // The second is the larger one from the first whole class on.
        let model = (class >> 1).max(class - FIRST_WHOLE / 2);
        Context {
            model: model as u8,
            shift: 0,
        }
    } else {
        Context {
            model: (FIRST_SHIFTED_MODEL + (class & 3)) as u8,
            shift: ((class >> 2) - (FIRST_SHIFTED >> 2) + 1) as u8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contexts_rise_with_the_expected_magnitude() {
        let context = |expected| super::context(class(expected));
        let rank = |expected| {
            let Context { model, shift } = context(expected);
            u32::from(shift) * 4 + u32::from(model)
        };
        assert_eq!(context(1), Context { model: 0, shift: 0 });
        assert_eq!(context(8 * 4096 - 1), Context { model: 47, shift: 0 });
        assert_eq!(context(8 * 4096), Context { model: 44, shift: 1 });
        let mut last = 0;
        for expected in (2..31).flat_map(|octave| [4, 5, 6, 7].map(|quarter| quarter << (octave - 2))) {
            assert!(rank(expected) >= last, "{expected}");
            last = rank(expected);
        }
        assert_eq!(last, 47 + 4 * (30 - 14));
    }

    #[test]
    fn sums_do_not_overflow() {
        let mut expected = Expected::new();
        for (u, v) in [(0, 2), (1, 1), (1, 2), (2, 0), (2, 1)] {
            expected.add(grid_index(u, v), [LARGEST as i32; 4]);
        }
        let means = Means {
            places: &[mean_of_class(MEAN_CLASSES - 1); AREA],
            factors: [factor(*FACTOR_QUARTERS.end()); 4],
        };
        assert!(means.places[0].checked_mul(means.factors[0]).is_some());
        let sum = expected.0[usize::from(grid_index(2, 2))][0];
        assert!(sum > 0 && sum.checked_add(means.at(0)[0]).is_some());
        let found = expected.take(grid_index(2, 2), means.at(0));
        assert!(found.iter().all(|context| context.shift > 0));
        assert_eq!(magnitude(i32::MIN), LARGEST as i32);
    }

    #[test]
    fn five_neighbours_of_lower_frequency_count() {
        let magnitudes = [1, 2, 3, 4];
        let share = |[own, others]: [i32; 2]| magnitudes.map(|m| own * m + others * 10);
        let (side, corner, second) = (share(SIDE_WEIGHTS), share(CORNER_WEIGHTS), share(SECOND_WEIGHTS));
        for u in 0..SIDE {
            for v in 0..SIDE {
                let mut expected = Expected::new();
                expected.add(grid_index(u, v), magnitudes);
                for x in 0..SIDE {
                    for y in 0..SIDE {
                        let wanted = match (x.wrapping_sub(u), y.wrapping_sub(v)) {
                            (1, 0) | (0, 1) => side,
                            (1, 1) => corner,
                            (2, 0) | (0, 2) => second,
                            _ => [0; 4],
                        };
                        assert_eq!(expected.0[usize::from(grid_index(x, y))], wanted);
                    }
                }
            }
        }
    }

    #[test]
    fn nothing_is_known_in_the_next_block() {
        for (size, low) in [((16, 16), (8, 8)), ((16, 16), (0, 0)), ((5, 13), (3, 7))] {
            let scan = Scan::new(size, low);
            for end in 0..40 {
                let mut expected = Expected::new();
                for place in scan.places(end) {
                    expected.take(place.grid, [1; 4]);
                    expected.add(place.grid, [1, 0, 2, 0]);
                }
                expected.forget(&scan, end);
                for other in [Scan::new((16, 16), (0, 0)), scan.clone()] {
                    for place in other.places(40) {
                        assert_eq!(
                            expected.0[usize::from(place.grid)],
                            [0; 4],
                            "{size:?} {end} {place:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn classes_of_means_are_near() {
        for mean in [0.01, 0.1, 0.5, 1.0, 3.0, 20.0] {
            let found = f64::from(mean_of_class(class_of_mean(mean))) / mean_unit();
            assert!((found / mean - 1.0).abs() < 0.15, "{mean} {found}");
        }
        assert_eq!(mean_of_class(class_of_mean(0.0)), 1);
    }

    #[test]
    fn factors_are_near() {
        for quarters in FACTOR_QUARTERS {
            let exact = 64.0 * (f64::from(quarters) / 4.0).exp2();
            assert!((f64::from(factor(quarters)) - exact).abs() <= 0.5, "{quarters}");
        }
    }
}
