//! Where errors of a material are seen, and how much.

use crate::gpu::materials::Btf;

/// Luminance of reflectance below which darker is not seen as different: a hundredth of white.
const DARK: f64 = 0.01;

/// How much a square of contrast hides beside one of the mean. Of 0, 1, 3, 10 and 30 the one with which pictures came with the
/// fewest bytes (`eigentile bench stream`, one scene; from 1 to 30 they differ by a twentieth).
const MASKING: f64 = 3.0;

/// What a squared error of reflectance counts for where pixels want each tile: 1 / (mean² + masking · contrast²).
///
/// Errors are seen relative to the mean luminance (Weber's law), and the less the more the material's own contrast covers
/// them (Legge and Foley: Contrast Masking in Human Vision, 1980). Structural similarity says the same: without a detail of variance
/// e² beside a variance of σ² that is there, it falls by e² / (2 σ² + C2) (Wang et al. 2004). So neither do dark materials wait for the last
/// highlight of bright ones, nor smooth ones for the last thread of a coarse weave. The contrast at a tile is what its page and those above
/// it say, without the root, which holds the mean: the sum of their weights.
pub(super) fn visibility(btf: &Btf) -> Vec<f32> {
    let [r, g, b] = btf.index.manifest.mean_rgb;
    // Rec. 709.
    let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let pyramid = btf.pyramid();
    let parents: Vec<Option<usize>> = pyramid
        .tiles()
        .map(|tile| Some(pyramid.tile_index(pyramid.parent(tile)?)? as usize))
        .collect();
    let weights: Vec<f64> = btf.weights().map(f64::from).collect();
    visibilities(luminance, &parents, &weights)
}

/// `parents` by tile, parents first; `weights` group by group, in each by tile.
fn visibilities(luminance: f64, parents: &[Option<usize>], weights: &[f64]) -> Vec<f32> {
    let seen = luminance.max(0.0) + DARK;
    let mut contrasts: Vec<f64> = vec![0.0; parents.len()];
    for (tile, parent) in parents.iter().enumerate() {
        if let Some(parent) = *parent {
            let own: f64 = weights.iter().skip(tile).step_by(parents.len()).sum();
            contrasts[tile] = contrasts[parent] + own;
        }
    }
    let visibility = |contrast: f64| (1.0 / (seen * seen + MASKING * contrast)) as f32;
    contrasts.into_iter().map(visibility).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root with two tiles below it, one of which has one below itself; two groups.
    const PARENTS: [Option<usize>; 4] = [None, Some(0), Some(0), Some(1)];

    #[test]
    fn errors_are_relative_to_the_mean() {
        let at = |luminance| visibilities(luminance, &PARENTS, &[0.0; 8]);
        assert_eq!(at(0.19), [25.0f32; 4]);
        assert!(at(0.0)[0] <= 10_000.5 && at(-1.0) == at(0.0));
    }

    #[test]
    fn contrast_above_and_at_a_tile_hides_errors() {
        let weights = [9.0, 0.001, 0.0, 0.002, 9.0, 0.003, 0.0, 0.002];
        let found = visibilities(0.19, &PARENTS, &weights);
        let expected = [25.0, 1.0 / 0.052, 25.0, 1.0 / 0.064];
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (f64::from(*found) - expected).abs() < 1e-5,
                "{found} where {expected} is right"
            );
        }
    }
}
