//! The error of an archive as it was written, measured through the reader that everybody uses.

use std::fs::File;
use std::path::Path;

use tileset::{Archive, GROUP_COMPONENTS};

use crate::export::decode_finest;
use crate::factorize::{gram, left_out};
use crate::progress::ProgressFn;
use crate::{Btf, Error, Factors, Result};

/// What the archive is compared with.
pub(crate) enum Against<'a> {
    /// The factors: ‖B − ÛV̂‖² is ‖B − UV‖², which is known, and ‖UV − ÛV̂‖². The textures of V are orthogonal to
    /// B − UV, so that between the two stands only 2⟨Uᵀ(B − UV), V̂ − V⟩, which the reader cannot know: Uᵀ(B − UV) is
    /// what the subspace missed of singular vectors, and V̂ − V the codec's noise, which is hardly correlated with it.
    Factors,
    /// The BTF itself, in one pass.
    Btf(&'a Btf),
}

/// Sums of squares over all samples.
pub(crate) struct Measured {
    /// ‖B − ÛV̂‖².
    pub(crate) energy: f64,
    /// The same with weights, if the factors have some.
    pub(crate) weighted_energy: Option<f64>,
    pub(crate) against: &'static str,
}

/// Decodes the archive `path` of `factors` and measures what all of it lost.
///
/// # Errors
/// [`Error::Archive`] and [`Error::Io`] if the archive cannot be read; those of the BTF's format.
pub(crate) fn archive(
    path: &Path,
    factors: &Factors,
    against: Against<'_>,
    progress: ProgressFn<'_>,
) -> Result<Measured> {
    let (u, v) = decode(path)?;
    if let Against::Btf(btf) = against {
        let energies = left_out(btf, &u, &v, progress)?;
        let weigh = |weights: &[f32]| {
            energies
                .iter()
                .zip(weights)
                .map(|(energy, &weight)| energy * f64::from(weight))
                .sum()
        };
        return Ok(Measured {
            energy: energies.iter().sum(),
            weighted_energy: factors.weighted.as_ref().map(|weighted| weigh(&weighted.weights)),
            against: "btf",
        });
    }
    Ok(Measured {
        energy: factors.residual_energy + difference(factors, &u, &v, None),
        weighted_energy: factors
            .weighted
            .as_ref()
            .map(|weighted| weighted.residual_energy + difference(factors, &u, &v, Some(&weighted.weights))),
        against: "factors",
    })
}

/// Û `[component][row]` and V̂ `[component][texel]` as every reader of the archive sees them.
fn decode(path: &Path) -> Result<(Vec<f32>, Vec<f32>)> {
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    let archive = Archive::open(file).map_err(Error::archive(path))?;
    let manifest = &archive.index.manifest;
    let scale = manifest.texture_scale as f32;
    let (mut u, mut v) = (Vec::new(), Vec::new());
    for group in 0..manifest.groups() as u16 {
        let column = archive.read_column(group).map_err(Error::archive(path))?;
        let column = archive
            .index
            .decoder
            .column(group, &column)
            .map_err(Error::archive(path))?;
        let finest = decode_finest(&archive, group).map_err(Error::archive(path))?;
        let first = usize::from(group) * GROUP_COMPONENTS;
        for channel in 0..GROUP_COMPONENTS.min(manifest.components as usize - first) {
            u.extend(column.texels.iter().map(|texel| texel[channel].to_f32()));
            v.extend(finest.texels.iter().map(|texel| texel[channel].to_f32() * scale));
        }
    }
    Ok((u, v))
}

/// ‖√w·(UV − ÛV̂)‖² from Gram matrices of [U − Û, Û] and [V, V − V̂]: exact, and nothing cancels.
fn difference(factors: &Factors, u: &[f32], v: &[f32], weights: Option<&[f32]>) -> f64 {
    let (rows, columns, components) = (factors.rows, factors.columns, factors.components);
    let left = gram(rows, 2 * components, |range, mut out| {
        for component in 0..components {
            for (i, row) in range.clone().enumerate() {
                let scale = weights.map_or(1.0, |weights| f64::from(weights[row]).sqrt());
                let [wanted, stored] =
                    [&factors.u[..], u].map(|u| f64::from(u[component * rows + row]) * scale);
                out[(i, component)] = wanted - stored;
                out[(i, components + component)] = stored;
            }
        }
    });
    let right = gram(columns, 2 * components, |range, mut out| {
        for component in 0..components {
            for (i, texel) in range.clone().enumerate() {
                let [wanted, stored] = [&factors.v[..], v].map(|v| f64::from(v[component * columns + texel]));
                out[(i, component)] = wanted;
                out[(i, components + component)] = wanted - stored;
            }
        }
    });
    let entries = (0..2 * components).flat_map(|j| (0..2 * components).map(move |i| (i, j)));
    entries
        .map(|entry| left[entry] * right[entry])
        .sum::<f64>()
        .max(0.0)
}
