//! Weights of rows: what the squares of their errors count when the subspace is chosen.
//!
//! With D = diag(√w) the subspace is that of D·B; factors are unscaled after it, so that their product still is B.
//! Only the choice of textures changes, and errors are stated in both norms. The renderer knows nothing of it.

use super::voronoi::cell_areas;
use crate::npy::Sampling;

/// What the squares of the error are weighted by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Weights {
    /// Every sample counts the same.
    #[default]
    Uniform,
    /// A view and a light count as much as the part of the hemisphere that is nearest to them: measured directions
    /// are denser in some places than in others.
    SolidAngle,
    /// Images brighter than the median image count as if they were as bright as it (Huber's weights), so that a few
    /// highlights do not take the rank from everything else.
    Robust,
}

impl Weights {
    /// Weights of the rows, of mean 1, where they follow from the directions alone.
    pub(super) fn of_directions(self, sampling: &Sampling) -> Option<Vec<f32>> {
        if self != Weights::SolidAngle {
            return None;
        }
        let (views, lights) = (cell_areas(&sampling.views), cell_areas(&sampling.lights));
        let weights = views
            .iter()
            .flat_map(|view| lights.iter().flat_map(move |light| [view * light; 3]));
        Some(normalized(weights.collect()))
    }

    /// Weights of the rows, of mean 1, where they follow from the sums of squares of each row; `None` for
    /// weights that are all the same.
    pub(super) fn of_energies(self, energies: &[f64]) -> Option<Vec<f32>> {
        if self != Weights::Robust {
            return None;
        }
        // An image as a whole, so that colours keep their balance.
        let images: Vec<f64> = energies.chunks(3).map(|rgb| rgb.iter().sum()).collect();
        let mut sorted: Vec<f64> = images.iter().copied().filter(|energy| *energy > 0.0).collect();
        if sorted.is_empty() {
            return None;
        }
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
        let weights = images
            .iter()
            .flat_map(|&energy| [if energy > median { median / energy } else { 1.0 }; 3]);
        Some(normalized(weights.collect()))
    }
}

fn normalized(weights: Vec<f64>) -> Vec<f32> {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter().map(|weight| (weight / mean) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tileset::Direction;

    #[test]
    fn bright_images_are_held_at_the_median() {
        // Four images of energies 3, 3, 3 and 300.
        let energies: Vec<f64> = [1.0, 1.0, 1.0, 100.0].into_iter().flat_map(|e| [e; 3]).collect();
        let weights = Weights::Robust.of_energies(&energies).unwrap();
        let weighted: Vec<f64> = energies
            .iter()
            .zip(&weights)
            .map(|(e, &w)| e * f64::from(w))
            .collect();
        assert!((weighted[9] / weighted[0] - 1.0).abs() < 1e-6);
        assert!((weights.iter().sum::<f32>() / 12.0 - 1.0).abs() < 1e-6);
        assert_eq!(Weights::Robust.of_energies(&[0.0; 6]), None);
        assert_eq!(Weights::Uniform.of_energies(&energies), None);
    }

    #[test]
    fn rows_count_as_their_part_of_the_hemisphere() {
        let ring = |count: u32, theta: f64| {
            (0..count).map(move |i| Direction {
                theta,
                phi: std::f64::consts::TAU * f64::from(i) / f64::from(count),
            })
        };
        // The pole and a ring at 60 degrees: the pole's cell ends at 30, though the ring is four directions.
        let sampling = Sampling {
            views: ring(1, 0.0).chain(ring(4, 1.0471975511965976)).collect(),
            lights: ring(1, 0.3).collect(),
            wrap: false,
            cosine: false,
        };
        let weights = Weights::SolidAngle.of_directions(&sampling).unwrap();
        assert_eq!(weights.len(), 15);
        assert!(weights[..3].iter().all(|weight| *weight == weights[0]));
        assert!(
            weights[3..]
                .iter()
                .all(|weight| (weight / weights[3] - 1.0).abs() < 1e-5)
        );
        assert!(weights[0] < weights[3]);
    }
}
