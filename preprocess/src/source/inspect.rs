//! What a BTF holds, before hours are spent on it.
//!
//! Every image is looked at, a few are decoded. What is wrong is said, and what could be found out nevertheless.

use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use serde::Serialize;
use tileset::Direction;

use super::image_set::{degrees, survey};
use super::open::{Kind, kind};
use super::{Btf, Color, Overrides};
use crate::npy::MAX_SAMPLE;
use crate::{Error, Result};

/// Images that are decoded for the range of values: enough to see every ring of a usual sampling.
const SAMPLED_IMAGES: usize = 32;
/// Problems listed at most.
const MAX_PROBLEMS: usize = 16;
/// Rank for which memory is estimated: the default of preprocessing.
const RANK: u64 = 100;

/// All there is to say about a BTF, or about what keeps a file or folder from being one.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Inspection {
    /// The file or folder.
    pub path: String,
    /// The format for people.
    pub format: Option<String>,
    /// Whether it can be preprocessed, as far as can be seen without decoding all of it.
    pub usable: bool,
    /// What keeps it from being preprocessed.
    pub problems: Vec<String>,
    /// Files left out, assumptions made.
    pub notes: Vec<String>,
    /// Texels in a row.
    pub width: Option<u32>,
    /// Rows of texels.
    pub height: Option<u32>,
    /// View directions.
    pub views: Option<Table>,
    /// Light directions.
    pub lights: Option<Table>,
    /// Whether views and lights are the same directions in the same order.
    pub views_equal_lights: Option<bool>,
    /// Whether the material repeats.
    pub wrap: Option<bool>,
    /// Whether samples include the cosine of the light's polar angle.
    pub cosine: Option<bool>,
    /// What the user said about the numbers in images.
    pub color: Option<Color>,
    /// Images that are there.
    pub images: usize,
    /// Pairs of view and light without an image.
    pub missing_images: usize,
    /// The first of them.
    pub missing: Vec<String>,
    /// Terms of the factorization that the file itself holds.
    pub stored_terms: Option<usize>,
    /// Bytes that a pass over all samples reads from the disk.
    pub stored_bytes: Option<u64>,
    /// Rows and columns of the matrix: views × lights × 3, texels.
    pub matrix: Option<[usize; 2]>,
    /// Bytes of all samples as single floats.
    pub matrix_bytes: Option<u64>,
    /// Found in some of the images.
    pub sample: Option<Sample>,
    /// What preprocessing costs here.
    pub estimate: Option<Estimate>,
}

/// A table of directions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table {
    /// Directions in all.
    pub count: usize,
    /// Directions by theta, ascending.
    pub rings: Vec<Ring>,
}

/// Directions of the same theta.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ring {
    /// In degrees.
    pub theta: f64,
    /// Directions.
    pub count: usize,
}

/// What some of the images hold, evenly spread over views and lights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Sample {
    /// Images decoded.
    pub images: usize,
    /// Least finite value.
    pub min: f32,
    /// Largest finite value.
    pub max: f32,
    /// Means of the finite values, by channel.
    pub mean_rgb: [f64; 3],
    /// Samples that are no numbers.
    pub nan: u64,
    /// Samples that are infinite or larger than is accepted.
    pub infinite: u64,
    /// Negative samples.
    pub negative: u64,
    /// Finite samples beyond the range of half floats.
    pub beyond_half: u64,
}

/// What preprocessing costs on this machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Seconds to read and decode all images once, from the images that were decoded. Preprocessing makes several
    /// passes.
    pub pass_seconds: f64,
    /// Bytes of the factors at rank 100.
    pub factor_bytes: u64,
}

/// Looks at a file or folder. What is wrong with it is in [`Inspection::problems`], never an error.
pub fn inspect(path: &Path, overrides: &Overrides) -> Inspection {
    let mut inspection = Inspection {
        path: path.display().to_string(),
        color: overrides.color,
        ..Inspection::default()
    };
    let opened = match kind(path) {
        Ok(Kind::Images) => inspection.survey(path, overrides),
        Ok(_) => Btf::open_with(path, overrides),
        Err(error) => Err(error),
    };
    match opened {
        Ok(btf) => inspection.look_at(&btf),
        // The survey has told its own problems already.
        Err(error) if inspection.problems.is_empty() => inspection.problem(path, &error),
        Err(_) => {}
    }
    inspection.usable = inspection.problems.is_empty();
    inspection
}

impl Inspection {
    /// What a set of images says, even if it is no BTF.
    fn survey(&mut self, path: &Path, overrides: &Overrides) -> Result<Btf> {
        let survey = survey(path)?;
        self.format = Some(survey.format.clone());
        self.problems.clone_from(&survey.problems);
        self.notes = survey.notes().to_vec();
        self.images = survey.images;
        (self.missing_images, self.missing) = survey.missing();
        let sampling = survey.sampling(overrides);
        self.tables(&sampling.views, &sampling.lights);
        survey.open(path, overrides)
    }

    fn tables(&mut self, views: &[Direction], lights: &[Direction]) {
        self.views = Some(Table::of(views));
        self.lights = Some(Table::of(lights));
        self.views_equal_lights = Some(views == lights);
    }

    fn look_at(&mut self, btf: &Btf) {
        self.format = Some(btf.format());
        self.notes = btf.notes();
        (self.width, self.height) = (Some(btf.width()), Some(btf.height()));
        (self.wrap, self.cosine) = (Some(btf.wrap()), Some(btf.cosine()));
        self.images = btf.image_count();
        self.stored_bytes = Some(btf.stored_bytes());
        self.matrix = Some([btf.rows(), btf.columns()]);
        self.matrix_bytes = Some(4 * btf.rows() as u64 * btf.columns() as u64);
        self.tables(btf.views(), btf.lights());
        match btf.low_rank() {
            Ok(low_rank) => self.stored_terms = low_rank.map(|factors| factors.terms),
            Err(error) => self.problem(btf.path(), &error),
        }
        let checked: Vec<Option<Error>> = (0..btf.image_count())
            .into_par_iter()
            .map(|image| btf.check_image(image).err())
            .collect();
        let mut wrong: Vec<Error> = checked.into_iter().flatten().collect();
        if wrong.is_empty() {
            wrong = self.decode_some(btf);
        }
        let more = wrong.len().saturating_sub(MAX_PROBLEMS);
        for error in wrong.iter().take(MAX_PROBLEMS) {
            self.problem(btf.path(), error);
        }
        if more > 0 {
            self.problems.push(format!("{more} more images like these"));
        }
    }

    /// Range of values and speed, from some of the images.
    fn decode_some(&mut self, btf: &Btf) -> Vec<Error> {
        let images = spread(btf.image_count());
        let began = Instant::now();
        let looked: Vec<Result<Scan>> = images
            .par_iter()
            .map_init(Vec::new, |buffer, &image| Scan::of(btf, image, buffer))
            .collect();
        let seconds = began.elapsed().as_secs_f64();
        let (mut scan, mut wrong) = (Scan::default(), Vec::new());
        for looked in looked {
            match looked {
                Ok(other) => scan.add(other),
                Err(error) => wrong.push(error),
            }
        }
        wrong.extend(scan.first_bad.take());
        self.sample = Some(scan.sample(images.len() - wrong.len().min(images.len())));
        self.estimate = Some(Estimate {
            pass_seconds: seconds * btf.image_count() as f64 / images.len() as f64,
            factor_bytes: 4 * RANK * (btf.rows() as u64 + btf.columns() as u64),
        });
        wrong
    }

    fn problem(&mut self, path: &Path, error: &Error) {
        let text = error.to_string();
        // The path stands above the list.
        let own = format!("{}: ", path.display());
        self.problems
            .push(text.strip_prefix(&own).unwrap_or(&text).to_owned());
    }
}

impl Table {
    fn of(directions: &[Direction]) -> Self {
        let mut thetas: Vec<f64> = directions
            .iter()
            .map(|direction| degrees(direction.theta))
            .collect();
        thetas.sort_by(f64::total_cmp);
        let mut rings: Vec<Ring> = Vec::new();
        for theta in thetas {
            match rings.last_mut() {
                Some(ring) if ring.theta == theta => ring.count += 1,
                _ => rings.push(Ring { theta, count: 1 }),
            }
        }
        Self {
            count: directions.len(),
            rings,
        }
    }
}

/// Indices of images, evenly spread from the first to the last.
fn spread(count: usize) -> Vec<usize> {
    let wanted = SAMPLED_IMAGES.min(count);
    (0..wanted)
        .map(|index| {
            if wanted == 1 {
                0
            } else {
                index * (count - 1) / (wanted - 1)
            }
        })
        .collect()
}

/// Sums over some images.
#[derive(Debug, Default)]
struct Scan {
    sample: Sample,
    sums: [f64; 3],
    counts: [u64; 3],
    first_bad: Option<Error>,
}

impl Scan {
    fn of(btf: &Btf, image: usize, buffer: &mut Vec<f32>) -> Result<Self> {
        let samples = btf.samples(image..image + 1, buffer)?;
        let mut scan = Self::default();
        (scan.sample.min, scan.sample.max) = (f32::INFINITY, f32::NEG_INFINITY);
        for index in 0..samples.len() {
            let value = samples.get(index);
            let channel = index / btf.columns();
            if value.is_nan() {
                scan.sample.nan += 1;
            } else if value.abs() > MAX_SAMPLE {
                scan.sample.infinite += 1;
            } else {
                scan.sample.min = scan.sample.min.min(value as f32);
                scan.sample.max = scan.sample.max.max(value as f32);
                scan.sample.negative += u64::from(value < 0.0);
                scan.sample.beyond_half += u64::from(value.abs() > half::f16::MAX.to_f64());
                scan.sums[channel] += value;
                scan.counts[channel] += 1;
            }
        }
        if scan.sample.nan + scan.sample.infinite > 0 {
            scan.first_bad = btf.bad_sample(image, &samples);
        }
        Ok(scan)
    }

    fn add(&mut self, other: Self) {
        let first = self.counts == [0; 3] && self.sample.nan + self.sample.infinite == 0;
        let (own, new) = (&mut self.sample, other.sample);
        own.min = if first { new.min } else { own.min.min(new.min) };
        own.max = if first { new.max } else { own.max.max(new.max) };
        own.nan += new.nan;
        own.infinite += new.infinite;
        own.negative += new.negative;
        own.beyond_half += new.beyond_half;
        for channel in 0..3 {
            self.sums[channel] += other.sums[channel];
            self.counts[channel] += other.counts[channel];
        }
        self.first_bad = self.first_bad.take().or(other.first_bad);
    }

    fn sample(self, images: usize) -> Sample {
        let mean = |channel: usize| match self.counts[channel] {
            0 => 0.0,
            count => self.sums[channel] / count as f64,
        };
        Sample {
            images,
            mean_rgb: [mean(0), mean(1), mean(2)],
            ..self.sample
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_spread_from_the_first_to_the_last() {
        assert_eq!(spread(1), [0]);
        assert_eq!(spread(3), [0, 1, 2]);
        let many = spread(6561);
        assert_eq!((many.len(), many[0], many[31]), (SAMPLED_IMAGES, 0, 6560));
    }

    #[test]
    fn rings_are_counted() {
        let at = |theta: f64| Direction {
            theta: theta.to_radians(),
            phi: 0.0,
        };
        let table = Table::of(&[at(15.0), at(0.0), at(15.0)]);
        let rings: Vec<_> = table.rings.iter().map(|ring| (ring.theta, ring.count)).collect();
        assert_eq!((table.count, rings), (3, vec![(0.0, 1), (15.0, 2)]));
    }
}
