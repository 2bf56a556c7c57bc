//! Large materials: two patches, repeated and blended, as a product of factors.
//!
//! A BTF of 2048² texels and 81 × 81 directions takes 165 GB. Where it is a patch in two styles A and B that are blended
//! texel by texel, ρ(x) = (1 − w(x))·ρ_A(x mod patch) + w(x)·ρ_B(x mod patch), its matrix is known as a product as soon as
//! those of the patches are: with ρ_A = U·V_A and ρ_B = U·V_B over common eigen-ABRDFs U, its eigen-textures are
//! (1 − w)·V_A + w·V_B. Nothing of the size of the samples is formed. The blend of the factorized patches is
//! the BTF that the archive's ledger refers to.

use std::ops::Range;
use std::path::Path;

use ::preprocess::factorize::factorize;
use ::preprocess::npy::Samples;
use ::preprocess::source::{Images, LowRank};
use ::preprocess::{Btf, Factors, Settings};
use anyhow::Result;
use scenes::paper::{PATCHES, wear};

/// The factors of a material from those of its two patches.
pub(super) fn factorized(
    [fresh, worn]: [(Btf, Factors); 2],
    path: &Path,
    settings: &Settings,
) -> Result<(Btf, Factors)> {
    let (width, height) = (fresh.0.width(), fresh.0.height());
    let sampling = fresh.0.sampling().clone();

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
    let pair = Btf::new(
        path,
        sampling.clone(),
        (width, 2 * height),
        Box::new(Product(both)),
    )?;
    let pair = factorize(&pair, settings, &|_| ())?;

    let side = PATCHES * width;
    let blended = LowRank {
        terms: pair.components,
        u: pair.u,
        v: blend(&pair.v, width as usize, pair.components),
    };
    let btf = Btf::new(path, sampling, (side, side), Box::new(Product(blended)))?;
    let factors = factorize(&btf, settings, &|_| ())?;
    Ok((btf, factors))
}

/// Eigen-textures `[term][y][x]` of the large material; `pair` has those of the patches below each other.
fn blend(pair: &[f32], patch: usize, terms: usize) -> Vec<f32> {
    let (side, texels) = (PATCHES as usize * patch, patch * patch);
    let place = |at: usize| (at as f64 + 0.5) / side as f64;
    let weights: Vec<f32> = (0..side * side)
        .map(|at| wear(place(at % side), place(at / side)) as f32)
        .collect();
    let mut blended = Vec::with_capacity(terms * side * side);
    for textures in pair.chunks_exact(2 * texels) {
        let (fresh, worn) = textures.split_at(texels);
        for (y, weights) in weights.chunks_exact(side).enumerate() {
            let row = y % patch * patch;
            blended.extend(weights.iter().enumerate().map(|(x, weight)| {
                let at = row + x % patch;
                fresh[at] + weight * (worn[at] - fresh[at])
            }));
        }
    }
    blended
}

/// Images that are known as a product.
struct Product(LowRank);

impl std::fmt::Debug for Product {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Product of {} terms", self.0.terms)
    }
}

impl Images for Product {
    fn format(&self) -> String {
        "blended patches".into()
    }

    fn stored_bytes(&self) -> u64 {
        0
    }

    fn samples<'a>(
        &'a self,
        images: Range<usize>,
        buffer: &'a mut Vec<f32>,
    ) -> ::preprocess::Result<Samples<'a>> {
        let LowRank { terms, u, v } = &self.0;
        let (rows, texels) = (u.len() / terms, v.len() / terms);
        buffer.clear();
        for row in images.start * 3..images.end * 3 {
            let start = buffer.len();
            buffer.resize(start + texels, 0.0);
            for (u, v) in u.chunks_exact(rows).zip(v.chunks_exact(texels)) {
                for (sample, v) in buffer[start..].iter_mut().zip(v) {
                    *sample += u[row] * v;
                }
            }
        }
        Ok(Samples::F32(buffer))
    }

    fn place(&self, image: usize) -> String {
        format!("image {image} of the blended patches")
    }

    fn low_rank(&self) -> ::preprocess::Result<Option<LowRank>> {
        Ok(Some(self.0.clone()))
    }
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
        let product = Product(LowRank {
            terms: 2,
            u: vec![1.0, 2.0, 3.0, 0.5, 0.5, 0.5],
            v: vec![1.0, 0.0, 0.0, 2.0],
        });
        let mut buffer = Vec::new();
        let Samples::F32(samples) = product.samples(0..1, &mut buffer).unwrap() else {
            panic!("floats")
        };
        assert_eq!(samples, [1.0, 1.0, 2.0, 1.0, 3.0, 1.0]);
    }
}
