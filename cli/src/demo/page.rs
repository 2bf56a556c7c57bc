//! The page that shows the pictures. Static: it opens from the folder, without a server.

use super::report::Report;
use super::shots::Shot;
use crate::bytes::text as size;

const STYLE: &str = "\
body{font:15px/1.5 system-ui,sans-serif;background:#16171a;color:#dcdcdc;max-width:1280px;margin:2em auto;padding:0 1em}\
h1,h2{font-weight:500}.row{display:grid;grid-template-columns:repeat(auto-fit,minmax(300px,1fr));gap:12px}\
figure{margin:0}img{width:100%;display:block;border-radius:3px}figcaption{color:#9a9a9a;font-size:13px;padding:4px 0}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums}td,th{padding:3px 12px;text-align:right}\
td:first-child,th:first-child{text-align:left}tr:nth-child(even){background:#202125}input{width:100%}";

/// Steps through the frames of the flight.
const SCRIPT: &str = "\
const image=document.getElementById('flight'),slider=document.getElementById('time');let playing=true;\
const show=()=>{image.src='pictures/flight_'+String(slider.value).padStart(3,'0')+'.png'};\
slider.oninput=()=>{playing=false;show()};image.onclick=()=>{playing=!playing};\
setInterval(()=>{if(playing){slider.value=(Number(slider.value)+1)%(Number(slider.max)+1);show()}},125);";

/// The whole page.
pub(crate) fn html(report: &Report) -> String {
    let figures = |shots: &[Shot]| shots.iter().map(figure).collect::<String>();
    let last_frame = report.flight.frames.len().saturating_sub(1);
    let picture = |file: &str, caption: &str| {
        format!("<figure><img src=\"pictures/{file}\" alt=\"\"><figcaption>{caption}</figcaption></figure>")
    };
    let largest = report
        .refinement
        .last()
        .map_or("reference.png", |shot| &shot.file);
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width\"><title>Eigentile demo</title><style>{STYLE}</style>\
         <h1>Four materials, streamed</h1>\
         <p>{} of samples in {} of archives, on {}.</p>{}\
         <h2>While bytes arrive</h2><div class=\"row\">{}</div>\
         <h2>Three caches, settled, and the reference</h2><div class=\"row\">{}{}{}</div>\
         <h2>Flight with {} of cache</h2><img id=\"flight\" src=\"pictures/flight_000.png\" alt=\"\">\
         <input id=\"time\" type=\"range\" min=\"0\" max=\"{last_frame}\" value=\"0\">\
         <h2>Figures</h2>{}{}<script>{SCRIPT}</script></html>\n",
        size(report.materials.iter().map(|made| made.btf_bytes).sum()),
        size(report.materials.iter().map(|made| made.archive_bytes).sum()),
        escape(&report.adapter),
        picture(largest, "everything that is in view"),
        figures(&report.refinement),
        figures(&report.caches),
        picture("reference.png", "reference: the uncompressed BTFs, shaded in f64"),
        picture(
            "error.png",
            &format!(
                "error with all bytes; the brightest colour is {:.4} of radiance",
                report.quality.error_map.to
            )
        ),
        size(report.flight.cache_bytes),
        shot_table(report),
        material_table(report),
    )
}

fn figure(shot: &Shot) -> String {
    format!(
        "<figure><img src=\"pictures/{}\" alt=\"\"><figcaption>{}: {} over the wire, RMSE {:.4}, SSIM {:.3}</figcaption></figure>",
        shot.file,
        escape(&shot.label),
        size(shot.wire_bytes),
        shot.quality.rmse,
        shot.quality.ssim
    )
}

fn shot_table(report: &Report) -> String {
    let head = [
        "picture",
        "wire",
        "cache",
        "GPU",
        "pages",
        "columns",
        "predicted error",
        "RMSE",
        "PSNR",
        "SSIM",
        "ΔE2000",
    ];
    let rows = report.refinement.iter().chain(&report.caches).map(|shot| {
        let quality = &shot.quality;
        [
            escape(&shot.label),
            size(shot.wire_bytes),
            size(shot.cache_bytes),
            size(shot.gpu_bytes),
            shot.pages_resident.to_string(),
            shot.columns_resident.to_string(),
            format!("{:.5}", shot.predicted_rms),
            format!("{:.5}", quality.rmse),
            format!("{:.1} dB", quality.psnr_db),
            format!("{:.4}", quality.ssim),
            format!("{:.2}", quality.delta_e_2000),
        ]
    });
    table(&head, rows)
}

fn material_table(report: &Report) -> String {
    let head = ["material", "BTF", "archive", "error"];
    let rows = report.materials.iter().map(|made| {
        let error = format!("{:.2} %", 100.0 * made.total_relative);
        [
            escape(&made.name),
            size(made.btf_bytes),
            size(made.archive_bytes),
            error,
        ]
    });
    table(&head, rows)
}

fn table<const N: usize>(head: &[&str; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let line = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
        format!(
            "<tr>{}</tr>",
            cells
                .map(|cell| format!("<{tag}>{cell}</{tag}>"))
                .collect::<String>()
        )
    };
    let rows: String = rows
        .map(|row| line("td", &mut row.iter().map(String::as_str)))
        .collect();
    format!("<table>{}{rows}</table>", line("th", &mut head.iter().copied()))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
