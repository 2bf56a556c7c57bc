//! What all pages of an archive share: statistics of frequencies, models of levels, points of reconstruction.

use bytemuck::Zeroable;

use super::context::{Context, MEAN_CLASSES, MODELS, class_of_mean, mean_of_class};
use super::levels::{END_MODELS, ESCAPE, Found, SYMBOLS, Sink, end_model, symbol_of};
use super::scan::DIAGONALS;
use super::transform::AREA;
use crate::codec::rans::{Buckets, Model, read_models, write_models};
use crate::{Pyramid, Result, error::corrupt, frame};

/// Groups that share statistics of frequencies: 20 components.
const BUNDLE_GROUPS: usize = 5;
/// Reconstruction points are multiples of 1/128 of a step.
const OFFSET_UNIT: f32 = 1.0 / 128.0;
/// Most bytes of tables before compression: all mips of the largest archive with the most components.
const MAX_RAW_BYTES: usize = 17 * 52 * AREA + (MODELS + END_MODELS) * 130 + 2 * MODELS + 16;

/// What all pages of an archive share.
#[derive(Clone)]
pub struct PageTables {
    mips: usize,
    bundles: usize,
    /// Class of the mean magnitude, `[mip][bundle][v][u]`.
    classes: Vec<u8>,
    /// The same as [`mean_of_class`] gives it.
    means: Vec<[i32; AREA]>,
    /// Models of levels by context.
    pub(super) models: Vec<Model>,
    /// Models of the number of diagonals.
    pub(super) ends: Vec<Model>,
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
        write!(f, "PageTables({} mips, {} bundles)", self.mips, self.bundles)
    }
}

impl PartialEq for PageTables {
    fn eq(&self, other: &Self) -> bool {
        self.raw_bytes() == other.raw_bytes()
    }
}

/// Mips and bundles of an archive.
fn extent(pyramid: &Pyramid, groups: u32) -> (usize, usize) {
    (
        usize::from(pyramid.tail_mip()) + 1,
        (groups as usize).div_ceil(BUNDLE_GROUPS),
    )
}

impl PageTables {
    fn new(
        (mips, bundles): (usize, usize),
        classes: Vec<u8>,
        models: Vec<Model>,
        ends: Vec<Model>,
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
            mips,
            bundles,
            bits: bits.collect(),
            classes,
            means,
            models,
            ends,
            offsets,
            buckets,
            values,
        }
    }

    /// Expected magnitudes of the coefficients of a group at a mip.
    pub(super) fn means(&self, mip: u8, group: u16) -> &[i32; AREA] {
        let bundle = (usize::from(group) / BUNDLE_GROUPS).min(self.bundles - 1);
        &self.means[usize::from(mip).min(self.mips - 1) * self.bundles + bundle]
    }

    /// The coefficient in steps that a level stands for.
    #[inline]
    pub(super) fn value(&self, Context { model, shift }: Context, level: i32) -> f32 {
        if shift > 0 {
            // The lowest bits are as they were: no model says where in its interval a value lies.
            return level as f32;
        }
        value(self.offsets[usize::from(model)], level)
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
        bytes.extend(self.offsets.iter().flatten().map(|&offset| offset as u8));
        write_models(&self.models, &mut bytes);
        write_models(&self.ends, &mut bytes);
        bytes
    }

    /// Reads [`PageTables::to_bytes`]; allocation is bounded by what the sizes of the archive can need.
    ///
    /// # Errors
    /// [`crate::Error::Corrupt`].
    pub fn from_bytes(bytes: &[u8], pyramid: &Pyramid, groups: u32) -> Result<Self> {
        Self::parse(bytes, extent(pyramid, groups))
            .map_err(|detail| corrupt("tables of the page codec", 0, detail))
    }

    fn parse(bytes: &[u8], (mips, bundles): (usize, usize)) -> std::result::Result<Self, String> {
        let raw = frame::decompress(bytes, MAX_RAW_BYTES)?;
        let short = || format!("{} bytes are too few", raw.len());
        let (classes, rest) = raw.split_at_checked(mips * bundles * AREA).ok_or_else(short)?;
        let (offsets, mut rest) = rest.split_at_checked(2 * MODELS).ok_or_else(short)?;
        let models = read_models(&mut rest, MODELS)?;
        let ends = read_models(&mut rest, END_MODELS)?;
        if !rest.is_empty() || models.len() != MODELS || ends.len() != END_MODELS {
            return Err(format!(
                "{} and {} models and {} bytes behind them, expected {MODELS}, {END_MODELS} and none",
                models.len(),
                ends.len(),
                rest.len()
            ));
        }
        if let Some(class) = classes.iter().find(|&&class| class >= MEAN_CLASSES) {
            return Err(format!("class {class} of a mean magnitude, {MEAN_CLASSES} exist"));
        }
        let offsets = offsets
            .as_chunks::<2>()
            .0
            .iter()
            .map(|pair| pair.map(|offset| offset as i8));
        Ok(Self::new(
            (mips, bundles),
            classes.to_vec(),
            models,
            ends,
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
    mips: usize,
    bundles: usize,
    contexts: bool,
    /// Sum of magnitudes and number of coefficients, `[mip][bundle][v][u]`.
    magnitudes: Vec<(u64, u64)>,
    levels: Vec<[u32; SYMBOLS]>,
    ends: Vec<[u32; DIAGONALS + 1]>,
    /// By context, for levels of one and of more: sum of how much larger the coefficients are, in steps, and their
    /// number.
    offsets: Vec<[(f64, u64); 2]>,
}

impl Statistics {
    /// Nothing counted yet. `contexts` says that contexts will be known while counting, so that models can be made.
    pub(super) fn new(pyramid: &Pyramid, groups: u32, contexts: bool) -> Self {
        let (mips, bundles) = extent(pyramid, groups);
        Self {
            mips,
            bundles,
            contexts,
            magnitudes: vec![(0, 0); mips * bundles * AREA],
            levels: vec![[0; SYMBOLS]; MODELS],
            ends: vec![[0; DIAGONALS + 1]; END_MODELS],
            offsets: vec![[(0.0, 0); 2]; MODELS],
        }
    }

    /// Adds what was counted elsewhere of the same archive.
    ///
    /// # Panics
    /// If it is of an archive of other sizes.
    pub fn add(&mut self, other: &Statistics) {
        assert_eq!((self.mips, self.bundles), (other.mips, other.bundles));
        for (sum, other) in self.magnitudes.iter_mut().zip(&other.magnitudes) {
            *sum = (sum.0 + other.0, sum.1 + other.1);
        }
        let counts = self
            .levels
            .as_flattened_mut()
            .iter_mut()
            .chain(self.ends.as_flattened_mut());
        let others = other
            .levels
            .as_flattened()
            .iter()
            .chain(other.ends.as_flattened());
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

    /// The best tables for what was counted; without models after the first round.
    pub fn tables(&self) -> PageTables {
        let classes = self
            .magnitudes
            .iter()
            .map(|&(sum, count)| class_of_mean(sum as f64 / count.max(1) as f64))
            .collect();
        let extent = (self.mips, self.bundles);
        if !self.contexts {
            return PageTables::new(extent, classes, Vec::new(), Vec::new(), Vec::new());
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
        PageTables::new(extent, classes, models.collect(), ends.collect(), offsets)
    }
}

/// Counts the symbols of a group's pages at a mip.
pub(super) struct Counter<'a> {
    pub(super) statistics: &'a mut Statistics,
    pub(super) mip: u8,
    pub(super) group: u16,
}

impl Sink for Counter<'_> {
    fn end(&mut self, model: usize, end: usize) {
        self.statistics.ends[model][end] += 1;
    }

    fn levels(&mut self, found: &[Found; 4]) {
        for found in found {
            self.level(found);
        }
    }
}

impl Counter<'_> {
    fn level(&mut self, found: &Found) {
        let Found { context, level, .. } = *found;
        let statistics = &mut *self.statistics;
        let symbol = symbol_of(level, context.shift).unwrap_or(ESCAPE);
        statistics.levels[usize::from(context.model)][symbol] += 1;

        let bundle = usize::from(self.group) / BUNDLE_GROUPS;
        let place = (usize::from(self.mip) * statistics.bundles + bundle) * AREA + usize::from(found.like);
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
