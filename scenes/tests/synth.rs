//! What everyone may rely on who uses synthesized materials, on small pictures.

use half::f16;
use scenes::synth::{Sampling, SynthOptions, SynthReport, materials, synthesize};
use std::f64::consts::PI;
use tileset::Direction;

fn degrees(theta: f64, phi: f64) -> Direction {
    Direction {
        theta: theta.to_radians(),
        phi: phi.to_radians(),
    }
}

/// A whole BTF, `[view][light][rgb][y][x]`.
struct Btf {
    size: usize,
    lights: usize,
    samples: Vec<f32>,
    report: SynthReport,
}

impl Btf {
    fn new(material: &str, options: &SynthOptions) -> Btf {
        let mut samples = Vec::new();
        let mut sink = |_: usize, block: &[f16]| {
            samples.extend(block.iter().map(|v| v.to_f32()));
            Ok(())
        };
        let report = synthesize(material, options, &mut sink, &|_, _| ()).unwrap();
        Btf {
            size: options.size as usize,
            lights: options.lights.len(),
            samples,
            report,
        }
    }

    fn image(&self, view: usize, light: usize, channel: usize) -> &[f32] {
        let area = self.size * self.size;
        &self.samples[((view * self.lights + light) * 3 + channel) * area..][..area]
    }

    fn mean(&self, view: usize, light: usize) -> f64 {
        let image = self.image(view, light, 1);
        image.iter().map(|v| f64::from(*v)).sum::<f64>() / image.len() as f64
    }
}

fn options(size: u32, views: &[Direction], lights: &[Direction]) -> SynthOptions {
    SynthOptions {
        size,
        views: views.to_vec(),
        lights: lights.to_vec(),
        ..SynthOptions::default()
    }
}

fn names() -> impl Iterator<Item = &'static str> {
    materials().iter().map(|m| m.name)
}

#[test]
fn at_least_six_materials_are_described() {
    assert!(materials().len() >= 6);
    assert!(
        materials()
            .iter()
            .all(|m| !m.name.is_empty() && m.description.len() > 10)
    );
}

#[test]
fn the_same_for_any_number_of_threads_and_different_for_another_seed() {
    let views = [degrees(0.0, 0.0), degrees(60.0, 70.0)];
    let lights = [degrees(30.0, 10.0), degrees(75.0, 200.0), degrees(45.0, 300.0)];
    for name in names() {
        let one = SynthOptions {
            threads: Some(1),
            ..options(24, &views, &lights)
        };
        let three = SynthOptions {
            threads: Some(3),
            ..one.clone()
        };
        let other = SynthOptions {
            seed: 2,
            ..one.clone()
        };
        let (one, three, other) = (
            Btf::new(name, &one),
            Btf::new(name, &three),
            Btf::new(name, &other),
        );
        assert!(
            one.samples == three.samples,
            "{name} depends on the number of threads"
        );
        assert_eq!(one.report.shadow_rays, three.report.shadow_rays, "{name}");
        let changed = one
            .samples
            .iter()
            .zip(&other.samples)
            .filter(|(a, b)| a != b)
            .count();
        assert!(
            changed > one.samples.len() / 4,
            "{name}: only {changed} samples depend on the seed"
        );
    }
}

#[test]
fn a_view_does_not_depend_on_the_views_before_it() {
    let (a, b) = (degrees(0.0, 0.0), degrees(60.0, 70.0));
    let lights = [degrees(30.0, 10.0)];
    for name in ["studs", "wool"] {
        let both = Btf::new(name, &options(16, &[a, b], &lights));
        let alone = Btf::new(name, &options(16, &[b], &lights));
        assert!(both.samples[3 * 256..] == alone.samples[..], "{name}");
    }
}

#[test]
fn blocks_come_in_order_and_whole() {
    for (size, lights) in [(1, 1), (7, 3), (33, 9)] {
        let lights: Vec<_> = (0..lights).map(|n| degrees(8.0 * f64::from(n), 20.0)).collect();
        let views: Vec<_> = (0..5).map(|n| degrees(15.0 * f64::from(n), 50.0)).collect();
        let (mut order, told) = (Vec::new(), std::cell::RefCell::new(Vec::new()));
        let mut sink = |view: usize, block: &[f16]| {
            assert_eq!(block.len(), lights.len() * 3 * (size * size) as usize);
            order.push(view);
            Ok(())
        };
        let progress = |done: usize, total: usize| told.borrow_mut().push((done, total));
        let report = synthesize("leather", &options(size, &views, &lights), &mut sink, &progress).unwrap();
        assert_eq!(order, [0, 1, 2, 3, 4]);
        assert_eq!(*told.borrow(), [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]);
        assert_eq!(report.samples, u64::from(size * size) * 5 * lights.len() as u64);
        assert_eq!(report.primary_rays, u64::from(size * size) * 5 * 4);
        assert!(report.shadow_rays > 0 && report.bounce_rays > 0 && report.rays_per_second() > 0.0);
    }
}

#[test]
fn samples_are_finite_and_not_negative_and_the_report_knows_them() {
    let views = [degrees(0.0, 0.0), degrees(75.0, 15.0), degrees(75.0, 200.0)];
    let lights = [
        degrees(0.0, 0.0),
        degrees(75.0, 15.0),
        degrees(75.0, 195.0),
        degrees(88.0, 90.0),
    ];
    for name in names() {
        let btf = Btf::new(name, &options(32, &views, &lights));
        assert!(btf.samples.iter().all(|v| v.is_finite() && *v >= 0.0), "{name}");
        let max = btf.samples.iter().copied().fold(0.0, f32::max);
        assert!((btf.report.max_value - max).abs() <= max * 1e-3, "{name}");
        for channel in 0..3 {
            let images = (0..12).map(|n| btf.image(n / 4, n % 4, channel));
            let mean = images.flatten().map(|v| f64::from(*v)).sum::<f64>() / (12.0 * 1024.0);
            assert!((btf.report.mean_rgb[channel] / mean - 1.0).abs() < 1e-3, "{name}");
        }
    }
}

#[test]
fn the_cosine_is_in_the_samples() {
    let lights = [
        degrees(0.0, 0.0),
        degrees(85.0, 0.0),
        degrees(89.9, 0.0),
        degrees(100.0, 0.0),
    ];
    for name in names() {
        let btf = Btf::new(name, &options(24, &[degrees(0.0, 0.0)], &lights));
        let means: Vec<f64> = (0..4).map(|light| btf.mean(0, light)).collect();
        assert!(
            means[1] < 0.5 * means[0] && means[2] < 0.35 * means[0],
            "{name}: {means:?}"
        );
        assert_eq!(means[3], 0.0, "{name}: nothing arrives from below");
    }
}

#[test]
fn highlights_of_the_studs_are_far_above_one() {
    let btf = Btf::new(
        "studs",
        &options(
            64,
            &[degrees(15.0, 0.0)],
            &[degrees(15.0, 180.0), degrees(45.0, 90.0)],
        ),
    );
    assert!(btf.report.max_value > 5.0, "{}", btf.report.max_value);
    let cloth = Btf::new(
        "cloth",
        &options(64, &[degrees(15.0, 0.0)], &[degrees(15.0, 180.0)]),
    );
    assert!(cloth.report.max_value < 3.0, "{}", cloth.report.max_value);
}

/// Energy: of what one light brings, the share that leaves through the reference plane in all directions.
#[test]
fn no_more_light_leaves_than_arrives() {
    let (rings, around) = (6, 8);
    let mut views = Vec::new();
    for ring in 0..rings {
        // Middles of rings of equal ∫ cos θ dω, so that all views count the same.
        let theta = ((f64::from(ring) + 0.5) / f64::from(rings)).sqrt().asin();
        views.extend((0..around).map(|k| Direction {
            theta,
            phi: 2.0 * PI * f64::from(k) / f64::from(around),
        }));
    }
    let lights = [degrees(10.0, 40.0), degrees(60.0, 40.0)];
    for name in names() {
        let btf = Btf::new(name, &options(16, &views, &lights));
        for (light, direction) in lights.iter().enumerate() {
            let leaving: f64 =
                (0..views.len()).map(|view| btf.mean(view, light)).sum::<f64>() / views.len() as f64;
            let albedo = leaving / direction.theta.cos();
            assert!((0.02..1.0).contains(&albedo), "{name}, light {light}: {albedo}");
        }
    }
}

#[test]
fn the_bounce_adds_light_and_only_light() {
    let views = [degrees(0.0, 0.0), degrees(45.0, 30.0)];
    let with = options(24, &views, &[degrees(60.0, 30.0)]);
    let without = SynthOptions {
        interreflection: false,
        ..with.clone()
    };
    let (with, without) = (Btf::new("sponge", &with), Btf::new("sponge", &without));
    assert_eq!(without.report.bounce_rays, 0);
    assert!(with.samples.iter().zip(&without.samples).all(|(a, b)| a >= b));
    assert!(with.mean(0, 0) > 1.05 * without.mean(0, 0));
    assert!(
        with.mean(0, 0) < 2.0 * without.mean(0, 0),
        "one bounce stays below the direct light"
    );
}

/// Left and right edges, and upper and lower ones, differ no more than neighbours inside the picture do.
#[test]
fn edges_meet() {
    let views = [degrees(0.0, 0.0), degrees(60.0, 37.0)];
    let lights = [degrees(45.0, 75.0)];
    for name in names() {
        let btf = Btf::new(name, &options(64, &views, &lights));
        for view in 0..2 {
            let image = btf.image(view, 0, 1);
            let across = |x: usize| {
                (0..64)
                    .map(|y| (image[y * 64 + x] - image[y * 64 + (x + 1) % 64]).abs())
                    .sum::<f32>()
            };
            let down = |y: usize| {
                (0..64)
                    .map(|x| (image[y * 64 + x] - image[(y + 1) % 64 * 64 + x]).abs())
                    .sum::<f32>()
            };
            for (what, step) in [("columns", &across as &dyn Fn(usize) -> f32), ("rows", &down)] {
                let inside: Vec<f32> = (0..63).map(step).collect();
                let mean = inside.iter().sum::<f32>() / 63.0;
                let largest = inside.iter().copied().fold(0.0, f32::max);
                assert!(
                    step(63) <= largest.max(1.5 * mean),
                    "{name}: {what} {} {mean} {largest}",
                    step(63)
                );
            }
        }
    }
}

/// Shift that best aligns `b` to `a`, along x if `horizontal`, else along y: b(x + shift) ≈ a(x).
fn best_shift(a: &[f32], b: &[f32], size: i32, horizontal: bool) -> i32 {
    let score = |shift: i32| -> f64 {
        let mut sum = 0.0;
        for (y, x) in (0..size).flat_map(|y| (0..size).map(move |x| (y, x))) {
            let (dx, dy) = if horizontal { (shift, 0) } else { (0, shift) };
            let (mx, my) = ((x + dx).rem_euclid(size), (y + dy).rem_euclid(size));
            sum += f64::from(a[(y * size + x) as usize] * b[(my * size + mx) as usize]);
        }
        sum
    };
    (-size / 4..=size / 4)
        .max_by(|&a, &b| score(a).total_cmp(&score(b)))
        .unwrap()
}

/// The studs' caps stand above the reference plane: seen from the right they move to the left, seen from the
/// top of the picture they move down.
#[test]
fn views_shear_the_right_way() {
    let light = [degrees(0.0, 0.0)];
    let views = [
        degrees(0.0, 0.0),
        degrees(55.0, 0.0),
        degrees(55.0, 90.0),
        degrees(55.0, 180.0),
    ];
    let btf = Btf::new("studs", &options(64, &views, &light));
    // Brass is yellow, felt is red.
    let picture = |view: usize| -> Vec<f32> {
        let colors = btf.image(view, 0, 1).iter().zip(btf.image(view, 0, 0));
        colors
            .map(|(green, red)| if green / red > 0.4 { 1.0 } else { -1.0 })
            .collect()
    };
    let straight = picture(0);
    assert!(
        best_shift(&straight, &picture(1), 64, true) < 0,
        "seen from the right"
    );
    assert!(
        best_shift(&straight, &picture(3), 64, true) > 0,
        "seen from the left"
    );
    assert!(
        best_shift(&straight, &picture(2), 64, false) > 0,
        "seen from the top of the picture"
    );
}

/// Shadows of the studs fall on the felt away from the light.
#[test]
fn shadows_fall_away_from_the_light() {
    let lights = [degrees(0.0, 0.0), degrees(45.0, 0.0), degrees(45.0, 90.0)];
    let options = SynthOptions {
        interreflection: false,
        ..options(64, &[degrees(0.0, 0.0)], &lights)
    };
    let btf = Btf::new("studs", &options);
    let bright: Vec<f32> = btf
        .image(0, 0, 1)
        .iter()
        .map(|v| if *v > 0.06 { 1.0 } else { 0.0 })
        .collect();
    let shadow = |light: usize| -> Vec<f32> {
        let red = btf.image(0, light, 0);
        red.iter()
            .zip(&bright)
            .map(|(v, stud)| if *stud == 0.0 && *v < 1e-3 { 1.0 } else { 0.0 })
            .collect()
    };
    let count = |picture: &[f32]| picture.iter().sum::<f32>();
    assert!(count(&shadow(1)) > 100.0, "{}", count(&shadow(1)));
    assert!(
        best_shift(&bright, &shadow(1), 64, true) < 0,
        "light from the right, shadow to the left"
    );
    assert!(
        best_shift(&bright, &shadow(2), 64, false) > 0,
        "light from the top, shadow downwards"
    );
}

#[test]
fn both_samplings_work_as_they_come() {
    let views = Sampling::Bonn81.directions();
    let lights = Sampling::Ubo151.directions();
    let btf = Btf::new("leather", &options(2, &views, &lights));
    assert_eq!(btf.samples.len(), 81 * 151 * 3 * 4);
}

#[test]
fn wrong_options_are_named() {
    let good = options(4, &[degrees(0.0, 0.0)], &[degrees(0.0, 0.0)]);
    let message = |material: &str, options: &SynthOptions| {
        let mut sink = |_: usize, _: &[f16]| -> std::io::Result<()> { panic!("nothing may be written") };
        synthesize(material, options, &mut sink, &|_, _| ())
            .unwrap_err()
            .to_string()
    };
    assert!(
        message("velvet", &good).contains("cloth"),
        "the error lists what there is"
    );
    let with = |change: fn(&mut SynthOptions)| {
        let mut options = good.clone();
        change(&mut options);
        message("cloth", &options)
    };
    assert!(with(|o| o.size = 0).contains("size 0"));
    assert!(with(|o| o.size = 1 << 20).contains("size 1048576"));
    assert!(with(|o| o.views.clear()).contains("0 view directions"));
    assert!(with(|o| o.lights.clear()).contains("0 light directions"));
    assert!(with(|o| o.samples_per_texel = 0).contains("0 samples"));
    assert!(with(|o| o.views[0].theta = 1.6).contains("above the horizon"));
    assert!(with(|o| o.lights[0].phi = f64::NAN).contains("not finite"));
    assert!(with(|o| (o.size, o.lights) = (2048, vec![o.lights[0]; 1000])).contains("bytes"));
}

#[test]
fn a_failing_sink_ends_the_work() {
    let views: Vec<_> = (0..50).map(|n| degrees(f64::from(n), 0.0)).collect();
    let mut calls = 0;
    let mut sink = |view: usize, _: &[f16]| {
        calls += 1;
        if view == 2 {
            Err(std::io::Error::other("disk full"))
        } else {
            Ok(())
        }
    };
    let error = synthesize(
        "sponge",
        &options(8, &views, &[degrees(0.0, 0.0)]),
        &mut sink,
        &|_, _| (),
    )
    .unwrap_err();
    assert_eq!(calls, 3);
    assert!(
        matches!(&error, scenes::Error::Io { .. }) && error.to_string().contains("disk full"),
        "{error}"
    );
}

#[test]
fn some_texels_under_some_lights_are_those_of_the_whole() {
    let views = [degrees(0.0, 0.0), degrees(60.0, 40.0)];
    let lights: Vec<Direction> = (0..11)
        .map(|n| degrees(7.0 * f64::from(n), 33.0 * f64::from(n)))
        .collect();
    let options = options(24, &views, &lights);
    let whole = Btf::new("gravel", &options);
    let texels: Vec<u32> = (0..100).map(|n| n * 41 % 576).collect();
    let few = 5;
    scenes::synth::sample("gravel", &options, |sampler| {
        let mut block = vec![f16::ZERO; lights.len() * 3 * texels.len()];
        sampler.some(1, &texels, &mut block);
        for (plane, values) in block.chunks(texels.len()).enumerate() {
            let image = whole.image(1, plane / 3, plane % 3);
            assert!(
                texels
                    .iter()
                    .zip(values)
                    .all(|(&texel, v)| v.to_f32() == image[texel as usize])
            );
        }
        sampler.narrow(few);
        for view in 0..2 {
            let mut block = vec![f16::ZERO; few * 3 * 576];
            sampler.all(view, &mut block);
            for (plane, values) in block.chunks(576).enumerate() {
                let image = whole.image(view, plane / 3, plane % 3);
                assert!(
                    values
                        .iter()
                        .zip(image)
                        .all(|(v, of_whole)| v.to_f32() == *of_whole)
                );
            }
        }
        assert!(sampler.report().shadow_rays < whole.report.shadow_rays);
    })
    .unwrap();
}
