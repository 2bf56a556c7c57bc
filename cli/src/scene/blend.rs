//! Large materials: two patches, repeated and blended, as a product of factors.
//!
//! A BTF of 2048² texels and 81 × 81 directions takes 165 GB. Where it is a patch in two styles A and B that are blended
//! texel by texel, ρ(x) = (1 − w(x))·ρ_A(x mod patch) + w(x)·ρ_B(x mod patch), its matrix is known as a product as soon as
//! those of the patches are: with ρ_A = U·V_A and ρ_B = U·V_B over common eigen-ABRDFs U, its eigen-textures are
//! (1 − w)·V_A + w·V_B. Nothing of the size of the samples is formed. The blend of the factorized patches is
//! the BTF that the archive's ledger refers to.

use std::path::Path;

use ::preprocess::factorize::factorize_product;
use ::preprocess::source::LowRank;
use ::preprocess::{Btf, Factors, Settings};
use anyhow::Result;
use rayon::prelude::*;
use scenes::paper::{PATCHES, wear};

use super::traced::Held;

/// The factors of a material from those of its two patches. Of the size of the material are only its eigen-textures, once.
pub(super) fn factorized(
    [fresh, worn]: [(Btf, Factors); 2],
    path: &Path,
    settings: &Settings,
) -> Result<(Btf, Factors)> {
    let (width, height) = (fresh.0.width(), fresh.0.height());
    let sampling = fresh.0.sampling().clone();
    let of_size = |size| Btf::new(path, sampling.clone(), size, Box::new(Held::default()));

    // Both patches beside each other, over common eigen-ABRDFs.
    let texels = fresh.0.columns();
    let mut both = LowRank::default();
    for (which, (_, factors)) in [fresh, worn].into_iter().enumerate() {
        both.terms += factors.components;
        both.u.extend(&factors.u);
        for texture in factors.v.chunks_exact(texels) {
            let start = both.v.len() + which * texels;
            both.v.resize(both.v.len() + 2 * texels, 0.0);
            both.v[start..start + texels].copy_from_slice(texture);
        }
    }
    let pair = factorize_product(&of_size((width, 2 * height))?, both, settings)?;

    let side = PATCHES * width;
    let blended = LowRank {
        terms: pair.components,
        u: pair.u,
        v: blend(&pair.v, width as usize, pair.components),
    };
    drop(pair.v);
    let btf = of_size((side, side))?;
    let factors = factorize_product(&btf, blended, settings)?;
    Ok((btf, factors))
}

/// Eigen-textures `[term][y][x]` of the large material; `pair` has those of the patches below each other.
fn blend(pair: &[f32], patch: usize, terms: usize) -> Vec<f32> {
    let (side, texels) = (PATCHES as usize * patch, patch * patch);
    let place = |at: usize| (at as f64 + 0.5) / side as f64;
    let weights: Vec<f32> = (0..side * side)
        .into_par_iter()
        .map(|at| wear(place(at % side), place(at / side)) as f32)
        .collect();
    let mut blended = vec![0.0; terms * side * side];
    let textures = blended.par_chunks_exact_mut(side * side);
    textures
        .zip(pair.par_chunks_exact(2 * texels))
        .for_each(|(blended, textures)| {
            let (fresh, worn) = textures.split_at(texels);
            let rows = blended
                .chunks_exact_mut(side)
                .zip(weights.chunks_exact(side))
                .enumerate();
            for (y, (blended, weights)) in rows {
                let row = y % patch * patch;
                for (x, (blended, weight)) in blended.iter_mut().zip(weights).enumerate() {
                    let at = row + x % patch;
                    *blended = fresh[at] + weight * (worn[at] - fresh[at]);
                }
            }
        });
    blended
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_are_repeated_and_blended() {
        let patch = 2;
        // One term: 1 to 4 where fresh, 10 to 40 where worn.
        let pair = [1.0, 2.0, 3.0, 4.0, 10.0, 20.0, 30.0, 40.0];
        let blended = blend(&pair, patch, 1);
        assert_eq!(blended.len(), 64);
        for (at, value) in blended.iter().enumerate() {
            let (x, y) = (at % 8, at / 8);
            let base = (1 + x % 2 + 2 * (y % 2)) as f32;
            let weight = wear((x as f64 + 0.5) / 8.0, (y as f64 + 0.5) / 8.0) as f32;
            assert!(
                (value - base * (1.0 + 9.0 * weight)).abs() < 1e-4,
                "{x} {y}: {value}"
            );
        }
    }
}
