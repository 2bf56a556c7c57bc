//! The error of an archive as it was written, measured through the reader that everybody uses.

use std::fs::File;
use std::path::Path;

use tileset::{Archive, GROUP_COMPONENTS};

use crate::build::loss::{Chain, Product, Sizes};
use crate::export::decode_group;
use crate::factorize::left_out;
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
    archive.check().map_err(Error::archive(path))?;
    let manifest = &archive.index.manifest;
    let scale = manifest.texture_scale as f32;
    let (mut u, mut v) = (Vec::new(), Vec::new());
    for group in 0..manifest.groups() as u16 {
        let (column, finest) = decode_group(&archive, group).map_err(Error::archive(path))?;
        let first = usize::from(group) * GROUP_COMPONENTS;
        for channel in 0..GROUP_COMPONENTS.min(manifest.components as usize - first) {
            u.extend(column.texels.iter().map(|texel| texel[channel].to_f32()));
            v.extend(finest.texels.iter().map(|texel| texel[channel].to_f32() * scale));
        }
    }
    Ok((u, v))
}

/// ‖√w·(UV − ÛV̂)‖².
fn difference(factors: &Factors, u: &[f32], v: &[f32], weights: Option<&[f32]>) -> f64 {
    let (rows, columns) = (factors.rows, factors.columns);
    let sizes = Sizes {
        rows,
        columns,
        components: factors.components,
    };
    let products = [(&factors.u[..], &factors.v[..]), (u, v)].map(|(u, v)| Product {
        abrdf: Box::new(move |component, row, out| {
            out.copy_from_slice(&u[component * rows + row..][..out.len()]);
            if let Some(weights) = weights {
                for (out, weight) in out.iter_mut().zip(&weights[row..]) {
                    *out *= weight.sqrt();
                }
            }
        }),
        texture: Box::new(move |component, texel, out| {
            out.copy_from_slice(&v[component * columns + texel..][..out.len()]);
        }),
    });
    Chain::new(sizes, &products).mean_square(0, 1) * rows as f64 * columns as f64
}
