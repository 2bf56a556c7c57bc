//! Which model codes a coefficient: the magnitude that is expected of it, in classes.
//!
//! Expected is a weighted sum of the mean magnitude at this frequency, which stands in the tables, and of the
//! magnitudes of five neighbours of lower frequency in the block: of the same component, and with less weight of the
//! other three. The weights are those of a least-squares fit to eigen-textures of cloth, rounded. Integers, and one
//! conversion to f32 that rounds the same way everywhere.

use super::scan::Place;
use super::transform::{AREA, SIDE};

/// Models of coefficients.
pub(super) const MODELS: usize = 48;
/// The unit of expected magnitudes is 1/4096.
const UNIT: f32 = 4096.0;
/// Weight of the mean magnitude in the tables.
const MEAN_WEIGHT: f32 = 0.38;
/// Weights of neighbours in units of 1/128, [`NEIGHBOUR_UNIT`]: for the same component those of the left and upper
/// one, the one between, and the second to the left and above; for all components together the first two, and the
/// other three.
const SIDES: i32 = 11;
const CORNER: i32 = 5;
const SECONDS: i32 = 8;
const ALL_SIDES: i32 = 3;
const ALL_OTHERS: i32 = 1;
const NEIGHBOUR_UNIT: i32 = 32;
/// Magnitudes beyond this are taken for it; sums stay below 2³¹.
const LARGEST: u32 = 1 << 15;

/// Magnitudes of the levels of one diagonal of a block, by row behind two zeros, one lane a component. What lies
/// outside of the block or comes from the parent is zero.
pub(super) type Diagonal = [[u16; 4]; SIDE + 2];
/// Nothing but zeros.
pub(super) const EMPTY: Diagonal = [[0; 4]; SIDE + 2];
/// Where [`Diagonal`] holds the first row.
pub(super) const FIRST_ROW: usize = 2;

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
pub(super) fn magnitude(level: i32) -> u16 {
    level.unsigned_abs().min(LARGEST) as u16
}

/// Classes of the mean magnitude in the tables: four an octave.
pub(super) const MEAN_CLASSES: u8 = 96;

/// The share of the mean magnitude's class in the expected magnitude.
pub(super) fn mean_of_class(class: u8) -> i32 {
    let class = i32::from(class.min(MEAN_CLASSES - 1));
    ((4 + (class & 3)) << (class >> 2)) >> 2
}

/// The class of a mean magnitude: the last one that is not larger than it by more than half a class.
pub(super) fn class_of_mean(mean: f64) -> u8 {
    let wanted = mean * f64::from(MEAN_WEIGHT * UNIT);
    let above = |class: u8| f64::from(mean_of_class(class) + mean_of_class(class + 1)) / 2.0 <= wanted;
    (0..MEAN_CLASSES - 1)
        .find(|&class| !above(class))
        .unwrap_or(MEAN_CLASSES - 1)
}

/// What stands for the contexts of the four components' levels at one place: four classes of expected magnitude an
/// octave.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Class([i32; 4]);

/// The classes in the rows of a diagonal that `places` name, from the last diagonal and the one before it; `means` by
/// [`Place::like`] come from [`mean_of_class`].
#[inline(always)]
pub(super) fn classes(
    last: &Diagonal,
    before: &Diagonal,
    places: &[Place],
    means: &[i32; AREA],
) -> [Class; SIDE] {
    const LANES: usize = 4 * SIDE;
    let last: &[u16; LANES + 8] = bytemuck::cast_ref(last);
    let before: &[u16; LANES + 8] = bytemuck::cast_ref(before);
    // All rows and components at once, which makes vectors.
    let (mut own, mut all) = ([0; LANES], [0; LANES]);
    for i in 0..LANES {
        let (left, upper) = (i32::from(last[i + 8]), i32::from(last[i + 4]));
        let (far_left, corner, far_upper) = (
            i32::from(before[i + 8]),
            i32::from(before[i + 4]),
            i32::from(before[i]),
        );
        let (sides, seconds) = (left + upper, far_left + far_upper);
        own[i] = (SIDES * sides + CORNER * corner + SECONDS * seconds) * NEIGHBOUR_UNIT;
        all[i] = (ALL_SIDES * sides + ALL_OTHERS * (corner + seconds)) * NEIGHBOUR_UNIT;
    }
    let (own, all): ([[i32; 4]; SIDE], [[i32; 4]; SIDE]) = (bytemuck::cast(own), bytemuck::cast(all));
    let mut classes = [Class::default(); SIDE];
    for place in places {
        let row = usize::from(place.row) % SIDE;
        let [a, b, c, d] = all[row];
        // Far from overflow, as a test says; unchecked, this is vectors too.
        let shared = a
            .wrapping_add(c)
            .wrapping_add(b.wrapping_add(d))
            .wrapping_add(means[usize::from(place.like)]);
        for (to, own) in classes[row].0.iter_mut().zip(own[row]) {
            *to = class(own.wrapping_add(shared));
        }
    }
    classes
}

impl Class {
    /// Whether no context has a shift, so that [`Self::models`] says all.
    #[inline(always)]
    pub(super) fn are_unshifted(&self) -> bool {
        self.largest() < FIRST_SHIFTED
    }

    /// Whether all four levels are likely to be zero.
    #[inline(always)]
    pub(super) fn are_likely_zero(&self) -> bool {
        self.largest() < LIKELY_ZERO
    }

    #[inline(always)]
    fn largest(&self) -> i32 {
        let [a, b, c, d] = self.0;
        a.max(c).max(b.max(d))
    }

    /// The models of contexts without shifts.
    #[inline(always)]
    pub(super) fn models(&self) -> [usize; 4] {
        let mut models = [0; 4];
        for (model, class) in models.iter_mut().zip(self.0) {
            // The second is the larger one from the first whole class on.
            *model = (class >> 1).max(class.wrapping_sub(FIRST_WHOLE / 2)) as usize;
        }
        models
    }

    /// The contexts.
    #[inline(always)]
    pub(super) fn contexts(&self) -> [Context; 4] {
        self.0.map(|class| CONTEXTS[(class & 127) as usize])
    }
}

/// The class of an expected magnitude of at least 1: four an octave.
#[inline(always)]
fn class(expected: i32) -> i32 {
    // Exponent and the first two bits of the mantissa.
    ((expected as f32).to_bits() >> 21) as i32 - (127 << 2)
}

/// Classes below, of magnitudes less than 1/64, have a model in pairs.
const FIRST_WHOLE: i32 = 4 * 6;
/// Classes from here on, of magnitudes from 8 on, have the models of 4 to 8, shifted.
const FIRST_SHIFTED: i32 = 4 * 15;

/// Classes below, of magnitudes less than 1/16, are nearly always zero.
const LIKELY_ZERO: i32 = 4 * 8;

/// Contexts by class: a quarter of an octave each, from 1/64 to 8; below it half an octave; above it those of 4 to 8,
/// shifted.
static CONTEXTS: [Context; 128] = {
    let mut contexts = [Context { model: 0, shift: 0 }; 128];
    let mut class = 0;
    while class < 128 {
        let octave = class >> 2;
        contexts[class] = if octave < 6 {
            Context {
                model: (class >> 1) as u8,
                shift: 0,
            }
        } else if octave < 15 {
            Context {
                model: (12 + class - 24) as u8,
                shift: 0,
            }
        } else {
            Context {
                model: (MODELS - 4 + (class & 3)) as u8,
                shift: (octave - 14) as u8,
            }
        };
        class += 1;
    }
    contexts
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contexts_rise_with_the_expected_magnitude() {
        let context = |expected| Class([class(expected); 4]).contexts()[0];
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
    fn models_are_those_of_the_contexts() {
        for first in 0..FIRST_SHIFTED - 3 {
            let class = Class(std::array::from_fn(|c| first + c as i32));
            assert!(class.are_unshifted());
            assert_eq!(
                class.models(),
                class.contexts().map(|context| usize::from(context.model))
            );
            assert!(class.contexts().iter().all(|context| context.shift == 0));
        }
        assert!(!Class([0, 0, FIRST_SHIFTED, 0]).are_unshifted());
    }

    #[test]
    fn sums_do_not_overflow() {
        let diagonal = [[LARGEST as u16; 4]; SIDE + 2];
        let place = Place {
            at: 255,
            row: 15,
            like: 255,
        };
        let found = classes(&diagonal, &diagonal, &[place], &[mean_of_class(255); AREA]);
        assert!(found[15].contexts().iter().all(|context| context.shift > 0));
        assert_eq!(magnitude(i32::MIN), LARGEST as u16);
    }

    #[test]
    fn classes_of_means_are_near() {
        for mean in [0.01, 0.1, 0.5, 1.0, 3.0, 20.0] {
            let found = f64::from(mean_of_class(class_of_mean(mean))) / f64::from(MEAN_WEIGHT * UNIT);
            assert!((found / mean - 1.0).abs() < 0.15, "{mean} {found}");
        }
        assert_eq!(mean_of_class(class_of_mean(0.0)), 1);
    }
}
