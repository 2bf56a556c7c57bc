//! Contact sheets of the procedural materials, as PNG files.
//!
//!     cargo run -p scenes --example material_sheet -- OUT_DIR [--size N] [--seed N] [--threads N] [--measure]
//!         [--variants N] [MATERIAL ...]
//!
//! With --variants: variants.png, the first N variants of the materials in turn, ten in a row.
//!
//! With --measure: no pictures; all 81×81 directions are traced and thrown away, and the speed is printed.
//!
//! Otherwise, per material: NAME.png with eight pairs of view and light, NAME-tiled.png with 2×2 repeats under a
//! slanted light, and one line of numbers. In the sheet, the upper row has the view straight above and lights from
//! above, from the right, from the top of the picture (θ 60°), and from the left (75°); the lower row has the light
//! from the top right at 45° and views from the right at 30, 60 and 75°, and from the top of the picture at 75°.

use scenes::synth::{Style, SynthOptions, materials, synthesize};
use std::path::PathBuf;
use tileset::Direction;

/// Polar angle and azimuth in degrees.
const LIGHTS: [(f64, f64); 5] = [(0.0, 0.0), (60.0, 0.0), (60.0, 90.0), (75.0, 180.0), (45.0, 45.0)];

fn degrees(theta: f64, phi: f64) -> Direction {
    Direction {
        theta: theta.to_radians(),
        phi: phi.to_radians(),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut options = SynthOptions::default();
    let (mut folder, mut names, mut measuring, mut variants) = (None, Vec::new(), false, 0);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--size" => options.size = arguments.next().ok_or("--size needs a number")?.parse()?,
            "--seed" => options.seed = arguments.next().ok_or("--seed needs a number")?.parse()?,
            "--threads" => {
                options.threads = Some(arguments.next().ok_or("--threads needs a number")?.parse()?)
            }
            "--variants" => variants = arguments.next().ok_or("--variants needs a number")?.parse()?,
            "--measure" => measuring = true,
            _ if folder.is_none() => folder = Some(PathBuf::from(argument)),
            _ => names.push(argument),
        }
    }
    let folder =
        folder.ok_or("usage: material_sheet OUT_DIR [--size N] [--seed N] [--measure] [MATERIAL ...]")?;
    if names.is_empty() {
        names = materials().iter().map(|m| m.name.to_string()).collect();
    }
    if measuring {
        return measure(&names, &options);
    }
    std::fs::create_dir_all(&folder)?;
    if variants > 0 {
        return sheet_of_variants(variants, &names, &options, &folder.join("variants.png"));
    }
    options.views = vec![
        degrees(0.0, 0.0),
        degrees(30.0, 0.0),
        degrees(60.0, 0.0),
        degrees(75.0, 0.0),
        degrees(75.0, 90.0),
    ];
    options.lights = LIGHTS.iter().map(|&(theta, phi)| degrees(theta, phi)).collect();
    // The eight pictures as (view, light).
    let cells = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 4), (2, 4), (3, 4), (4, 4)];
    for name in names {
        let size = options.size;
        let mut sheet = image::RgbImage::new(4 * size, 2 * size);
        let mut tiled = image::RgbImage::new(2 * size, 2 * size);
        let mut sink = |view: usize, block: &[half::f16]| {
            let plane = (size * size) as usize;
            let pixel = |light: usize, x: u32, y: u32| {
                let at = |c: usize| block[(light * 3 + c) * plane + (y * size + x) as usize].to_f32();
                image::Rgb(
                    [0, 1, 2].map(|c| display(at(c) / LIGHTS[light].0.to_radians().cos().max(0.4) as f32)),
                )
            };
            for (n, &(_, light)) in cells.iter().enumerate().filter(|(_, cell)| cell.0 == view) {
                let (left, top) = (n as u32 % 4 * size, n as u32 / 4 * size);
                for (x, y) in (0..size).flat_map(|y| (0..size).map(move |x| (x, y))) {
                    sheet.put_pixel(left + x, top + y, pixel(light, x, y));
                }
            }
            if view == 0 {
                for (x, y) in (0..2 * size).flat_map(|y| (0..2 * size).map(move |x| (x, y))) {
                    tiled.put_pixel(x, y, pixel(4, x % size, y % size));
                }
            }
            Ok(())
        };
        let report = synthesize(&name, &options, &mut sink, &|_, _| ())?;
        sheet.save(folder.join(format!("{name}.png")))?;
        tiled.save(folder.join(format!("{name}-tiled.png")))?;
        println!(
            "{name}: {:.1} s (built in {:.1}), {} cells, mean {:.3?}, largest {:.2}",
            report.seconds, report.build_seconds, report.surface_cells, report.mean_rgb, report.max_value
        );
    }
    Ok(())
}

/// The first `count` variants, seen from straight above under a slanted light.
fn sheet_of_variants(
    count: u32,
    names: &[String],
    options: &SynthOptions,
    path: &std::path::Path,
) -> Result<(), Box<dyn std::error::Error>> {
    let size = options.size;
    let mut sheet = image::RgbImage::new(10 * size, count.div_ceil(10) * size);
    for number in 0..count {
        let options = SynthOptions {
            seed: u64::from(number) + 1,
            style: Style::variant(number),
            views: vec![degrees(0.0, 0.0)],
            lights: vec![degrees(45.0, 120.0)],
            ..options.clone()
        };
        let (left, top) = (number % 10 * size, number / 10 * size);
        let mut sink = |_view: usize, block: &[half::f16]| {
            for (at, (x, y)) in (0..size).flat_map(|y| (0..size).map(move |x| (x, y))).enumerate() {
                let plane = (size * size) as usize;
                let pixel = [0, 1, 2].map(|c| display(block[c * plane + at].to_f32() * 1.4));
                sheet.put_pixel(left + x, top + y, image::Rgb(pixel));
            }
            Ok(())
        };
        synthesize(
            &names[number as usize % names.len()],
            &options,
            &mut sink,
            &|_, _| (),
        )?;
    }
    Ok(sheet.save(path)?)
}

/// Traces everything that the default sampling has, for the speed alone.
fn measure(names: &[String], options: &SynthOptions) -> Result<(), Box<dyn std::error::Error>> {
    for name in names {
        let report = synthesize(name, options, &mut |_, _| Ok(()), &|_, _| ())?;
        println!("{name}: {report:.3?}");
        println!(
            "    {:.2} million rays a second, {:.1} million samples a second",
            report.rays_per_second() / 1e6,
            report.samples_per_second() / 1e6
        );
    }
    Ok(())
}

/// sRGB of a radiance factor, a little brighter than it is.
fn display(radiance_factor: f32) -> u8 {
    let value = (radiance_factor * 1.4).clamp(0.0, 1.0);
    let encoded = if value <= 0.003_130_8 {
        12.92 * value
    } else {
        1.055 * value.powf(1.0 / 2.4) - 0.055
    };
    (encoded * 255.0 + 0.5) as u8
}
