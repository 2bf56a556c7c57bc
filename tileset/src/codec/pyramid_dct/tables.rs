//! What all pages of an archive share: statistics of frequencies, models of levels, points of reconstruction.

mod statistics;

use bytemuck::Zeroable;

use super::context::{Context, FACTOR_QUARTERS, MEAN_CLASSES, MODELS, Means, factor, mean_of_class};
use super::levels::{END_MODELS, ESCAPE, SOURCE_MODELS, SYMBOLS, end_model, source_model, symbol_of};
use super::transform::AREA;
use crate::codec::rans::{Buckets, Model, read_models, write_models};
use crate::{Pyramid, Result, error::corrupt, frame};
pub(super) use statistics::Counter;
pub use statistics::Statistics;

/// Groups that share statistics of frequencies: 20 components.
const BUNDLE_GROUPS: usize = 5;
/// Reconstruction points are multiples of 1/128 of a step.
const OFFSET_UNIT: f32 = 1.0 / 128.0;
/// Most bytes of tables before compression: all mips of the largest archive with the most components.
const MAX_RAW_BYTES: usize =
    17 * (52 * AREA + 1024) + (MODELS + END_MODELS + SOURCE_MODELS) * 130 + 2 * MODELS + 16;

/// What all pages of an archive share.
#[derive(Clone)]
pub struct PageTables {
    extent: Extent,
    /// Class of the mean magnitude, `[mip][bundle][v][u]`.
    classes: Vec<u8>,
    /// The same as [`mean_of_class`] gives it.
    means: Vec<[i32; AREA]>,
    /// How many times more a component has, in quarters of an octave, `[mip][group][component of the group]`.
    quarters: Vec<[i8; 4]>,
    /// Models of levels by context.
    pub(super) models: Vec<Model>,
    /// Models of the number of diagonals.
    pub(super) ends: Vec<Model>,
    /// Models of sources.
    pub(super) sources: Vec<Model>,
    /// By context: how far from a level of one, and of more, the mean of what is quantized to it lies.
    offsets: Vec<[i8; 2]>,
    /// Bits of each symbol, by context.
    bits: Vec<[f32; SYMBOLS]>,
    /// Those of the models of levels, in one place for those who decode. Sizes are powers of two, so that no index needs
    /// a check; there are fewer models.
    pub(super) buckets: Box<[Buckets; 64]>,
    /// Coefficient in steps, by context and symbol.
    pub(super) values: Box<[[f32; 64]; 64]>,
}

impl std::fmt::Debug for PageTables {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PageTables({:?})", self.extent)
    }
}

impl PartialEq for PageTables {
    fn eq(&self, other: &Self) -> bool {
        self.raw_bytes() == other.raw_bytes()
    }
}

/// Mips and groups of an archive.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Extent {
    mips: usize,
    groups: usize,
}

impl Extent {
    fn new(pyramid: &Pyramid, groups: u32) -> Self {
        Self {
            mips: usize::from(pyramid.tail_mip()) + 1,
            groups: groups as usize,
        }
    }

    fn bundles(self) -> usize {
        self.groups.div_ceil(BUNDLE_GROUPS)
    }

    /// Number of a mip and a group among those of all.
    fn group(self, mip: u8, group: u16) -> usize {
        usize::from(mip).min(self.mips - 1) * self.groups + usize::from(group).min(self.groups - 1)
    }

    /// Number of a mip and the bundle of a group among those of all.
    fn bundle(self, mip: u8, group: u16) -> usize {
        let bundle = (usize::from(group) / BUNDLE_GROUPS).min(self.bundles() - 1);
        usize::from(mip).min(self.mips - 1) * self.bundles() + bundle
    }
}

impl PageTables {
    fn new(
        extent: Extent,
        classes: Vec<u8>,
        quarters: Vec<[i8; 4]>,
        models: Vec<Model>,
        ends: Vec<Model>,
        sources: Vec<Model>,
        offsets: Vec<[i8; 2]>,
    ) -> Self {
        let means = classes
            .as_chunks::<AREA>()
            .0
            .iter()
            .map(|classes| classes.map(mean_of_class))
            .collect();
        let mut values = Box::new([[0.0; 64]; 64]);
        for (values, &offsets) in values.iter_mut().zip(&offsets) {
            *values = std::array::from_fn(|symbol| {
                let magnitude = symbol.div_ceil(2) as i32;
                value(offsets, if symbol % 2 == 0 { -magnitude } else { magnitude })
            });
        }
        let mut buckets = Box::new([Buckets::zeroed(); 64]);
        for (buckets, model) in buckets.iter_mut().zip(&models) {
            *buckets = model.buckets;
        }
        let bits = models
            .iter()
            .map(|model| std::array::from_fn(|symbol| model.bits(symbol)));
        Self {
            extent,
            quarters,
            bits: bits.collect(),
            classes,
            means,
            models,
            ends,
            sources,
            offsets,
            buckets,
            values,
        }
    }

    /// Expected magnitudes of the coefficients of a group at a mip.
    pub(super) fn means(&self, mip: u8, group: u16) -> Means<'_> {
        Means {
            places: &self.means[self.extent.bundle(mip, group)],
            factors: self.quarters[self.extent.group(mip, group)].map(factor),
        }
    }

    /// The coefficient in steps that a level stands for.
    #[inline]
    pub(super) fn value(&self, Context { model, shift }: Context, level: i32) -> f32 {
        if shift > 0 {
            // The lowest bits are as they were: no model says where in its interval a value lies.
            return level as f32;
        }
        let offsets = self.offsets.get(usize::from(model));
        value(offsets.copied().unwrap_or_default(), level)
    }

    /// Bits that a level takes, about.
    pub(super) fn bits(&self, Context { model, shift }: Context, level: i32) -> f32 {
        let bits = &self.bits[usize::from(model)];
        let rest = if shift > 0 { f32::from(shift) } else { 0.0 };
        rest + match symbol_of(level, shift) {
            Some(symbol) if bits[symbol].is_finite() => bits[symbol],
            _ => bits[ESCAPE] + 6.0 + 2.0 * (level.unsigned_abs() as f32 + 1.0).log2(),
        }
    }

    /// Bits of a block's number of diagonals, given that of the block before; 0 without models.
    pub(super) fn end_bits(&self, last_end: usize, end: usize) -> f32 {
        self.ends
            .get(end_model(last_end))
            .map_or(0.0, |model| model.bits(end))
    }

    /// Bits of a block's source, given that of the last block that has levels; 0 without models.
    pub(super) fn source_bits(&self, last: usize, source: usize) -> f32 {
        self.sources
            .get(source_model(last))
            .map_or(0.0, |model| model.bits(source))
    }

    /// Whether sources are worth looking for: some were found, or nothing is known of them.
    pub(super) fn may_have_sources(&self) -> bool {
        self.sources.is_empty() || self.has_sources()
    }

    /// Whether blocks may have sources.
    pub(super) fn has_sources(&self) -> bool {
        self.sources.iter().any(|model| model.symbols() > 1)
    }

    /// Whether there are models, and not only statistics of frequencies.
    pub(super) fn is_trained(&self) -> bool {
        !self.models.is_empty()
    }

    /// The tables as a section of an archive.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if there is no memory for the compressor.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        frame::compress(&self.raw_bytes())
    }

    fn raw_bytes(&self) -> Vec<u8> {
        let mut bytes = self.classes.clone();
        bytes.extend(
            self.quarters
                .as_flattened()
                .iter()
                .map(|&quarters| quarters as u8),
        );
        bytes.extend(self.offsets.iter().flatten().map(|&offset| offset as u8));
        write_models(&self.models, &mut bytes);
        write_models(&self.ends, &mut bytes);
        write_models(&self.sources, &mut bytes);
        bytes
    }

    /// Reads [`PageTables::to_bytes`]; allocation is bounded by what the sizes of the archive can need.
    ///
    /// # Errors
    /// [`crate::Error::Corrupt`].
    pub fn from_bytes(bytes: &[u8], pyramid: &Pyramid, groups: u32) -> Result<Self> {
        Self::parse(bytes, Extent::new(pyramid, groups))
            .map_err(|detail| corrupt("tables of the page codec", 0, detail))
    }

    fn parse(bytes: &[u8], extent: Extent) -> std::result::Result<Self, String> {
        let raw = frame::decompress(bytes, MAX_RAW_BYTES)?;
        let short = || format!("{} bytes are too few", raw.len());
        let Extent { mips, groups } = extent;
        let (classes, rest) = raw
            .split_at_checked(mips * extent.bundles() * AREA)
            .ok_or_else(short)?;
        let (quarters, rest) = rest.split_at_checked(4 * mips * groups).ok_or_else(short)?;
        let (offsets, mut rest) = rest.split_at_checked(2 * MODELS).ok_or_else(short)?;
        let models = read_models(&mut rest, MODELS)?;
        let ends = read_models(&mut rest, END_MODELS)?;
        let sources = read_models(&mut rest, SOURCE_MODELS)?;
        let counts = [models.len(), ends.len(), sources.len()];
        if !rest.is_empty() || counts != [MODELS, END_MODELS, SOURCE_MODELS] {
            return Err(format!(
                "sets of {counts:?} models and {} bytes behind them, expected {MODELS}, {END_MODELS}, {SOURCE_MODELS} and none",
                rest.len()
            ));
        }
        if let Some(class) = classes.iter().find(|&&class| class >= MEAN_CLASSES) {
            return Err(format!("class {class} of a mean magnitude, {MEAN_CLASSES} exist"));
        }
        let quarters: Vec<_> = quarters
            .as_chunks::<4>()
            .0
            .iter()
            .map(|four| four.map(|quarters| quarters as i8))
            .collect();
        if let Some(bad) = quarters
            .as_flattened()
            .iter()
            .find(|bad| !FACTOR_QUARTERS.contains(bad))
        {
            return Err(format!("factor {bad} of a component, {FACTOR_QUARTERS:?} exist"));
        }
        let offsets = offsets
            .as_chunks::<2>()
            .0
            .iter()
            .map(|pair| pair.map(|offset| offset as i8));
        Ok(Self::new(
            extent,
            classes.to_vec(),
            quarters,
            models,
            ends,
            sources,
            offsets.collect(),
        ))
    }
}

fn value(offsets: [i8; 2], level: i32) -> f32 {
    let offset = match level.unsigned_abs() {
        0 => return 0.0,
        1 => offsets[0],
        _ => offsets[1],
    };
    let magnitude = level.unsigned_abs() as f32 + f32::from(offset) * OFFSET_UNIT;
    if level < 0 { -magnitude } else { magnitude }
}
