//! Results as tables, plots and a report.

use std::fmt::Write;

use super::{Family, Judge, Point, Results};
use crate::report::Report;
use crate::report::chart::{BLUE, Panel, RED, Scale, Series, chart};

/// Tables in Markdown: one for each knob, a row for each setting; then which defaults are beaten.
pub fn table(results: &Results) -> String {
    let mut text = String::new();
    for family in &results.families {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}\n", about(family));
        text += &rows_of(family);
        text.push('\n');
    }
    text + &verdict(results) + "\n"
}

/// All settings of all knobs in one table.
pub fn rows(results: &Results) -> String {
    let mut text = String::from(
        "| knob | setting | ms | to the default | ± | work to the default | MiB | relative RMSE | of the BTF | |\n|---|---|---:|---:|---:|---:|---:|---:|---:|---|\n",
    );
    for family in &results.families {
        for at in 0..family.points.len() {
            let _ = writeln!(text, "| {} {}", family.knob.title(), cells(family, at));
        }
    }
    text
}

fn rows_of(family: &Family) -> String {
    let mut text = format!(
        "| {} | ms | to the default | ± | {}, to the default | MiB | relative RMSE | of the BTF | |\n|---|---:|---:|---:|---:|---:|---:|---:|---|\n",
        family.knob.title(),
        family.knob.counted(),
    );
    for at in 0..family.points.len() {
        let _ = writeln!(text, "{}", cells(family, at));
    }
    text
}

fn cells(family: &Family, at: usize) -> String {
    let (point, default) = (&family.points[at], &family.points[family.default]);
    let name = if at == family.default {
        format!("**{}, default**", point.setting)
    } else {
        point.setting.clone()
    };
    let bytes = point
        .bytes
        .map_or("–".into(), |bytes| format!("{:.2}", bytes as f64 / 1048576.0));
    let of_btf = point.error_of_btf.map_or("–".into(), number);
    let front = match &point.beaten_by {
        None => "on the front".into(),
        Some(by) => format!("dominated by {by}"),
    };
    format!(
        "| {name} | {:.2} | {:.3} | {:.3} | {:.3} | {bytes} | {} | {of_btf} | {front} |",
        point.ms,
        point.ratio,
        point.noise,
        point.work / default.work.max(f64::MIN_POSITIVE),
        number(point.error),
    )
}

fn about(family: &Family) -> String {
    let knob = family.knob;
    let bytes = knob
        .bytes()
        .map_or(String::new(), |what| format!("; MiB: {what}"));
    format!(
        "{}: time of {}, error against {}{bytes}",
        capital(knob.title()),
        knob.timed(),
        knob.error()
    )
}

/// Which defaults are on the front.
fn verdict(results: &Results) -> String {
    let beaten = |family: &Family| {
        let by = family.beats_default(Judge::Measured)?;
        let (default, by) = (&family.points[family.default], &family.points[by]);
        Some(format!(
            "{}: {} is dominated by {}",
            family.knob.title(),
            default.setting,
            by.setting
        ))
    };
    let beaten: Vec<_> = results.families.iter().filter_map(beaten).collect();
    let mut text = if beaten.is_empty() {
        "All defaults are on the front.".to_owned()
    } else {
        format!("Defaults that are not on the front: {}.", beaten.join("; "))
    };
    if !results.skipped.is_empty() {
        text += &format!(" Not measured: {}.", results.skipped.join("; "));
    }
    text
}

/// Everything, to read.
pub fn report(results: &Results) -> Report {
    let mut report = Report::new(format!("Run time and error: {}", results.name))
        .text(verdict(results))
        .text(format!(
            "Each setting ran {} times by turns with the default. Filled: on the front, dominated by no setting of the same knob in time, \
             memory and error. Empty: dominated. The ring marks the default.",
            results.rounds
        ))
        .plots(vec![plot(results)]);
    for family in &results.families {
        report = report.heading(about(family)).text(rows_of(family));
    }
    report
}

/// All knobs as SVG, error over time.
pub fn plot(results: &Results) -> String {
    let panels: Vec<_> = results.families.iter().map(panel).collect();
    chart(&format!("Error over time: {}", results.name), 2, &panels)
}

/// Below it errors are drawn on the axis: eight bits do not show them.
const NO_ERROR: f64 = 1e-5;

fn panel(family: &Family) -> Panel {
    let series = |beaten: bool| {
        let mut points: Vec<&Point> = family
            .points
            .iter()
            .filter(|point| point.beaten_by.is_some() == beaten)
            .collect();
        points.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
        Series {
            labels: points.iter().map(|point| point.setting.clone()).collect(),
            width: if beaten { 0.0 } else { 1.8 },
            radius: 3.5,
            hollow: beaten,
            ..Series::new(
                if beaten { "dominated" } else { "on the front" },
                if beaten { RED } else { BLUE },
                points.iter().map(|point| (point.ratio, point.error)).collect(),
            )
        }
    };
    let default = &family.points[family.default];
    Panel {
        title: format!(
            "{}: relative RMSE to {}",
            family.knob.title(),
            family.knob.error()
        ),
        x_name: format!("time of {}, to that of the default", family.knob.timed()),
        x: Scale::Log { least: None },
        y: Scale::Log {
            least: Some(NO_ERROR),
        },
        series: vec![series(false), series(true)],
        mark: Some((default.ratio, default.error)),
    }
}

fn number(value: f64) -> String {
    if value == 0.0 {
        "0".into()
    } else if value < 1e-3 {
        format!("{value:.1e}")
    } else {
        format!("{value:.4}")
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(letters).collect()
    })
}
