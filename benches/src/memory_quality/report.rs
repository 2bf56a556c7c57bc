//! Results as a table and as a report.

use std::fmt::Write;

use engine::gpu::PageFormat;

use super::shots::name;
use super::{Point, Quality, Results, Setting, Shot};
use crate::report::chart::{BLUE, GREEN, OCHRE, Panel, RED, RGBColor, Scale, Series, VIOLET, chart};
use crate::report::{Image, Report};

const MIB: f64 = 1048576.0;
/// By share of the components.
const COLOURS: [RGBColor; 5] = [BLUE, OCHRE, VIOLET, GREEN, RED];

/// A figure: its name in plots, a short one, and how it is found.
struct Figure {
    title: &'static str,
    short: &'static str,
    y: Scale,
    of: fn(&Quality) -> f64,
}

const FIGURES: [Figure; 8] = [
    figure(
        "RMSE of radiance, before tone mapping",
        "rmse",
        Scale::Log { least: Some(1e-6) },
        |quality| quality.measured.rmse,
    ),
    figure(
        "RMSE of what is shown",
        "shown_rmse",
        Scale::Log { least: Some(1e-6) },
        |quality| quality.measured.shown_rmse,
    ),
    figure("PSNR of what is shown, dB", "psnr_db", Scale::Linear, |quality| {
        quality.measured.psnr_db
    }),
    figure("SSIM of what is shown", "ssim", Scale::Linear, |quality| {
        quality.measured.ssim
    }),
    figure("FLIP of what is shown", "flip", Scale::Linear, |quality| {
        quality.flip
    }),
    figure(
        "HDR-FLIP, before tone mapping",
        "hdr_flip",
        Scale::Linear,
        |quality| quality.hdr_flip,
    ),
    figure(
        "ΔE*ab 1976 of what is shown",
        "delta_e_76",
        Scale::Linear,
        |quality| quality.measured.delta_e_76,
    ),
    figure(
        "ΔE 2000 of what is shown",
        "delta_e_2000",
        Scale::Linear,
        |quality| quality.measured.delta_e_2000,
    ),
];

const fn figure(title: &'static str, short: &'static str, y: Scale, of: fn(&Quality) -> f64) -> Figure {
    Figure { title, short, y, of }
}

/// [`rows`], then what the knee is.
pub fn table(results: &Results) -> String {
    format!("{}\n{}: {}\n", rows(results), results.name, summary(results))
}

/// A row in Markdown for each point.
pub fn rows(results: &Results) -> String {
    let mut text = String::from(
        "| pages are | components | slots | MiB | of full | RMSE | PSNR | SSIM | FLIP | ΔE 2000 | against the BTF: RMSE | SSIM | FLIP |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for (at, point) in results.points.iter().enumerate() {
        let Quality { measured, flip, .. } = &point.full;
        let reference = point.reference.as_ref().map_or("– | – | –".into(), |quality| {
            format!(
                "{:.4} | {:.3} | {:.4}",
                quality.measured.rmse, quality.measured.ssim, quality.flip
            )
        });
        let _ = writeln!(
            text,
            "| {}{} | {} | {} | {:.2} | {:.0} % | {:.4} | {:.1} | {:.3} | {flip:.4} | {:.2} | {reference} |",
            name(point.setting.format),
            if results.knee == Some(at) { ", knee" } else { "" },
            4 * u32::from(point.setting.groups),
            point.setting.page_slots,
            point.bytes() as f64 / MIB,
            100.0 * point.bytes() as f64 / results.full_bytes.max(1) as f64,
            measured.rmse,
            measured.psnr_db,
            measured.ssim,
            measured.delta_e_2000,
        );
    }
    text
}

fn summary(results: &Results) -> String {
    let mut text = format!(
        "The view wants {} pages of {} streamed materials, {:.1} MiB with their columns.",
        results.pages_wanted,
        results.materials,
        results.full_bytes as f64 / MIB
    );
    match results.knee.map(|at| &results.points[at]) {
        Some(point) => {
            let _ = write!(
                text,
                " The knee is at {:.2} MiB ({} slots, {:.0} % of full): FLIP {:.4}, SSIM {:.3} against full residency.",
                point.bytes() as f64 / MIB,
                point.setting.page_slots,
                100.0 * point.bytes() as f64 / results.full_bytes.max(1) as f64,
                point.full.flip,
                point.full.measured.ssim
            );
        }
        None => text += " The curve has no knee.",
    }
    if let Some(quality) = &results.full_reference {
        let _ = write!(
            text,
            " Full residency against the uncompressed BTFs: RMSE {:.4}, PSNR {:.1} dB, SSIM {:.3}, FLIP {:.4}, ΔE 2000 {:.2}.",
            quality.measured.rmse,
            quality.measured.psnr_db,
            quality.measured.ssim,
            quality.flip,
            quality.measured.delta_e_2000
        );
    }
    text
}

/// Everything, to read: pictures, curves, figures.
pub fn report(results: &Results) -> Report {
    let (width, height) = results.plan.size;
    let mut report = Report::new(format!("Memory and quality: {}", results.name))
        .text(summary(results))
        .text(format!(
            "{width}×{height} pixels. Memory is what pages and columns take on the GPU. The ring marks the knee."
        ))
        .heading("Pictures")
        .figures(results.shots.iter().map(|shot| picture(results, shot)).collect())
        .heading("Against full residency")
        .plots(charts(results, |point| Some(&point.full)));
    if results.full_reference.is_some() {
        report = report
            .heading("Against the uncompressed BTFs")
            .plots(charts(results, |point| point.reference.as_ref()));
    }
    report.heading("Figures").text(rows(results))
}

/// One figure as SVG: FLIP over memory, against the uncompressed BTFs where they are known.
pub fn plot(results: &Results) -> String {
    let against: fn(&Point) -> Option<&Quality> = match results.full_reference {
        Some(_) => |point| point.reference.as_ref(),
        None => |point| Some(&point.full),
    };
    let flip = FIGURES.iter().position(|figure| figure.short == "flip");
    draw(results, &FIGURES[flip.unwrap_or(0)], against)
}

/// A chart for each of [`FIGURES`].
fn charts(results: &Results, quality: fn(&Point) -> Option<&Quality>) -> Vec<String> {
    let charts = FIGURES.iter().map(|figure| draw(results, figure, quality));
    charts.collect()
}

fn draw(results: &Results, figure: &Figure, quality: fn(&Point) -> Option<&Quality>) -> String {
    let at = |point: &Point| Some((point.bytes() as f64 / MIB, (figure.of)(quality(point)?)));
    let mut series = Vec::new();
    for &format in &results.plan.formats {
        for (rank, &share) in results.plan.shares.iter().enumerate() {
            let curve = || results.curve(format, share).map(|(_, point)| point);
            let groups = curve().map(|point| point.setting.groups).max().unwrap_or(0);
            let name = format!("{}, {} components", name(format), 4 * u32::from(groups));
            series.push(Series {
                dashed: format == PageFormat::Byte,
                radius: 2.5,
                ..Series::new(
                    name,
                    COLOURS[rank % COLOURS.len()],
                    curve().filter_map(at).collect(),
                )
            });
        }
    }
    let panel = Panel {
        title: String::new(),
        x_name: "MiB on the GPU".into(),
        x: Scale::Log { least: None },
        y: figure.y,
        series,
        mark: results.knee.and_then(|knee| at(&results.points[knee])),
    };
    chart(figure.title, 1, &[panel])
}

fn picture(results: &Results, shot: &Shot) -> (Vec<Image>, String) {
    let mut caption = shot.label.clone();
    if let Some(point) = shot.point.map(|at| &results.points[at]) {
        let _ = write!(
            caption,
            ": {:.2} MiB, {} slots, {} components; FLIP {:.4}, SSIM {:.3}, PSNR {:.1} dB, ΔE 2000 {:.2} against full residency",
            point.bytes() as f64 / MIB,
            point.setting.page_slots,
            4 * u32::from(point.setting.groups),
            point.full.flip,
            point.full.measured.ssim,
            point.full.measured.psnr_db,
            point.full.measured.delta_e_2000
        );
    }
    let mut images = vec![Image {
        label: shot.label.clone(),
        size: shot.size,
        rgb: shot.shown.as_flattened().to_vec(),
    }];
    if let Some(error) = &shot.error {
        let against = if shot.point.is_some() {
            "full residency"
        } else {
            "the uncompressed BTFs"
        };
        images.push(Image {
            label: format!("FLIP, {}", shot.label),
            size: shot.size,
            rgb: error.iter().flat_map(|flip| error_colour(*flip)).collect(),
        });
        let _ = write!(
            caption,
            ". Below: FLIP against {against}, violet 0 to yellow {ERROR_TO:.2}"
        );
    }
    (images, caption)
}

/// The figure of the paper: too small, right, of lower rank with about the same memory, and full; below each its error map, of full residency
/// against the uncompressed BTFs where they are known. `None` where the curve has no knee or there is one rank only.
pub fn side_by_side(results: &Results) -> Option<Image> {
    let right = &results.points[results.knee?].setting;
    let of = |wanted: &dyn Fn(&Shot) -> bool| results.shots.iter().find(|shot| wanted(shot));
    let is = |wanted: fn(&Setting, &Setting) -> bool| {
        of(&|shot| {
            shot.point
                .is_some_and(|at| wanted(&results.points[at].setting, right))
        })
    };
    let shots = [
        is(|setting, right| setting.page_slots < right.page_slots && setting.share == right.share),
        is(|setting, right| setting == right),
        is(|setting, right| setting.share < right.share && setting.format == right.format),
        of(&|shot| shot.point.is_none()),
    ];
    let columns: Vec<Vec<Image>> = shots
        .into_iter()
        .map(|shot| Some(picture(results, shot?).0))
        .collect::<Option<_>>()?;
    let (width, height) = results.plan.size;
    let [across, down] = [columns.len(), columns.iter().map(Vec::len).max()?];
    let full = [
        (width + GAP) * across as u32 - GAP,
        (height + GAP) * down as u32 - GAP,
    ];
    let mut rgb = vec![255; full[0] as usize * full[1] as usize * 3];
    for (column, images) in columns.iter().enumerate() {
        for (row, image) in images.iter().enumerate() {
            let left = column * (width + GAP) as usize;
            let top = row * (height + GAP) as usize;
            for (y, line) in image.rgb.chunks_exact(width as usize * 3).enumerate() {
                let at = ((top + y) * full[0] as usize + left) * 3;
                rgb[at..at + line.len()].copy_from_slice(line);
            }
        }
    }
    Some(Image {
        label: "too small, right, of lower rank, full".into(),
        size: (full[0], full[1]),
        rgb,
    })
}

/// Pixels between the pictures of a figure.
const GAP: u32 = 4;
/// FLIP of the last colour of error maps: beyond a half a picture is wrong, by how much hardly matters.
const ERROR_TO: f64 = 0.5;

fn error_colour(flip: u8) -> [u8; 3] {
    // The scale of mips has eight steps.
    engine::Overlay::Mip.colour(f64::from(flip) / 255.0 / ERROR_TO * 8.0)
}
