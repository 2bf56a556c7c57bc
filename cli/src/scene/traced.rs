//! A material, traced and factorized without ever being whole.
//!
//! A material of 512² texels and 81 × 81 directions has 10 GB of samples, all of which have to be traced, written and read
//! several times to factorize them. Here a few thousand texels are traced under all directions, and all texels from all views
//! under a fifth of the lights; none of these samples is stored ([`::preprocess::factorize::Sampled`]).
//!
//! Lights can be left out, views cannot: a relief shows other places of the surface to each of them. Of cloth (31 × 31 directions,
//! 48 terms) the best factors leave out 0.210 of its root mean square, those from 16 lights 0.213, from 8 lights 0.223; those
//! from half of the views and all lights, which are as many rows as 16 lights, 0.32.

use std::ops::Range;
use std::path::Path;

use ::preprocess::factorize::{Sampled, factorize};
use ::preprocess::npy::{Samples, Sampling};
use ::preprocess::source::Images;
use ::preprocess::{Btf, Factors, Settings};
use anyhow::Result;
use half::f16;
use scenes::synth::{Sampler, SynthOptions, sample};
use tileset::Direction;

use crate::progress;

/// Texels along each side of the grid of those that are traced under all directions. Forty and more for each component: what
/// the eigen-ABRDFs of so few texels leave out of all others beyond the least possible is one part in forty at most.
const KNOWN_SIDE: usize = 64;
/// Further texels by which the error is measured.
const OTHERS: usize = 512;
/// Materials of so many texels or less are traced whole: there would be little to save.
const WHOLE: usize = 2 * KNOWN_SIDE * KNOWN_SIDE;
/// Lights under which all texels are traced: whole groups of the tracer's lanes.
const LIGHTS: usize = 16;

/// Traces and factorizes a material. The BTF that comes back says what it is; most of its samples were never made.
pub(super) fn factorized(
    material: &str,
    options: &SynthOptions,
    path: &Path,
    settings: &Settings,
    label: &str,
    quiet: bool,
) -> Result<(Btf, Factors)> {
    let order = spread(&options.lights);
    let few_lights = order.len().min(LIGHTS);
    let views = options.views.len();
    // The few lights first: the tracer can leave out those at the end.
    let ordered = SynthOptions {
        lights: order.iter().map(|&light| options.lights[light]).collect(),
        ..options.clone()
    };
    let sampling = Sampling {
        views: options.views.clone(),
        lights: options.lights.clone(),
        wrap: true,
        cosine: true,
    };
    let texels = options.size as usize * options.size as usize;
    let whole = texels <= WHOLE;
    let steps = if whole { views } else { 2 * views };
    let bar = progress::bar(&format!("{label}trace"), steps as u64, quiet);
    let btf = |listed: Vec<f16>, texels: usize| {
        let images = Box::new(Held {
            samples: listed,
            texels,
        });
        Btf::new(path, sampling.clone(), (texels as u32, 1), images)
    };
    let of_size = |images: Held| {
        Btf::new(
            path,
            sampling.clone(),
            (options.size, options.size),
            Box::new(images),
        )
    };
    let made = sample(material, &ordered, |sampler| -> Result<(Btf, Factors)> {
        if whole {
            let all: Vec<u32> = (0..texels as u32).collect();
            let btf = of_size(Held {
                samples: under_all(sampler, &all, &options.views, &order, &|| bar.inc(1)),
                texels,
            })?;
            let factors = factorize(&btf, settings, &|_| ())?;
            return Ok((btf, factors));
        }
        let mut listed = grid(options.size as usize, options.seed);
        let known_count = listed.len();
        listed.extend(others(texels, options.seed, &listed));
        let samples = under_all(sampler, &listed, &options.views, &order, &|| bar.inc(1));
        let part = |range: Range<usize>| {
            let planes = samples.chunks_exact(listed.len());
            planes
                .flat_map(|plane| &plane[range.clone()])
                .copied()
                .collect::<Vec<f16>>()
        };
        let known = btf(part(0..known_count), known_count)?;
        let others = btf(part(known_count..listed.len()), listed.len() - known_count)?;
        drop(samples);
        let images: Vec<usize> = (0..views * few_lights)
            .map(|n| n / few_lights * order.len() + order[n % few_lights])
            .collect();
        let mut sampled = Sampled::new(&known, &images, texels, settings, &|_| ())?;
        drop(known);
        sampler.narrow(few_lights);
        let mut block = vec![f16::ZERO; few_lights * 3 * texels];
        for view in 0..views {
            sampler.all(view, &mut block);
            sampled.add(&block);
            bar.inc(1);
        }
        drop(block);
        let btf = of_size(Held::default())?;
        let factors = sampled.finish(&btf, &others, settings, &|_| ())?;
        Ok((btf, factors))
    })?;
    bar.finish_and_clear();
    made
}

/// What tracing a material of so many texels takes: samples that are factorized, texels seen from views, and samples that are
/// shaded.
pub(super) fn work(texels: f64, directions: f64) -> [f64; 3] {
    let known = if texels <= WHOLE as f64 {
        texels
    } else {
        (KNOWN_SIDE * KNOWN_SIDE + OTHERS) as f64
    };
    let all = if texels <= WHOLE as f64 { 0.0 } else { texels };
    let samples = known * directions * directions;
    let shaded = samples + all * directions * directions.min(LIGHTS as f64);
    [samples, (known + all) * directions, shaded]
}

/// Some texels under all directions, `[view][light][rgb][texel]`; `order` is that of the sampler's lights.
fn under_all(
    sampler: &mut Sampler<'_>,
    texels: &[u32],
    views: &[Direction],
    order: &[usize],
    done: &dyn Fn(),
) -> Vec<f16> {
    let image = 3 * texels.len();
    let mut samples = vec![f16::ZERO; views.len() * order.len() * image];
    let mut block = vec![f16::ZERO; order.len() * image];
    for (view, samples) in samples.chunks_exact_mut(block.len()).enumerate() {
        sampler.some(view, texels, &mut block);
        for (&light, block) in order.iter().zip(block.chunks_exact(image)) {
            samples[light * image..][..image].copy_from_slice(block);
        }
        done();
    }
    samples
}

/// A texel in each cell of a grid, at random: close to each other in no direction, and in step with no pattern.
fn grid(size: usize, seed: u64) -> Vec<u32> {
    let edge = |n: usize| n * size / KNOWN_SIDE;
    (0..KNOWN_SIDE * KNOWN_SIDE)
        .map(|cell| {
            let place = |n: usize, random: u64| edge(n) + random as usize % (edge(n + 1) - edge(n));
            let random = mixed(seed, cell as u64);
            let (x, y) = (
                place(cell % KNOWN_SIDE, random),
                place(cell / KNOWN_SIDE, random >> 32),
            );
            (y * size + x) as u32
        })
        .collect()
}

/// Texels at random that are not in the list, each once.
fn others(texels: usize, seed: u64, known: &[u32]) -> Vec<u32> {
    let mut taken: std::collections::HashSet<u32> = known.iter().copied().collect();
    (0..)
        .map(|n| (mixed(!seed, n) % texels as u64) as u32)
        .filter(|&texel| taken.insert(texel))
        .take(OTHERS)
        .collect()
}

/// Steele, Lea, Flood, Fast Splittable Pseudorandom Number Generators, 2014: the mixer of SplitMix64.
fn mixed(seed: u64, n: u64) -> u64 {
    let z = seed.wrapping_add((n + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// All directions, so that any number of the first ones are spread evenly: each is the farthest from those before it
/// (Gonzalez, Clustering to Minimize the Maximum Intercluster Distance, 1985).
fn spread(directions: &[Direction]) -> Vec<usize> {
    let vectors: Vec<[f64; 3]> = directions.iter().map(|direction| direction.to_vector()).collect();
    let distance = |a: [f64; 3], b: [f64; 3]| (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>();
    let mut order = vec![0; usize::from(!directions.is_empty())];
    let mut nearest = vec![f64::INFINITY; directions.len()];
    while let Some(&last) = order.last().filter(|_| order.len() < directions.len()) {
        nearest[last] = -1.0;
        for (nearest, vector) in nearest.iter_mut().zip(&vectors) {
            *nearest = nearest.min(distance(*vector, vectors[last]));
        }
        let farthest = (0..nearest.len()).filter(|n| !order.contains(n));
        order.extend(farthest.max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]).then(b.cmp(&a))));
    }
    order
}

/// Samples in memory, `[view][light][rgb][texel]`; none of a BTF that was never whole, of which only factors are known.
#[derive(Default)]
pub(super) struct Held {
    samples: Vec<f16>,
    texels: usize,
}

impl std::fmt::Debug for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} samples of {} texels", self.samples.len(), self.texels)
    }
}

impl Images for Held {
    fn format(&self) -> String {
        "traced".into()
    }

    fn stored_bytes(&self) -> u64 {
        0
    }

    fn sample_bytes(&self) -> usize {
        size_of::<f16>()
    }

    fn samples<'a>(&'a self, images: Range<usize>, _: &'a mut Vec<f32>) -> ::preprocess::Result<Samples<'a>> {
        let range = images.start * 3 * self.texels..images.end * 3 * self.texels;
        let there = self.samples.get(range).filter(|_| !self.samples.is_empty());
        let found = there.ok_or(::preprocess::Error::Invalid {
            what: "use of a traced material (its factors)",
            found: "samples were asked for".into(),
            expected: "factors only: its samples were never stored",
        })?;
        Ok(Samples::F16(found))
    }

    fn place(&self, image: usize) -> String {
        format!("image {image} of the traced material")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenes::synth;

    #[test]
    fn first_directions_are_spread() {
        let directions = synth::Sampling::Bonn81.directions();
        let order = spread(&directions);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..81).collect::<Vec<_>>());
        assert_eq!(order[0], 0);
        let few: Vec<[f64; 3]> = order[..LIGHTS]
            .iter()
            .map(|&n| directions[n].to_vector())
            .collect();
        let dot = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|axis| a[axis] * b[axis]).sum::<f64>();
        for direction in &directions {
            let nearest = few.iter().map(|few| dot(few, &direction.to_vector()));
            assert!(nearest.fold(-1.0, f64::max) > 30f64.to_radians().cos());
        }
        assert!(spread(&[]).is_empty());
    }

    #[test]
    fn listed_texels_are_distinct_and_everywhere() {
        let known = grid(96, 7);
        let all: std::collections::HashSet<u32> =
            known.iter().chain(&others(96 * 96, 7, &known)).copied().collect();
        assert_eq!(all.len(), KNOWN_SIDE * KNOWN_SIDE + OTHERS);
        assert!(all.iter().all(|&texel| texel < 96 * 96));
    }

    /// Of a material that is just too large to be traced whole, against all of its samples.
    #[test]
    fn a_share_of_the_samples_is_nearly_as_good_as_all() {
        let directions = synth::Sampling::Sparse31.directions();
        let options = SynthOptions {
            size: 92,
            views: directions.clone(),
            lights: directions.clone(),
            samples_per_texel: 1,
            ..SynthOptions::default()
        };
        let settings = Settings {
            components: 16,
            ..Settings::default()
        };
        let path = Path::new("cloth");
        let (btf, found) = factorized("cloth", &options, path, &settings, "", true).unwrap();
        assert_eq!((btf.width(), btf.height()), (92, 92));
        assert!(btf.samples(0..1, &mut Vec::new()).is_err());

        let all: Vec<u32> = (0..92 * 92).collect();
        let order: Vec<usize> = (0..31).collect();
        let samples = sample("cloth", &options, |sampler| {
            under_all(sampler, &all, &directions, &order, &|| ())
        });
        let held = Held {
            samples: samples.unwrap(),
            texels: 92 * 92,
        };
        let whole = Btf::new(path, btf.sampling().clone(), (92, 92), Box::new(held)).unwrap();
        let best = factorize(&whole, &settings, &|_| ()).unwrap();
        // The product against all samples, row by row.
        let (rows, columns) = (whole.rows(), whole.columns());
        let mut error = 0.0;
        let mut buffer = Vec::new();
        for image in 0..whole.image_count() {
            let Samples::F16(samples) = whole.samples(image..image + 1, &mut buffer).unwrap() else {
                panic!("halves")
            };
            for (channel, samples) in samples.chunks(columns).enumerate() {
                let mut rest: Vec<f32> = samples.iter().map(|value| value.to_f32()).collect();
                for (u, v) in found.u.chunks(rows).zip(found.v.chunks(columns)) {
                    let u = u[image * 3 + channel];
                    rest.iter_mut().zip(v).for_each(|(rest, v)| *rest -= u * v);
                }
                error += rest.iter().map(|rest| f64::from(rest * rest)).sum::<f64>();
            }
        }
        let (measured, stated, least) = (found.rms(error), found.rank_rms(), best.rank_rms());
        println!("left out: {measured:.5}, stated {stated:.5}; by the best factors {least:.5}");
        assert!((measured / stated - 1.0).abs() < 0.1);
        assert!(measured < 1.1 * least);
    }
}
