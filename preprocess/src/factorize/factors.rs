//! A BTF as a sum of products.

use super::Statistics;

/// A BTF as a sum of products: `ρ[row][texel] ≈ Σ_c u[c][row]·v[c][texel]`.
///
/// The textures are orthogonal. Without weights the eigen-ABRDFs are, too, and the terms are those of the singular
/// value decomposition; with weights only √w·u are orthogonal.
#[derive(Clone, Debug, Default)]
pub struct Factors {
    /// Rows of the matrix: views × lights × 3.
    pub rows: usize,
    /// Columns of the matrix: texels.
    pub columns: usize,
    /// Terms, at least one.
    pub components: usize,
    /// U', `[component][view][light][rgb]`; unit root mean square per component.
    pub u: Vec<f32>,
    /// V', `[component][y][x]`, in the unit of the BTF's samples.
    pub v: Vec<f32>,
    /// Norms of the terms, ‖u_c‖·‖v_c‖: without weights the singular values of B, falling.
    pub singular_values: Vec<f64>,
    /// ‖B‖², the sum of the squares of all samples.
    pub energy: f64,
    /// ‖B − U'ᵀV'‖², the sum of the squares of all that the factors leave out.
    pub residual_energy: f64,
    /// Whether `residual_energy` is an estimate, as after a single pass, and not exact.
    pub estimated: bool,
    /// The same in the norm of the weights, if there were any.
    pub weighted: Option<Weighted>,
    /// Mean of all red, green and blue samples.
    pub mean_rgb: [f64; 3],
    /// Where time and bytes went.
    pub statistics: Statistics,
}

/// Errors with the squares of each row weighted; the mean weight is 1.
#[derive(Clone, Debug, Default)]
pub struct Weighted {
    /// Weight of each row.
    pub weights: Vec<f32>,
    /// Singular values of √w·B, falling.
    pub singular_values: Vec<f64>,
    /// ‖√w·B‖².
    pub energy: f64,
    /// ‖√w·(B − U'ᵀV')‖².
    pub residual_energy: f64,
}

impl Factors {
    /// Root mean square of the BTF's samples.
    pub fn btf_rms(&self) -> f64 {
        self.rms(self.energy)
    }

    /// Root mean square of what the factors leave out.
    pub fn rank_rms(&self) -> f64 {
        self.rms(self.residual_energy)
    }

    /// ‖B − U'ᵀV'‖ / ‖B‖; 0 for a BTF that is all zero.
    pub fn relative_error(&self) -> f64 {
        if self.energy > 0.0 {
            (self.residual_energy / self.energy).sqrt()
        } else {
            0.0
        }
    }

    /// The sum of the squares that the first `components` terms leave out.
    pub fn residual_energy_of(&self, components: usize) -> f64 {
        let kept = components.min(self.components);
        self.residual_energy + square_sum(&self.singular_values[kept..])
    }

    /// The first terms only. They are the best of their number, for terms are orthogonal and sorted. The whole of it if
    /// it has no more than `components` terms.
    pub fn truncated(&self, components: usize) -> Factors {
        let kept = components.clamp(1, self.components.max(1)).min(self.components);
        Factors {
            components: kept,
            u: self.u[..kept * self.rows].to_vec(),
            v: self.v[..kept * self.columns].to_vec(),
            singular_values: self.singular_values[..kept].to_vec(),
            residual_energy: self.residual_energy_of(kept),
            weighted: self.weighted.as_ref().map(|weighted| Weighted {
                weights: weighted.weights.clone(),
                singular_values: weighted.singular_values[..kept].to_vec(),
                residual_energy: weighted.residual_energy + square_sum(&weighted.singular_values[kept..]),
                ..*weighted
            }),
            ..*self
        }
    }

    /// The same of samples `scale` times as large.
    pub(super) fn multiply(&mut self, scale: f64) {
        if scale == 1.0 {
            return;
        }
        let multiply = |values: &mut [f64], scale| values.iter_mut().for_each(|value| *value *= scale);
        self.v
            .iter_mut()
            .for_each(|value| *value = (f64::from(*value) * scale) as f32);
        multiply(&mut self.singular_values, scale);
        multiply(&mut self.mean_rgb, scale);
        self.energy *= scale * scale;
        self.residual_energy *= scale * scale;
        if let Some(weighted) = &mut self.weighted {
            multiply(&mut weighted.singular_values, scale);
            weighted.energy *= scale * scale;
            weighted.residual_energy *= scale * scale;
        }
    }

    /// The root mean square of a sum of squares over all samples.
    pub fn rms(&self, energy: f64) -> f64 {
        let samples = self.rows as f64 * self.columns as f64;
        if samples > 0.0 {
            (energy / samples).sqrt()
        } else {
            0.0
        }
    }
}

pub(super) fn square_sum(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}
