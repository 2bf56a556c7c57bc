//! Filling of samples that no reflectance can have.

mod common;

use std::ops::Range;
use std::path::Path;

use common::{Shape, material, sampling, write_btf};
use half::f16;
use preprocess::factorize::factorize;
use preprocess::npy::{Dtype, Samples};
use preprocess::source::{Images, RepairReport, Repairs};
use preprocess::{Btf, Error, Settings};
use proptest::prelude::*;

const SHAPE: Shape = Shape {
    views: 3,
    lights: 4,
    width: 7,
    height: 5,
};

/// Images in memory, decoded into the buffer like those of a compressed format, or lent like a map.
#[derive(Debug)]
struct InMemory {
    samples: Vec<f32>,
    image: usize,
    lent: bool,
}

impl Images for InMemory {
    fn format(&self) -> String {
        "memory".into()
    }

    fn stored_bytes(&self) -> u64 {
        size_of_val(&self.samples[..]) as u64
    }

    fn samples<'a>(
        &'a self,
        images: Range<usize>,
        buffer: &'a mut Vec<f32>,
    ) -> preprocess::Result<Samples<'a>> {
        let samples = &self.samples[images.start * self.image..images.end * self.image];
        if self.lent {
            return Ok(Samples::F32(samples));
        }
        buffer.clear();
        buffer.push(7.0); // a header: what is given may be any part of the buffer
        buffer.extend_from_slice(samples);
        Ok(Samples::F32(&buffer[1..]))
    }

    fn place(&self, image: usize) -> String {
        format!("image number {image}")
    }
}

fn in_memory(shape: Shape, samples: &[f32], lent: bool) -> Btf {
    let images = InMemory {
        samples: samples.to_vec(),
        image: 3 * shape.columns(),
        lent,
    };
    let size = (shape.width as u32, shape.height as u32);
    Btf::new(
        Path::new("memory"),
        sampling(shape.views, shape.lights),
        size,
        Box::new(images),
    )
    .unwrap()
}

/// All samples, `step` images at a time.
fn read(btf: &Btf, step: usize) -> preprocess::Result<Vec<f32>> {
    let (mut all, mut buffer) = (Vec::new(), Vec::new());
    for first in (0..btf.image_count()).step_by(step) {
        let samples = btf.samples(first..btf.image_count().min(first + step), &mut buffer)?;
        let from = all.len();
        all.resize(from + samples.len(), 0.0);
        samples.to_f32(&mut all[from..]);
    }
    Ok(all)
}

fn index(shape: Shape, view: usize, light: usize, channel: usize, x: usize, y: usize) -> usize {
    (((view * shape.lights + light) * 3 + channel) * shape.height + y) * shape.width + x
}

/// The samples of one channel of one image.
fn plane(shape: Shape, view: usize, light: usize, channel: usize) -> Range<usize> {
    let start = index(shape, view, light, channel, 0, 0);
    start..start + shape.columns()
}

fn settings() -> Settings {
    Settings {
        components: 3,
        memory_bytes: 1 << 30,
        ..Settings::default()
    }
}

#[test]
fn single_samples_take_the_mean_of_their_neighbours() {
    for dtype in [Dtype::F16, Dtype::F32] {
        let good = material(SHAPE, 3, 0.1, 1);
        let mut harmed = good.clone();
        let nan = index(SHAPE, 1, 2, 0, 3, 2);
        let infinite = index(SHAPE, 2, 3, 2, 0, 0);
        harmed[nan] = f32::NAN;
        harmed[infinite] = f32::NEG_INFINITY;
        let folder = tempfile::tempdir().unwrap();
        let path = write_btf(folder.path(), SHAPE, dtype, &harmed);

        let error = factorize(&Btf::open(&path).unwrap(), &settings(), &|_| ()).unwrap_err();
        let Error::BadSample {
            view: 1,
            light: 2,
            channel: 'r',
            x: 3,
            y: 2,
            ..
        } = error
        else {
            panic!("wrong place: {error}");
        };

        let (btf, repairs) = Btf::open(&path).unwrap().repaired();
        factorize(&btf, &settings(), &|_| ()).unwrap();
        let report = repairs.report();
        assert_eq!((report.samples, report.images, report.lost_images), (2, 2, 0));
        let named: Vec<_> = report
            .first
            .iter()
            .map(|r| (r.view, r.light, r.channel, r.x, r.y, r.value.as_str()))
            .collect();
        assert_eq!(named, [(1, 2, 'r', 3, 2, "NaN"), (2, 3, 'b', 0, 0, "-inf")]);

        let stored = common::stored(&good, dtype);
        let filled = read(&btf, 5).unwrap();
        for (at, (&filled, &stored)) in filled.iter().zip(&stored).enumerate() {
            if at != nan && at != infinite {
                assert_eq!(f64::from(filled), stored);
            }
        }
        let around = [(2, 1), (3, 1), (4, 1), (2, 2), (4, 2), (2, 3), (3, 3), (4, 3)];
        let mean = around
            .iter()
            .map(|&(x, y)| stored[index(SHAPE, 1, 2, 0, x, y)])
            .sum::<f64>()
            / 8.0;
        assert!((f64::from(filled[nan]) - mean).abs() < 1e-6);
        assert_eq!(repairs.report(), report, "reading again counts nothing again");
    }
}

#[test]
fn lost_images_come_from_the_nearest_light_and_then_view() {
    // The directions of the tests begin at the normal and go round at nearly the same height, so the nearest one
    // is the next or the last by its angle, not by its number.
    let shape = Shape { lights: 8, ..SHAPE };
    let directions = sampling(shape.views, shape.lights);
    let nearest = |of: &[tileset::Direction], to: usize, except: &[usize]| {
        let vectors: Vec<[f64; 3]> = of.iter().map(|direction| direction.to_vector()).collect();
        let cosine = |i: usize| (0..3).map(|k| vectors[i][k] * vectors[to][k]).sum::<f64>();
        (0..of.len())
            .filter(|i| *i != to && !except.contains(i))
            .max_by(|&a, &b| cosine(a).total_cmp(&cosine(b)))
            .unwrap()
    };
    let good = material(shape, 3, 0.1, 2);
    let mut harmed = good.clone();
    // All of view 0, light 2; and of its nearest, so that the second nearest is taken; green only.
    let first = nearest(&directions.lights, 2, &[]);
    let second = nearest(&directions.lights, 2, &[first]);
    for channel in 0..3 {
        harmed[plane(shape, 0, 2, channel)].fill(f32::NAN);
    }
    harmed[plane(shape, 0, first, 1)].fill(f32::INFINITY);
    // And all of view 1.
    for light in 0..shape.lights {
        for channel in 0..3 {
            harmed[plane(shape, 1, light, channel)].fill(-2e12);
        }
    }
    let view = nearest(&directions.views, 1, &[]);
    assert_eq!(view, 2, "a view without holes");
    for lent in [true, false] {
        for step in [1, 5, 24] {
            let (btf, repairs) = in_memory(shape, &harmed, lent).repaired();
            let filled = read(&btf, step).unwrap();
            for (channel, from) in [(0, first), (1, second), (2, first)] {
                let (to, from) = (plane(shape, 0, 2, channel), plane(shape, 0, from, channel));
                assert_eq!(filled[to], good[from], "channel {channel}");
            }
            for light in 0..shape.lights {
                let (to, from) = (plane(shape, 1, light, 0), plane(shape, view, light, 0));
                assert_eq!(filled[to], good[from], "light {light}");
            }
            let report = repairs.report();
            let texels = shape.columns() as u64;
            assert_eq!(report.samples, texels * (3 + 1 + 3 * shape.lights as u64));
            assert_eq!((report.images, report.lost_images), (10, 10));
            assert_eq!(report.first.len(), 8);
            let text = report.to_string();
            assert!(text.contains("in 10 images, 10 of them"), "{text}");
            assert!(
                text.contains("the first is inf at view 0, light 1, channel g"),
                "{text}"
            );
        }
    }
}

#[test]
fn what_cannot_be_filled_is_an_error() {
    // A broken camera and a broken lamp: the image that both share is taken from another view and light.
    let mut samples = material(SHAPE, 3, 0.1, 3);
    for (view, light) in (0..3).flat_map(|view| (0..4).map(move |light| (view, light))) {
        if view == 1 || light == 2 {
            samples[index(SHAPE, view, light, 0, 0, 0)..][..3 * SHAPE.columns()].fill(f32::NAN);
        }
    }
    let (btf, repairs) = in_memory(SHAPE, &samples, false).repaired();
    assert!(read(&btf, 3).unwrap().iter().all(|sample| sample.is_finite()));
    assert_eq!(repairs.report().lost_images, 4 + 2);

    // Without a single blue sample there is nothing to take.
    for image in 0..12 {
        samples[image * 3 * SHAPE.columns()..][2 * SHAPE.columns()..3 * SHAPE.columns()].fill(f32::NAN);
    }
    let (btf, _) = in_memory(SHAPE, &samples, true).repaired();
    let error = read(&btf, 12).unwrap_err().to_string();
    assert!(error.contains("channel b"), "{error}");
    assert!(error.contains("image number"), "{error}");
    assert!(error.contains("memory:"), "{error}");
}

#[test]
fn good_samples_are_lent_as_they_lie_in_the_file() {
    let samples = material(SHAPE, 3, 0.1, 4);
    let folder = tempfile::tempdir().unwrap();
    let path = write_btf(folder.path(), SHAPE, Dtype::F16, &samples);
    let (btf, repairs) = Btf::open(&path).unwrap().repaired();
    let mut buffer = Vec::new();
    for _ in 0..2 {
        let Samples::F16(lent) = btf.samples(0..12, &mut buffer).unwrap() else {
            panic!("half floats are not converted");
        };
        assert!(lent.iter().zip(&samples).all(|(&a, &b)| a == f16::from_f32(b)));
    }
    assert_eq!(buffer.capacity(), 0);
    assert_eq!(repairs.report(), RepairReport::default());
    assert_eq!(repairs.report().to_string(), "repaired 0 samples in 0 images");
}

/// What `read` gives and what is counted, in several orders and ways of reading.
fn ways(shape: Shape, samples: &[f32]) -> Vec<(Vec<f32>, RepairReport)> {
    let finish = |samples: Vec<f32>, repairs: &Repairs| (samples, repairs.report());
    let mut results = Vec::new();
    for lent in [true, false] {
        for step in [1, 4, 100] {
            let (btf, repairs) = in_memory(shape, samples, lent).repaired();
            results.push(finish(read(&btf, step).unwrap(), &repairs));
        }
        // The last image first.
        let (btf, repairs) = in_memory(shape, samples, lent).repaired();
        let (mut all, mut buffer) = (Vec::new(), Vec::new());
        for image in (0..btf.image_count()).rev() {
            let found = btf.samples(image..image + 1, &mut buffer).unwrap();
            let mut one = vec![0.0; found.len()];
            found.to_f32(&mut one);
            all.splice(0..0, one);
        }
        results.push(finish(all, &repairs));
    }
    results
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn whatever_is_missing_is_filled_within_range_and_the_rest_stays(
        (views, lights) in (1usize..4, 1usize..4),
        (width, height) in (1usize..9, 1usize..9),
        holes in prop::collection::vec((any::<prop::sample::Index>(), 1usize..200), 0..6),
        seed in any::<u64>(),
    ) {
        let shape = Shape { views, lights, width, height };
        let good = material(shape, 3, 0.1, seed);
        let mut harmed = good.clone();
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e13, -1e20];
        for (number, (at, length)) in holes.iter().enumerate() {
            let at = at.index(harmed.len());
            let end = harmed.len().min(at + length);
            harmed[at..end].fill(bad[number % bad.len()]);
        }
        let is_good = |sample: f32| sample.abs() <= 1e12;
        // One good sample in each channel.
        for channel in 0..3 {
            let at = index(shape, 0, 0, channel, 0, 0);
            harmed[at] = good[at];
        }
        let results = ways(shape, &harmed);
        for result in &results[1..] {
            prop_assert_eq!(result, &results[0]);
        }
        let (filled, report) = &results[0];
        prop_assert_eq!(report.samples as usize, harmed.iter().filter(|s| !is_good(**s)).count());
        for (row, (filled, harmed)) in filled.chunks(width * height).zip(harmed.chunks(width * height)).enumerate() {
            // The range of all good samples of this channel.
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for other in (row % 3..shape.rows()).step_by(3) {
                let plane = &good[other * width * height..][..width * height];
                for &sample in plane {
                    (low, high) = (low.min(sample), high.max(sample));
                }
            }
            for (&filled, &harmed) in filled.iter().zip(harmed) {
                if is_good(harmed) {
                    prop_assert_eq!(filled, harmed);
                } else {
                    prop_assert!((low..=high).contains(&filled), "{} beyond {}..{}", filled, low, high);
                }
            }
        }
    }
}
