//! From factors to an archive: pyramids, pages, columns, and the ledger of what each step lost.
//!
//! Source: Schwartz, Ruiters, Klein, 2013, section 6: groups of components, mips of eigen-textures, tiles, and
//! pages coded against their up-sampled parents.

mod decoded;
mod group;
pub(crate) mod loss;

pub(crate) use decoded::DecodedMip;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::Serialize;
use tileset::codec::columns::encode_columns;
use tileset::codec::pyramid_dct::Statistics;
use tileset::codec::{Decoder, column_steps, tables_bytes};
use tileset::{ArchiveWriter, Codec, Factorization, GROUP_COMPONENTS, Ledger, Manifest, Pyramid};

use crate::output::AtomicFile;
use crate::progress::{Phase, Progress, ProgressFn};
use crate::{Btf, Error, Factors, Result};
use group::{GroupRecords, Material};
use loss::{Chain, Product, Sizes};

/// Quantizer step in root mean squares of the BTF where the user gives none.
pub const DEFAULT_QUALITY: f64 = 0.02;
/// Accepted quantizer steps in root mean squares of the BTF.
const QUALITY_RANGE: std::ops::RangeInclusive<f64> = 1e-6..=10.0;
/// Eigen-textures of this size or smaller need no scaling: half of the largest half float leaves room for what
/// quantization adds.
const LARGEST_UNSCALED: f64 = 32_768.0;
/// Eigen-textures that are nowhere larger than this are scaled up: halves below 6e-5 lose precision.
const SMALLEST_UNSCALED: f64 = 1.0 / 256.0;
/// Bound of the exponent of the scale: what manifests accept.
const MAX_SCALE_EXPONENT: f64 = 32.0;

/// What the bytes of an archive are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ArchiveBytes {
    /// The whole file.
    pub archive_bytes: u64,
    /// All pages.
    pub page_bytes: u64,
    /// All eigen-ABRDF columns.
    pub column_bytes: u64,
    /// Header, manifest, tables of the codec and directory.
    pub manifest_bytes: u64,
    /// Pages of all groups and mips.
    pub pages: u64,
    /// Pages that say nothing that their parents do not, and take no bytes.
    pub empty_pages: u64,
}

/// An archive that was written.
#[derive(Clone, Debug)]
pub struct Built {
    /// Its manifest, with the ledger of errors.
    pub manifest: Manifest,
    /// Its bytes.
    pub bytes: ArchiveBytes,
    /// Seconds of coding, of measuring what was lost, and of writing.
    pub seconds: [f64; 3],
}

/// Codes `factors` of `btf` and writes the archive `path`; `quality` is the quantizer step in root mean squares
/// of the BTF.
///
/// # Errors
/// [`Error::Invalid`] for a quality out of range, [`Error::Archive`] for what an archive cannot hold,
/// [`Error::Io`]. The file is complete or not there.
pub fn build(
    btf: &Btf,
    factors: &Factors,
    quality: f64,
    path: &Path,
    progress: ProgressFn<'_>,
) -> Result<Built> {
    encode(btf, factors, quality, progress)?.write(path)
}

/// An archive in memory: coded and measured, not yet written.
pub struct Encoded {
    manifest: Manifest,
    tables: Vec<u8>,
    groups: Vec<GroupRecords>,
    seconds: [f64; 2],
}

/// Codes `factors` of `btf`, and measures what was lost; `quality` is the quantizer step in root mean squares of the
/// BTF.
///
/// # Errors
/// As [`build`]; an [`Error::Archive`] names the BTF.
pub fn encode(btf: &Btf, factors: &Factors, quality: f64, progress: ProgressFn<'_>) -> Result<Encoded> {
    check_quality(quality)?;
    let path = btf.path();
    let mut manifest = manifest(btf, factors, quality);
    manifest.validate().map_err(Error::archive(path))?;
    let began = std::time::Instant::now();
    let (tables, groups) = encode_groups(factors, &manifest, progress).map_err(Error::archive(path))?;
    let encoded = began.elapsed().as_secs_f64();
    manifest.errors = ledger(factors, manifest.texture_scale, &groups);
    let measured = began.elapsed().as_secs_f64();
    Ok(Encoded {
        manifest,
        tables,
        groups,
        seconds: [encoded, measured - encoded],
    })
}

impl Encoded {
    /// What each stage lost.
    pub fn ledger(&self) -> Ledger {
        self.manifest.errors
    }

    /// Bytes of all records: the archive but for header, manifest and directory.
    pub fn record_bytes(&self) -> u64 {
        let group = |group: &GroupRecords| {
            group.column.len() + group.pages.iter().map(|(_, bytes, _)| bytes.len()).sum::<usize>()
        };
        self.groups.iter().map(|records| group(records) as u64).sum()
    }

    /// Writes the archive under a temporary name and renames it.
    ///
    /// # Errors
    /// [`Error::Archive`], [`Error::Io`]. The file is complete or not there.
    pub fn write(self, path: &Path) -> Result<Built> {
        let began = std::time::Instant::now();
        let bytes = write(&self.manifest, self.tables, self.groups, path)?;
        let [encode, measure] = self.seconds;
        Ok(Built {
            manifest: self.manifest,
            bytes,
            seconds: [encode, measure, began.elapsed().as_secs_f64()],
        })
    }
}

/// Checks before the long work what can be checked of the archive to be.
///
/// # Errors
/// As [`build`]; an [`Error::Archive`] names the BTF.
pub(crate) fn check(btf: &Btf, components: u32, quality: f64) -> Result<()> {
    check_quality(quality)?;
    let no_factors = Factors {
        components: components as usize,
        ..Factors::default()
    };
    let mut manifest = manifest(btf, &no_factors, quality);
    manifest.singular_values = vec![0.0; components as usize];
    manifest.validate().map_err(Error::archive(btf.path()))
}

fn check_quality(quality: f64) -> Result<()> {
    if QUALITY_RANGE.contains(&quality) {
        return Ok(());
    }
    Err(Error::Invalid {
        what: "quality (the quantizer step in root mean squares of the BTF)",
        found: quality.to_string(),
        expected: "from 1e-6 to 10",
    })
}

/// The manifest, but for the ledger.
fn manifest(btf: &Btf, factors: &Factors, quality: f64) -> Manifest {
    let largest = factors
        .v
        .iter()
        .fold(0f32, |largest, value| largest.max(value.abs()))
        .into();
    let texture_scale = texture_scale(largest);
    let tail_mip =
        Pyramid::new(btf.width(), btf.height(), btf.wrap()).map_or(0, |pyramid| pyramid.tail_mip());
    let btf_rms = factors.btf_rms();
    let scale = (factors.rows as f64 * factors.columns as f64).sqrt();
    Manifest {
        name: btf.name().to_owned(),
        generator: concat!("eigentile ", env!("CARGO_PKG_VERSION")).to_owned(),
        width: btf.width(),
        height: btf.height(),
        wrap: btf.wrap(),
        cosine: btf.cosine(),
        views: btf.views().to_vec(),
        lights: btf.lights().to_vec(),
        components: factors.components as u32,
        factorization: Factorization::Fmf,
        codec: Codec::PyramidDct {
            step: quantizer_step(
                quality * btf_rms / texture_scale,
                largest / texture_scale,
                tail_mip,
            ),
        },
        texture_scale,
        mean_rgb: factors.mean_rgb,
        singular_values: factors
            .singular_values
            .iter()
            .map(|value| value / scale)
            .collect(),
        errors: Ledger {
            btf_rms,
            rank_rms: factors.rank_rms(),
            ..Ledger::default()
        },
    }
}

/// The power of two that brings eigen-textures whose largest value is `largest` into the range of half floats;
/// 1 wherever they are there already.
fn texture_scale(largest: f64) -> f64 {
    if largest == 0.0 || (SMALLEST_UNSCALED..=LARGEST_UNSCALED).contains(&largest) {
        return 1.0;
    }
    let target = if largest > LARGEST_UNSCALED {
        LARGEST_UNSCALED
    } else {
        1.0
    };
    (largest / target)
        .log2()
        .ceil()
        .clamp(-MAX_SCALE_EXPONENT, MAX_SCALE_EXPONENT)
        .exp2()
}

/// The step in units of the scaled textures, no finer than the codec can count: a coefficient of a 16×16 DCT is at most
/// 16 times the largest value, the step of the coarsest mip 2^`tail_mip` times finer, and 2²⁸ steps are accepted.
fn quantizer_step(wanted: f64, largest: f64, tail_mip: u8) -> f64 {
    let finest = largest * 16.0 * f64::from(tail_mip).exp2() / f64::from(1 << 28);
    wanted.max(finest).clamp(1e-6, 1e6)
}

/// Rounds of counting before the tables of the page codec are as good as settled: frequencies, models for plain
/// rounding, models for the levels that these models make best.
const COUNTING_ROUNDS: u32 = 3;
/// Samples of eigen-textures that a round counts at least; beyond them groups are left out.
const COUNTED_SAMPLES: usize = 1 << 25;
/// Of so many groups one is counted at least.
const LARGEST_STRIDE: usize = 4;

/// Codes all columns and pages; returns the tables that they share, as bytes.
fn encode_groups(
    factors: &Factors,
    manifest: &Manifest,
    progress: ProgressFn<'_>,
) -> tileset::Result<(Vec<u8>, Vec<GroupRecords>)> {
    let material = Material {
        factors,
        manifest,
        pyramid: manifest.pyramid()?,
    };
    let groups = manifest.groups() as u16;
    let stride = (factors.columns * factors.components / COUNTED_SAMPLES).clamp(1, LARGEST_STRIDE);
    let counted: Vec<u16> = (0..groups).step_by(stride).collect();
    let total = u64::from(COUNTING_ROUNDS) * counted.len() as u64 + u64::from(groups);
    let done = AtomicU64::new(0);
    let report = || {
        progress(Progress {
            phase: Phase::Encoding,
            done: done.fetch_add(1, Ordering::Relaxed) + 1,
            total,
        });
    };

    let columns = encode_columns(
        &manifest.views,
        &manifest.lights,
        &factors.u,
        &column_steps(manifest),
    )?;
    let mut pages = None;
    for _ in 0..COUNTING_ROUNDS {
        let sums = counted
            .par_iter()
            .map(|&group| {
                let statistics = material.count(group, pages.as_ref());
                report();
                statistics.map(Some)
            })
            .try_reduce(|| None, |a, b| Ok(merge(a, b)))?;
        pages = sums.map(|sums| sums.tables());
    }
    let pages = pages.expect("an archive has a group");
    let tables = tables_bytes(&pages, &columns.tables)?;
    let decoder = Decoder::new(manifest, &tables)?;
    let records = columns
        .records
        .into_par_iter()
        .enumerate()
        .map(|(group, column)| {
            let records = material.encode(group as u16, &pages, &decoder, column);
            report();
            records
        })
        .collect::<tileset::Result<_>>()?;
    Ok((tables, records))
}

fn merge(a: Option<Statistics>, b: Option<Statistics>) -> Option<Statistics> {
    match (a, b) {
        (Some(mut a), Some(b)) => {
            a.add(&b);
            Some(a)
        }
        (a, b) => a.or(b),
    }
}

/// What each step lost, measured on the factors: the squares add up to the loss of all of them.
fn ledger(factors: &Factors, texture_scale: f64, groups: &[GroupRecords]) -> Ledger {
    let scale = texture_scale as f32;
    let sizes = Sizes {
        rows: factors.rows,
        columns: factors.columns,
        components: factors.components,
    };
    let abrdf = |component: usize, row: usize, out: &mut [f32]| {
        out.copy_from_slice(&factors.u[component * factors.rows + row..][..out.len()]);
    };
    let texture = |component: usize, texel: usize, out: &mut [f32]| {
        out.copy_from_slice(&factors.v[component * factors.columns + texel..][..out.len()]);
    };
    let exact = Product {
        abrdf: Box::new(abrdf),
        texture: Box::new(texture),
    };
    let round = |out: &mut [f32]| {
        for value in out {
            *value = half::f16::from_f32(*value).to_f32();
        }
    };
    let halves = Product {
        abrdf: Box::new(move |component, row, out| {
            abrdf(component, row, out);
            round(out);
        }),
        texture: Box::new(move |component, texel, out| {
            texture(component, texel, out);
            out.iter_mut().for_each(|value| *value /= scale);
            round(out);
            out.iter_mut().for_each(|value| *value *= scale);
        }),
    };
    let place = |component: usize| {
        (
            &groups[component / GROUP_COMPONENTS],
            component % GROUP_COMPONENTS,
        )
    };
    let decoded = Product {
        abrdf: Box::new(move |component, row, out| {
            let (group, channel) = place(component);
            let texels = &group.abrdfs.texels[row..][..out.len()];
            for (out, texel) in out.iter_mut().zip(texels) {
                *out = texel[channel].to_f32();
            }
        }),
        texture: Box::new(move |component, texel, out| {
            let (group, channel) = place(component);
            let texels = &group.finest.texels[texel..][..out.len()];
            for (out, texel) in out.iter_mut().zip(texels) {
                *out = texel[channel].to_f32() * scale;
            }
        }),
    };
    let chain = Chain::new(sizes, &[exact, halves, decoded]);
    Ledger {
        btf_rms: factors.btf_rms(),
        rank_rms: factors.rank_rms(),
        half_rms: chain.mean_square(0, 1).sqrt(),
        codec_rms: chain.mean_square(1, 2).sqrt(),
        measured_rms: factors.rank_rms().hypot(chain.mean_square(0, 2).sqrt()),
    }
}

/// Writes the archive under a temporary name and renames it.
fn write(
    manifest: &Manifest,
    tables: Vec<u8>,
    groups: Vec<GroupRecords>,
    path: &Path,
) -> Result<ArchiveBytes> {
    let mut bytes = ArchiveBytes::default();
    let mut writer = ArchiveWriter::with_tables(manifest.clone(), tables).map_err(Error::archive(path))?;
    for (group, records) in groups.into_iter().enumerate() {
        bytes.column_bytes += records.column.len() as u64;
        writer
            .add_column(group as u16, records.column, records.column_weight)
            .map_err(Error::archive(path))?;
        for (page, record, weight) in records.pages {
            bytes.pages += 1;
            bytes.empty_pages += u64::from(record.is_empty());
            bytes.page_bytes += record.len() as u64;
            writer
                .add_page(page, record, weight)
                .map_err(Error::archive(path))?;
        }
    }
    let mut file = AtomicFile::create(path)?;
    bytes.archive_bytes = writer.write(file.writer()).map_err(Error::archive(path))?;
    bytes.manifest_bytes = bytes.archive_bytes - bytes.page_bytes - bytes.column_bytes;
    file.commit()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_powers_of_two_that_fit() {
        for (largest, expected) in [
            (0.0, 1.0),
            (1.0, 1.0),
            (32_768.0, 1.0),
            (32_769.0, 2.0),
            (1e6, 32.0),
        ] {
            assert_eq!(texture_scale(largest), expected, "{largest}");
        }
        for largest in [1e-30, 1e-6, 1e-3, 5e5, 1e12] {
            let scale = texture_scale(largest);
            assert_eq!(scale.log2().fract(), 0.0);
            assert!(largest / scale <= LARGEST_UNSCALED);
            assert!(largest < 1e-9 || largest / scale > 0.5, "{largest}");
        }
    }
}
