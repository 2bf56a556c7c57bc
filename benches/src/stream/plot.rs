//! Structural similarity over bytes and seconds, as SVG.

use super::{Contender, Replay, Results, Way};

/// In the order of the legend: colours that differ in lightness too.
const SERIES: [(Contender, &str); 5] = [
    (Contender::Bound, "#8c959f"),
    (Contender::Breadth, "#bf8700"),
    (Contender::Demand, "#cf222e"),
    (Contender::Paper, "#8250df"),
    (Contender::Ours, "#0969da"),
];
const PANEL: (f64, f64) = (380.0, 170.0);
const LEFT: f64 = 60.0;
const TOP: f64 = 58.0;
const ROW: f64 = 236.0;
const GOAL: f64 = super::replay::GOAL;
const GREY: &str = "#d0d7de";

/// What is drawn to the right.
type Axis = fn(&super::Mark) -> f64;

/// A row of two panels for each network: standing views over bytes, and over seconds.
pub fn plot(results: &Results) -> String {
    let rows = results.plan.networks.len() as f64;
    let (width, height) = (2.0 * (PANEL.0 + LEFT) + 20.0, TOP + rows * ROW + 12.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#24292f\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    let title = format!("SSIM to the settled picture, standing views: {}", results.name);
    svg += &text(8.0, 18.0, "start", &title, true);
    for (row, named) in results.plan.networks.iter().enumerate() {
        let top = TOP + row as f64 * ROW;
        let stands = (0..results.stands).map(Way::Standing);
        let replays: Vec<&Replay> = stands.flat_map(|way| results.of(&named.name, way)).collect();
        let axes: [(&str, Axis); 2] = [
            ("MB", |mark| mark.bytes as f64 / 1e6),
            ("seconds", |mark| mark.seconds),
        ];
        for (column, (unit, value)) in axes.into_iter().enumerate() {
            let left = LEFT + column as f64 * (PANEL.0 + LEFT);
            svg += &text(
                left,
                top - 8.0,
                "start",
                &format!("{}, over {unit}", named.name),
                true,
            );
            svg += &panel(&replays, (left, top), unit, value);
        }
    }
    let mut left = LEFT;
    for (contender, colour) in SERIES {
        svg += &line(&format!("M{left} 32h20"), colour, 3.0);
        svg += &text(left + 26.0, 36.0, "start", contender.name(), false);
        left += 150.0;
    }
    svg + "</svg>\n"
}

fn panel(replays: &[&Replay], (left, top): (f64, f64), unit: &str, value: fn(&super::Mark) -> f64) -> String {
    let points = || replays.iter().flat_map(|replay| &replay.points);
    let most = points()
        .map(|point| value(&point.at))
        .fold(0.0, f64::max)
        .max(1e-9);
    let least = points().map(|point| point.ssim).fold(1.0, f64::min);
    let low = ((least * 10.0).floor() / 10.0).clamp(0.0, 0.9);
    let at_x = |value: f64| left + PANEL.0 * value / most;
    let at_y = |ssim: f64| top + PANEL.1 * (1.0 - ssim.clamp(low, 1.0)) / (1.0 - low);
    let mut svg = String::new();
    let step = step(most);
    for tick in (0..)
        .map(|tick| f64::from(tick) * step)
        .take_while(|tick| *tick <= most)
    {
        svg += &line(&format!("M{:.1} {top}v{}", at_x(tick), PANEL.1), GREY, 1.0);
        svg += &text(
            at_x(tick),
            top + PANEL.1 + 15.0,
            "middle",
            &number(tick, step),
            false,
        );
    }
    svg += &text(left + PANEL.0 / 2.0, top + PANEL.1 + 31.0, "middle", unit, false);
    for tick in (0..=10)
        .map(|tick| f64::from(tick) / 10.0)
        .filter(|tick| *tick >= low - 1e-9)
    {
        svg += &line(&format!("M{left} {:.1}h{}", at_y(tick), PANEL.0), GREY, 1.0);
        svg += &text(left - 5.0, at_y(tick) + 4.0, "end", &format!("{tick:.1}"), false);
    }
    svg += &line(&format!("M{left} {:.1}h{}", at_y(GOAL), PANEL.0), "#24292f", 0.7);
    for (contender, colour) in SERIES {
        let of = replays.iter().filter(|replay| replay.contender == contender);
        let mut path = String::new();
        for replay in of {
            for (at, point) in replay.points.iter().enumerate() {
                let (x, y) = (at_x(value(&point.at)), at_y(point.ssim));
                path += &format!("{}{x:.1} {y:.1}", if at == 0 { "M" } else { "L" });
            }
        }
        let stroke = if contender == Contender::Ours { 2.5 } else { 1.2 };
        if !path.is_empty() {
            svg += &line(&path, colour, stroke);
        }
    }
    svg
}

/// A distance of ticks: 1, 2 or 5 times a power of ten, at most eight of them.
fn step(most: f64) -> f64 {
    let power = 10f64.powf((most / 8.0).log10().floor());
    let fits = |factor: &f64| most / (factor * power) <= 8.0;
    [1.0, 2.0, 5.0].into_iter().find(fits).unwrap_or(10.0) * power
}

fn number(value: f64, step: f64) -> String {
    let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.digits$}")
}

fn text(x: f64, y: f64, anchor: &str, text: &str, bold: bool) -> String {
    let weight = if bold {
        " font-weight=\"bold\" font-size=\"13\""
    } else {
        ""
    };
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{weight}>{text}</text>\n")
}

fn line(path: &str, colour: &str, width: f64) -> String {
    format!("<path d=\"{path}\" stroke=\"{colour}\" stroke-width=\"{width}\" fill=\"none\"/>\n")
}
