//! What all pages of an archive share: statistics of frequencies, models of levels, points of reconstruction.

use bytemuck::Zeroable;

use super::context::{
    Context, FACTOR_QUARTERS, MEAN_CLASSES, MODELS, Means, class_of_mean, factor, mean_of_class, mean_unit,
};
use super::levels::{
    END_MODELS, ESCAPE, Found, SOURCE_MODELS, SOURCES, SYMBOLS, Sink, end_model, source_model, symbol_of,
};
use super::scan::DIAGONALS;
use super::transform::AREA;
use crate::codec::rans::{Buckets, Model, read_models, write_models};
use crate::{Pyramid, Result, error::corrupt, frame};

/// Groups that share statistics of frequencies: 20 components.
const BUNDLE_GROUPS: usize = 5;
/// Reconstruction points are multiples of 1/128 of a step.
const OFFSET_UNIT: f32 = 1.0 / 128.0;
/// Most bytes of tables before compression: all mips of the largest archive with the most components.
const MAX_RAW_BYTES: usize =
    17 * (52 * AREA + 1024) + (MODELS + END_MODELS + SOURCE_MODELS) * 130 + 2 * MODELS + 16;
/// Of so many blocks one has a source at least, or none of the archive has: to look for them takes a decoder time.
const LEAST_SOURCES: u64 = 128;

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

/// Sums over coefficients, from which tables are made. Those of several groups are added up.
#[derive(Clone, Debug)]
pub struct Statistics {
    extent: Extent,
    contexts: bool,
    /// Sum of magnitudes and number of coefficients, `[mip][bundle][v][u]`.
    magnitudes: Vec<(u64, u64)>,
    /// Sum of magnitudes and of the means at their places, `[mip][group]`, for each component of the group.
    components: Vec<[(u64, u64); 4]>,
    levels: Vec<[u32; SYMBOLS]>,
    ends: Vec<[u32; DIAGONALS + 1]>,
    sources: Vec<[u32; SOURCES]>,
    /// By context, for levels of one and of more: sum of how much larger the coefficients are, in steps, and their
    /// number.
    offsets: Vec<[(f64, u64); 2]>,
}

impl Statistics {
    /// Nothing counted yet. `contexts` says that contexts will be known while counting, so that models can be made.
    pub(super) fn new(pyramid: &Pyramid, groups: u32, contexts: bool) -> Self {
        let extent = Extent::new(pyramid, groups);
        Self {
            extent,
            contexts,
            magnitudes: vec![(0, 0); extent.mips * extent.bundles() * AREA],
            components: vec![[(0, 0); 4]; extent.mips * extent.groups],
            levels: vec![[0; SYMBOLS]; MODELS],
            ends: vec![[0; DIAGONALS + 1]; END_MODELS],
            sources: vec![[0; SOURCES]; SOURCE_MODELS],
            offsets: vec![[(0.0, 0); 2]; MODELS],
        }
    }

    /// Adds what was counted elsewhere of the same archive.
    ///
    /// # Panics
    /// If it is of an archive of other sizes.
    pub fn add(&mut self, other: &Statistics) {
        assert_eq!(self.extent, other.extent);
        let sums = self
            .magnitudes
            .iter_mut()
            .chain(self.components.as_flattened_mut());
        let others = other.magnitudes.iter().chain(other.components.as_flattened());
        for (sum, other) in sums.zip(others) {
            *sum = (sum.0 + other.0, sum.1 + other.1);
        }
        let counts = self
            .levels
            .as_flattened_mut()
            .iter_mut()
            .chain(self.ends.as_flattened_mut())
            .chain(self.sources.as_flattened_mut());
        let others = other
            .levels
            .as_flattened()
            .iter()
            .chain(other.ends.as_flattened())
            .chain(other.sources.as_flattened());
        for (sum, other) in counts.zip(others) {
            *sum = sum.saturating_add(*other);
        }
        for (sum, other) in self
            .offsets
            .as_flattened_mut()
            .iter_mut()
            .zip(other.offsets.as_flattened())
        {
            *sum = (sum.0 + other.0, sum.1 + other.1);
        }
    }

    /// The best tables for what was counted; without models of levels and ends after the first round.
    pub fn tables(&self) -> PageTables {
        let classes = self
            .magnitudes
            .iter()
            .map(|&(sum, count)| class_of_mean(sum as f64 / count.max(1) as f64))
            .collect();
        let unit = mean_unit();
        let quarters = self.components.iter().map(|components| {
            components.map(|(sum, of_means)| {
                let ratio = sum as f64 * unit / of_means as f64;
                // Nothing counted is no number, and no factor.
                (4.0 * ratio.log2()).round().clamp(
                    f64::from(*FACTOR_QUARTERS.start()),
                    f64::from(*FACTOR_QUARTERS.end()),
                ) as i8
            })
        });
        let quarters = quarters.collect();
        if !self.contexts {
            let quarters = vec![[0; 4]; self.components.len()];
            let nothing = self.sources.as_flattened().iter().all(|&count| count == 0);
            return PageTables::new(
                self.extent,
                classes,
                quarters,
                Vec::new(),
                Vec::new(),
                if nothing { Vec::new() } else { self.sources() },
                Vec::new(),
            );
        }
        let models = self.levels.iter().map(|counts| {
            let mut counts = *counts;
            // What no level was seen of can still be asked of another page.
            counts[0] = counts[0].max(1);
            counts[ESCAPE] = counts[ESCAPE].max(1);
            Model::from_counts(&counts)
        });
        let ends = self
            .ends
            .iter()
            .map(|counts| Model::from_counts(&counts.map(|count| count.max(1))));
        let offsets = self.offsets.iter().map(|sums| {
            sums.map(|(sum, count)| {
                let mean = sum / count.max(1) as f64 / f64::from(OFFSET_UNIT);
                mean.round().clamp(-96.0, 96.0) as i8
            })
        });
        let offsets = offsets.collect();
        PageTables::new(
            self.extent,
            classes,
            quarters,
            models.collect(),
            ends.collect(),
            self.sources(),
            offsets,
        )
    }

    /// Models of the sources that were counted: of none, unless there are enough.
    fn sources(&self) -> Vec<Model> {
        let counted = self.sources.as_flattened().iter().map(|&count| u64::from(count));
        let none: u64 = self.sources.iter().map(|counts| u64::from(counts[0])).sum();
        let enough = (counted.sum::<u64>() - none) * LEAST_SOURCES > none;
        let models = self.sources.iter().map(|counts| {
            let mut counts = *counts;
            counts[0] = counts[0].max(1);
            if !enough {
                counts[1..].fill(0);
            }
            Model::from_counts(&counts)
        });
        models.collect()
    }
}

/// Counts the symbols of a group's pages at a mip.
pub(super) struct Counter<'a> {
    pub(super) statistics: &'a mut Statistics,
    /// The means that are known.
    pub(super) means: Means<'a>,
    pub(super) mip: u8,
    pub(super) group: u16,
}

impl Sink for Counter<'_> {
    fn end(&mut self, model: usize, end: usize) {
        self.statistics.ends[model][end] += 1;
    }

    fn source(&mut self, model: usize, source: usize) {
        self.statistics.sources[model][source] += 1;
    }

    fn levels(&mut self, found: &[Found; 4]) {
        let group = self.statistics.extent.group(self.mip, self.group);
        for (c, found) in found.iter().enumerate() {
            self.level(found);
            let (sum, of_means) = &mut self.statistics.components[group][c];
            *sum += u64::from(found.level.unsigned_abs());
            *of_means += self.means.places[usize::from(found.like)] as u64;
        }
    }
}

impl Counter<'_> {
    fn level(&mut self, found: &Found) {
        let Found { context, level, .. } = *found;
        let statistics = &mut *self.statistics;
        let symbol = symbol_of(level, context.shift).unwrap_or(ESCAPE);
        statistics.levels[usize::from(context.model)][symbol] += 1;

        let place = statistics.extent.bundle(self.mip, self.group) * AREA + usize::from(found.like);
        let (sum, count) = &mut statistics.magnitudes[place];
        *sum += u64::from(level.unsigned_abs());
        *count += 1;

        if level != 0 && context.shift == 0 {
            let larger = usize::from(level.unsigned_abs() > 1);
            let (sum, count) = &mut statistics.offsets[usize::from(context.model)][larger];
            *sum += f64::from(found.coefficient.abs()) - f64::from(level.unsigned_abs());
            *count += 1;
        }
    }
}
