//! The directions in which well-known measurements sampled views and lights.

use tileset::Direction;

/// A set of directions on the upper hemisphere, in rings around the normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sampling {
    /// 31 directions up to 75°: a share of the time and bytes of the others, for drafts and tests.
    Sparse31,
    /// 81 directions up to 75° (UBO2003, ATRIUM: Sattler, Sarlette, Klein, Efficient and Realistic
    /// Visualization of Cloth, 2003).
    Bonn81,
    /// 151 directions up to 75° (UBO2014: Weinmann, Gall, Klein, Material Classification Based on Training
    /// Data Synthesized Using a BTF Database, 2014).
    Ubo151,
}

/// One ring: polar angle and first azimuth in degrees, and the number of evenly spaced directions.
struct Ring(f64, f64, u32);

const SPARSE31: [Ring; 4] = [
    Ring(0.0, 0.0, 1),
    Ring(27.0, 0.0, 6),
    Ring(51.0, 18.0, 10),
    Ring(75.0, 0.0, 14),
];

const BONN81: [Ring; 6] = [
    Ring(0.0, 0.0, 1),
    Ring(15.0, 0.0, 6),
    Ring(30.0, 0.0, 12),
    Ring(45.0, 0.0, 18),
    Ring(60.0, 0.0, 20),
    Ring(75.0, 0.0, 24),
];

const UBO151: [Ring; 10] = [
    Ring(0.0, 0.0, 1),
    Ring(11.0, 15.0, 6),
    Ring(23.5, 0.0, 12),
    Ring(30.0, 15.0, 12),
    Ring(37.5, 0.0, 12),
    Ring(45.0, 0.0, 18),
    Ring(52.5, 7.5, 18),
    Ring(60.0, 0.0, 24),
    Ring(67.5, 7.5, 24),
    Ring(75.0, 0.0, 24),
];

impl Sampling {
    /// The directions, ring by ring from the normal outwards, azimuths ascending; radians.
    pub fn directions(self) -> Vec<Direction> {
        let rings: &[Ring] = match self {
            Sampling::Sparse31 => &SPARSE31,
            Sampling::Bonn81 => &BONN81,
            Sampling::Ubo151 => &UBO151,
        };
        let ring = |&Ring(theta, first, count): &Ring| {
            (0..count).map(move |k| Direction {
                theta: theta.to_radians(),
                phi: (first + 360.0 * f64::from(k) / f64::from(count)).to_radians(),
            })
        };
        rings.iter().flat_map(ring).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_range() {
        for (sampling, count) in [
            (Sampling::Sparse31, 31),
            (Sampling::Bonn81, 81),
            (Sampling::Ubo151, 151),
        ] {
            let directions = sampling.directions();
            assert_eq!(directions.len(), count);
            assert_eq!(directions[0].theta, 0.0);
            assert!((directions[count - 1].theta.to_degrees() - 75.0).abs() < 1e-12);
            assert!(
                directions
                    .iter()
                    .all(|d| (0.0..std::f64::consts::TAU).contains(&d.phi))
            );
        }
    }

    #[test]
    fn no_direction_twice() {
        for sampling in [Sampling::Bonn81, Sampling::Ubo151] {
            let vectors: Vec<_> = sampling.directions().iter().map(|d| d.to_vector()).collect();
            for (i, a) in vectors.iter().enumerate() {
                for b in &vectors[..i] {
                    let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                    assert!(dot < 0.9999, "{a:?} {b:?}");
                }
            }
        }
    }
}
