//! What magnitude is expected of a coefficient, and the class of it that selects the model.
//!
//! Both sides walk the coefficients in one order, `[view][light][rgb][component]`, and know what lies behind.
//! The expected magnitude mixes what the tables say of the place (a separable profile of the archive and a
//! level of the component) with neighbours: the same colour at the functions before in view and light, and
//! the components before at the same place. Integers only.
//!
//! The weights were fitted on cloth, leather and gravel at two steps each. The profile alone takes 2 to 8 % more
//! bytes, neighbours in view and light alone 9 to 17 %; a complete table of all places, if it were free, would
//! save up to 5 %.

/// Classes of expected magnitudes.
pub(super) const CLASSES: usize = 32;
/// Level of a component of which all coefficients are zero.
pub(super) const EMPTY: i8 = i8::MIN;
/// One magnitude, where fractions are needed.
const ONE: u32 = 1 << 10;
/// Class 0 ends here: an expected magnitude of 2⁻⁸.
const LEAST_LOG: u32 = 2;
/// Octaves above, up to a magnitude of 16, that have two classes each; larger ones have one.
const FINE_OCTAVES: u32 = 12;
/// Magnitudes beyond this are all alike as neighbours.
const LARGEST_NEIGHBOUR: u32 = u16::MAX as u32;

/// Expected magnitudes along each axis, as quarters of an octave relative to the level of the component.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Profile {
    pub views: Vec<i8>,
    pub lights: Vec<i8>,
    pub colours: [i8; 3],
}

/// Nearest quarter of an octave.
pub(super) fn quarter_octaves(ratio: f64) -> i8 {
    // A ratio of 0 ends at the lower bound, and 0/0 in the middle.
    (4.0 * ratio.log2()).round().clamp(-127.0, 127.0) as i8
}

/// `ONE`·2^(quarters/4), within 1 and 2²⁶.
fn from_quarter_octaves(quarters: i32) -> u32 {
    const MANTISSAS: [u64; 4] = [1 << 14, 19_484, 23_170, 27_554];
    let quarters = quarters.clamp(-40, 64);
    (MANTISSAS[quarters.rem_euclid(4) as usize] << (quarters.div_euclid(4) + 10) >> 14) as u32
}

fn class(expected: u32) -> usize {
    let log = expected.checked_ilog2().unwrap_or(0);
    if log < LEAST_LOG {
        return 0;
    }
    let octave = log - LEAST_LOG;
    let class = if octave < FINE_OCTAVES {
        1 + 2 * octave + (expected >> (log - 1) & 1)
    } else {
        1 + FINE_OCTAVES + octave
    };
    (class as usize).min(CLASSES - 1)
}

/// Walks the coefficients of a group. `code` is asked for the magnitude of each with its place, its component
/// and its class; it is not asked for components whose level is [`EMPTY`].
#[inline(always)]
pub(super) fn walk(profile: &Profile, levels: [i8; 4], mut code: impl FnMut(usize, usize, usize) -> u32) {
    // By quarters of an octave from the least sum of a profile and a level, weighted already.
    const LEAST: i32 = -512;
    let weighted: Vec<u32> = (LEAST..512)
        .map(|quarters| 5 * from_quarter_octaves(quarters))
        .collect();
    let lights = profile.lights.len();
    // One function more on either side, always zero.
    let mut above = vec![[[0u32; 4]; 3]; lights + 2];
    let mut row = above.clone();
    let mut place = 0;
    for &view in &profile.views {
        for (light, &of_light) in profile.lights.iter().enumerate() {
            for (colour, &of_colour) in profile.colours.iter().enumerate() {
                let of_place = i32::from(view) + i32::from(of_light) + i32::from(of_colour) - LEAST;
                let (before, after) = (above[light][colour], above[light + 2][colour]);
                let (here, left) = (above[light + 1][colour], row[light][colour]);
                let around: [u32; 4] =
                    std::array::from_fn(|c| 2 * (here[c] + left[c]) + before[c] + after[c]);
                let mut magnitudes = [0u32; 4];
                for c in 0..4 {
                    if levels[c] == EMPTY {
                        continue;
                    }
                    let others = match c {
                        0 => 0,
                        1 => 4 * magnitudes[0],
                        2 => 4 * magnitudes[1] + 2 * magnitudes[0],
                        _ => 4 * magnitudes[2] + 2 * (magnitudes[1] + magnitudes[0]),
                    };
                    let prior = weighted[(of_place + i32::from(levels[c])) as usize & 1023];
                    let expected = (prior + (around[c] + others) * ONE) >> 4;
                    magnitudes[c] = code(place, c, class(expected)).min(LARGEST_NEIGHBOUR);
                }
                row[light + 1][colour] = magnitudes;
                place += 1;
            }
        }
        std::mem::swap(&mut above, &mut row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_of_octaves_come_back() {
        for quarters in -40..=64 {
            let exact = f64::from(ONE) * (f64::from(quarters) / 4.0).exp2();
            let value = f64::from(from_quarter_octaves(quarters));
            assert!(
                (value - exact).abs() <= 1.0 + exact * 1e-4,
                "{quarters}: {value}, {exact}"
            );
            if quarters > -20 {
                assert_eq!(i32::from(quarter_octaves(value / f64::from(ONE))), quarters);
            }
        }
        assert_eq!(quarter_octaves(0.0), -127);
        assert_eq!(quarter_octaves(f64::INFINITY), 127);
        assert_eq!(quarter_octaves(f64::NAN), 0);
    }

    #[test]
    fn classes_rise_and_fit() {
        let mut last = 0;
        for expected in (0..1u32 << 16).chain((16..32).flat_map(|b| [1 << b, (1 << b) + (1 << (b - 1))])) {
            let class = class(expected);
            assert!(class == last || class == last + 1, "{expected}");
            last = class;
        }
        assert_eq!(last, CLASSES - 1);
        assert_eq!(class(u32::MAX), CLASSES - 1);
    }

    #[test]
    fn walks_are_complete_and_bounded() {
        let profile = Profile {
            views: vec![127; 3],
            lights: vec![127, -127],
            colours: [127, 0, -127],
        };
        let mut places = Vec::new();
        walk(&profile, [127, EMPTY, -127, 0], |place, component, class| {
            assert!(class < CLASSES);
            places.push((place, component));
            u32::MAX
        });
        let all: Vec<_> = (0..18)
            .flat_map(|place| [0, 2, 3].map(|component| (place, component)))
            .collect();
        assert_eq!(places, all);
    }
}
