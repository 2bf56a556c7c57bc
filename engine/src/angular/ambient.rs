//! The light of uniform surroundings, pre-integrated (Schwartz, Ruiters, Klein 2013, section 7).

use tileset::Direction;

use super::{Triangulation, cosine_from_parabolic};

/// Steps of cosθ and of φ of the quadrature over the hemisphere. For the 81 and 151 directions of the Bonn
/// databases the weights differ from those of 1024 × 2048 steps by 0.12 to 0.16 % of their sum, added up over
/// all, and much less in the integral of anything smooth; that takes 3 ms, finer steps as much longer.
const STEPS: (u32, u32) = (128, 256);

impl Triangulation {
    /// Weight of each sample in the integral of the interpolant times the cosine over the hemisphere, divided
    /// by π; `cosine` says that the samples include it. A white diffuse BTF integrates to one.
    ///
    /// `directions` are those that were triangulated. What quadrature and interpolation lose is divided out,
    /// so the weights add up to one where the cosine is left out, and weighted by the samples' own cosines
    /// where it is included (unless all samples lie at the horizon, where these are nothing but zero).
    pub fn ambient_weights(&self, directions: &[Direction], cosine: bool) -> Vec<f64> {
        let mut weights = vec![0.0; self.points.len()];
        let (z_steps, phi_steps) = STEPS;
        for z_step in 0..z_steps {
            let z = (f64::from(z_step) + 0.5) / f64::from(z_steps);
            let radius = ((1.0 - z * z).sqrt() / (1.0 + z)).min(1.0);
            for phi_step in 0..phi_steps {
                let phi = (f64::from(phi_step) + 0.5) / f64::from(phi_steps) * std::f64::consts::TAU;
                let (sin, cos) = phi.sin_cos();
                let taps = self.taps_at([radius * cos, radius * sin]);
                let share = if cosine { taps.horizon_scale(z) } else { z };
                for (&sample, &weight) in taps.indices.iter().zip(&taps.weights) {
                    weights[sample as usize] += share * weight;
                }
            }
        }
        let of_white = |sample: usize| match directions.get(sample) {
            _ if !cosine => 1.0,
            Some(direction) => direction.theta.cos().max(0.0),
            None => cosine_from_parabolic(self.points[sample]),
        };
        let sum: f64 = weights
            .iter()
            .enumerate()
            .map(|(sample, weight)| weight * of_white(sample))
            .sum();
        // Without a white answer to scale by: dω / π of one step.
        let scale = if sum > 1e-9 {
            1.0 / sum
        } else {
            2.0 / f64::from(z_steps * phi_steps)
        };
        weights.iter_mut().for_each(|weight| *weight *= scale);
        weights
    }
}
