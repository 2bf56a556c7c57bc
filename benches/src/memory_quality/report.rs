//! Results as a table, as CSV, and as one HTML page with all that it shows inside.

use std::fmt::Write;

use engine::gpu::PageFormat;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::chart::{Axes, Series, chart, escape, legend};
use super::shots::name;
use super::{Point, Quality, Results, Shot};

const MIB: f64 = 1048576.0;
/// By share of the components: colours that differ in lightness too.
const COLOURS: [&str; 5] = ["#0969da", "#bf8700", "#8250df", "#1a7f37", "#cf222e"];

/// A figure: its name in tables, its place in CSV, and how it is found.
struct Figure {
    title: &'static str,
    csv: &'static str,
    log_above: Option<f64>,
    of: fn(&Quality) -> f64,
}

const FIGURES: [Figure; 8] = [
    figure(
        "RMSE of radiance, before tone mapping",
        "rmse",
        Some(1e-6),
        |quality| quality.measured.rmse,
    ),
    figure("RMSE of what is shown", "shown_rmse", Some(1e-6), |quality| {
        quality.measured.shown_rmse
    }),
    figure("PSNR of what is shown, dB", "psnr_db", None, |quality| {
        quality.measured.psnr_db
    }),
    figure("SSIM of what is shown", "ssim", None, |quality| {
        quality.measured.ssim
    }),
    figure("FLIP of what is shown", "flip", None, |quality| quality.flip),
    figure("HDR-FLIP, before tone mapping", "hdr_flip", None, |quality| {
        quality.hdr_flip
    }),
    figure("ΔE*ab 1976 of what is shown", "delta_e_76", None, |quality| {
        quality.measured.delta_e_76
    }),
    figure("ΔE 2000 of what is shown", "delta_e_2000", None, |quality| {
        quality.measured.delta_e_2000
    }),
];

const fn figure(
    title: &'static str,
    csv: &'static str,
    log_above: Option<f64>,
    of: fn(&Quality) -> f64,
) -> Figure {
    Figure {
        title,
        csv,
        log_above,
        of,
    }
}

/// A row in Markdown for each point; then what the knee is.
pub fn table(results: &Results) -> String {
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
    let _ = writeln!(text, "\n{}: {}", results.name, summary(results));
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

/// A line for each point; figures against full residency, then (empty where there is none) against the uncompressed BTFs.
pub fn csv(results: &Results) -> String {
    let mut text = String::from(
        "page_format,component_share,components,page_slots,page_bytes,column_bytes,pages_resident,predicted_rms",
    );
    for against in ["full", "reference"] {
        for figure in &FIGURES {
            let _ = write!(text, ",{against}_{}", figure.csv);
        }
    }
    text.push('\n');
    for point in &results.points {
        let setting = &point.setting;
        let format = match setting.format {
            PageFormat::Half => "half",
            PageFormat::Byte => "byte",
        };
        let _ = write!(
            text,
            "{format},{},{},{},{},{},{},{}",
            setting.share,
            4 * u32::from(setting.groups),
            setting.page_slots,
            point.page_bytes,
            point.column_bytes,
            point.pages_resident,
            point.predicted_rms
        );
        for quality in [Some(&point.full), point.reference.as_ref()] {
            for figure in &FIGURES {
                let value = quality.map(figure.of).filter(|value| value.is_finite());
                let _ = write!(
                    text,
                    ",{}",
                    value.map_or_else(String::new, |value| value.to_string())
                );
            }
        }
        text.push('\n');
    }
    text
}

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1480px;margin:2em auto;padding:0 1em;color:#24292f;background:#fff}\
h1,h2{font-weight:500}.row{display:flex;flex-wrap:wrap;gap:14px}figure{margin:0;max-width:100%}img{max-width:100%;display:block}\
figcaption{font-size:13px;color:#57606a;max-width:420px}table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums}\
td,th{padding:2px 9px;text-align:right;border-bottom:1px solid #d0d7de}td:first-child,th:first-child{text-align:left}\
svg{max-width:100%;height:auto}.scroll{overflow-x:auto}";

/// A page that needs nothing else: plots as SVG, pictures inside, no scripts.
pub fn html(results: &Results) -> String {
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>Memory and quality: {name}</title><style>{STYLE}</style><h1>Memory and quality: {name}</h1><p>{}</p>\
         <p>{}×{} pixels on {}. Memory is what pages and columns take on the GPU. The ring marks the knee.</p>",
        escape(&summary(results)),
        results.plan.size.0,
        results.plan.size.1,
        escape(&results.adapter),
        name = escape(&results.name),
    );
    page += "<h2>Pictures</h2><div class=\"row\">";
    for shot in &results.shots {
        page += &picture(results, shot);
    }
    page += "</div><h2>Against full residency</h2>";
    page += &charts(results, |point| Some(&point.full));
    if results.full_reference.is_some() {
        page += "<h2>Against the uncompressed BTFs</h2>";
        page += &charts(results, |point| point.reference.as_ref());
    }
    page += "<h2>Figures</h2><div class=\"scroll\">";
    page += &html_table(&table(results));
    page + "</div></html>\n"
}

fn charts(results: &Results, quality: impl Fn(&Point) -> Option<&Quality>) -> String {
    let mut page = String::new();
    let series = |of: fn(&Quality) -> f64| -> Vec<Series> {
        let mut all = Vec::new();
        for &format in &results.plan.formats {
            for (rank, &share) in results.plan.shares.iter().enumerate() {
                let curve = results.curve(format, share);
                let groups = curve.map(|(_, point)| point.setting.groups).max().unwrap_or(0);
                let points = results
                    .curve(format, share)
                    .filter_map(|(_, point)| Some((point.bytes() as f64 / MIB, of(quality(point)?))));
                all.push(Series {
                    name: format!("{}, {} components", name(format), 4 * u32::from(groups)),
                    colour: COLOURS[rank % COLOURS.len()],
                    dashed: format == PageFormat::Byte,
                    points: points.collect(),
                });
            }
        }
        all
    };
    page += &legend(&series(|_| 0.0));
    page += "<div class=\"row\">";
    for figure in &FIGURES {
        let knee = results.knee.map(|at| &results.points[at]);
        let mark = knee.and_then(|point| Some((point.bytes() as f64 / MIB, (figure.of)(quality(point)?))));
        let axes = Axes {
            title: figure.title,
            x: "MiB on the GPU",
            log_above: figure.log_above,
        };
        page += &chart(&axes, &series(figure.of), mark);
    }
    page + "</div>"
}

fn picture(results: &Results, shot: &Shot) -> String {
    let mut caption = escape(&shot.label);
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
    let mut figure = format!(
        "<figure><img alt=\"{}\" src=\"{}\">",
        escape(&shot.label),
        data_uri(shot.size, shot.shown.as_flattened())
    );
    if let Some(error) = &shot.error {
        let against = if shot.point.is_some() {
            "full residency"
        } else {
            "the uncompressed BTFs"
        };
        let coloured: Vec<u8> = error.iter().flat_map(|flip| error_colour(*flip)).collect();
        let _ = write!(
            figure,
            "<img alt=\"FLIP, {}\" src=\"{}\">",
            escape(&shot.label),
            data_uri(shot.size, &coloured)
        );
        let _ = write!(
            caption,
            ". Below: FLIP against {against}, violet 0 to yellow {:.2}",
            ERROR_TO
        );
    }
    format!("{figure}<figcaption>{caption}</figcaption></figure>")
}

/// FLIP of the last colour of error maps: beyond a half a picture is wrong, by how much hardly matters.
const ERROR_TO: f64 = 0.5;

fn error_colour(flip: u8) -> [u8; 3] {
    // The scale of mips has eight steps.
    engine::Overlay::Mip.colour(f64::from(flip) / 255.0 / ERROR_TO * 8.0)
}

/// A PNG that a page carries with it.
fn data_uri((width, height): (u32, u32), rgb: &[u8]) -> String {
    let mut png = Vec::new();
    match PngEncoder::new(&mut png).write_image(rgb, width, height, ExtendedColorType::Rgb8) {
        Ok(()) => format!("data:image/png;base64,{}", base64(&png)),
        Err(_) => String::new(), // memory takes all that is written; sizes are those of pictures
    }
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let at = |index: usize| u32::from(three.get(index).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for digit in 0..4 {
            let used = digit <= three.len();
            let value = (bits >> (18 - 6 * digit)) as usize & 63;
            text.push(if used { DIGITS[value].into() } else { '=' });
        }
    }
    text
}

/// The table of a text in Markdown, as HTML; what follows it is left out.
fn html_table(markdown: &str) -> String {
    let mut html = String::from("<table>");
    let rows = markdown.lines().take_while(|line| line.starts_with('|'));
    for (row, line) in rows.enumerate().filter(|(row, _)| *row != 1) {
        let cell = if row == 0 { "th" } else { "td" };
        html += "<tr>";
        for text in line.trim_matches('|').split('|') {
            let _ = write!(html, "<{cell}>{}</{cell}>", escape(text.trim()));
        }
        html += "</tr>";
    }
    html + "</table>"
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 4648, section 10.
    #[test]
    fn base64_has_the_published_values() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn tables_become_html() {
        let html = html_table("| a | b |\n|---|---:|\n| 1 < 2 | x |\n\nafter");
        assert_eq!(
            html,
            "<table><tr><th>a</th><th>b</th></tr><tr><td>1 &lt; 2</td><td>x</td></tr></table>"
        );
    }
}
