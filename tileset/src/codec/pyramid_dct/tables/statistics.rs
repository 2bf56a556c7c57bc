//! Counting the symbols of an archive, from which its tables are made.

use super::{Extent, OFFSET_UNIT, PageTables};
use crate::Pyramid;
use crate::codec::pyramid_dct::context::{FACTOR_QUARTERS, MODELS, Means, class_of_mean, mean_unit};
use crate::codec::pyramid_dct::levels::{
    END_MODELS, ESCAPE, Found, SOURCE_MODELS, SOURCES, SYMBOLS, Sink, symbol_of,
};
use crate::codec::pyramid_dct::scan::DIAGONALS;
use crate::codec::pyramid_dct::transform::AREA;
use crate::codec::rans::Model;

/// Of so many blocks one has a source at least, or none of the archive has: to look for them takes a decoder time.
const LEAST_SOURCES: u64 = 128;

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
    pub(in crate::codec::pyramid_dct) fn new(pyramid: &Pyramid, groups: u32, contexts: bool) -> Self {
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
pub(in crate::codec::pyramid_dct) struct Counter<'a> {
    pub(in crate::codec::pyramid_dct) statistics: &'a mut Statistics,
    /// The means that are known.
    pub(in crate::codec::pyramid_dct) means: Means<'a>,
    pub(in crate::codec::pyramid_dct) mip: u8,
    pub(in crate::codec::pyramid_dct) group: u16,
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
