//! Curves as SVG that reads without scripts and in print.

use std::fmt::Write;

/// A curve.
pub(crate) struct Series {
    pub(crate) name: String,
    pub(crate) colour: &'static str,
    pub(crate) dashed: bool,
    /// By rising x.
    pub(crate) points: Vec<(f64, f64)>,
    /// What stands beside points, of as many as there are names.
    pub(crate) labels: Vec<String>,
    /// Whether circles are empty and not joined by a line.
    pub(crate) hollow: bool,
}

/// Axes of a chart. x is logarithmic.
pub(crate) struct Axes<'a> {
    pub(crate) title: &'a str,
    pub(crate) x: &'a str,
    /// A logarithmic y, of what lies above this.
    pub(crate) log_above: Option<f64>,
}

const PANEL: (f64, f64) = (400.0, 210.0);
const LEFT: f64 = 62.0;
const TOP: f64 = 34.0;
const GRID: &str = "#d0d7de";

/// A chart of its own, with points marked by circles and one of them, `mark`, by a ring.
pub(crate) fn chart(axes: &Axes<'_>, series: &[Series], mark: Option<(f64, f64)>) -> String {
    let (width, height) = (LEFT + PANEL.0 + 18.0, TOP + PANEL.1 + 44.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#24292f\"><title>{title}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"8\" y=\"18\" font-weight=\"bold\" font-size=\"13\">{title}</text>\n",
        title = escape(axes.title),
    );
    let of_y = |y: f64| axes.log_above.map_or(y, |least| y.max(least).log10());
    let usable = |point: &&(f64, f64)| point.0 > 0.0 && of_y(point.1).is_finite();
    let all: Vec<_> = series
        .iter()
        .flat_map(|series| series.points.iter().filter(usable))
        .collect();
    let Some((x, y)) =
        range(all.iter().map(|point| point.0.log10())).zip(range(all.iter().map(|point| of_y(point.1))))
    else {
        return svg + "<text x=\"62\" y=\"60\">nothing to draw</text></svg>\n";
    };
    let at_x = |value: f64| LEFT + PANEL.0 * (value.log10() - x.0) / (x.1 - x.0);
    let at_y = |value: f64| TOP + PANEL.1 * (y.1 - of_y(value)) / (y.1 - y.0);
    for (tick, label) in logarithmic_or_linear(x) {
        line(
            &mut svg,
            &format!("M{:.1} {TOP}v{}", at_x(tick), PANEL.1),
            GRID,
            1.0,
            false,
        );
        text(&mut svg, at_x(tick), TOP + PANEL.1 + 15.0, "middle", &label);
    }
    let ticks: Vec<_> = match axes.log_above {
        Some(_) => logarithmic_or_linear(y),
        None => linear(y),
    };
    for (tick, label) in ticks {
        line(
            &mut svg,
            &format!("M{LEFT} {:.1}h{}", at_y(tick), PANEL.0),
            GRID,
            1.0,
            false,
        );
        text(&mut svg, LEFT - 5.0, at_y(tick) + 4.0, "end", &label);
    }
    text(
        &mut svg,
        LEFT + PANEL.0 / 2.0,
        TOP + PANEL.1 + 33.0,
        "middle",
        axes.x,
    );
    let mut written = Vec::new();
    for series in series {
        let mut path = String::new();
        for (at, point) in series.points.iter().enumerate() {
            if !usable(&point) {
                continue;
            }
            let command = if path.is_empty() { 'M' } else { 'L' };
            let (x, y) = (at_x(point.0), at_y(point.1));
            let _ = write!(path, "{command}{x:.1} {y:.1}"); // strings take everything
            let fill = if series.hollow { "#fff" } else { series.colour };
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{}\" fill=\"{fill}\" stroke=\"{}\"/>",
                if series.labels.is_empty() { 2.5 } else { 3.5 },
                series.colour
            );
            if let Some(label) = series.labels.get(at) {
                let (x, anchor) = if x > LEFT + 0.7 * PANEL.0 {
                    (x - 7.0, "end")
                } else {
                    (x + 7.0, "start")
                };
                let wide = 6.2 * label.chars().count() as f64;
                let left = if anchor == "end" { x - wide } else { x };
                // Above the point, or below it; a label that would cover others in both places is left out.
                let free = [y - 5.0, y + 14.0].into_iter().find(|&y| {
                    written.iter().all(|&(from, to, at): &(f64, f64, f64)| {
                        to < left || left + wide < from || (at - y).abs() > 11.0
                    })
                });
                if let Some(y) = free {
                    written.push((left, left + wide, y));
                    text(&mut svg, x, y, anchor, label);
                }
            }
        }
        if !series.hollow {
            line(&mut svg, &path, series.colour, 1.8, series.dashed);
        }
    }
    if let Some((x, y)) = mark.filter(|mark| usable(&mark)) {
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"7\" fill=\"none\" stroke=\"#24292f\" stroke-width=\"1.5\"/>",
            at_x(x),
            at_y(y)
        );
    }
    svg + "</svg>\n"
}

/// Names of the curves, one below the other.
pub(crate) fn legend(series: &[Series]) -> String {
    let height = 20.0 * series.len() as f64 + 8.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 480 {height}\" width=\"480\" height=\"{height}\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#24292f\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (row, series) in series.iter().enumerate() {
        let y = 16.0 + 20.0 * row as f64;
        line(&mut svg, &format!("M8 {y}h36"), series.colour, 2.5, series.dashed);
        text(&mut svg, 54.0, y + 4.0, "start", &series.name);
    }
    svg + "</svg>\n"
}

/// SVGs that begin with their size, as those of this module, one below the other in one.
pub(crate) fn stacked(svgs: &[String]) -> String {
    let number = |svg: &str, name: &str| -> f64 {
        let text = svg
            .split_once(&format!(" {name}=\""))
            .and_then(|(_, rest)| rest.split_once('"'));
        text.and_then(|(value, _)| value.parse().ok()).unwrap_or(0.0)
    };
    let width = svgs.iter().map(|svg| number(svg, "width")).fold(0.0, f64::max);
    let mut height = 0.0;
    let mut inside = String::new();
    for svg in svgs {
        inside += &svg.replacen("<svg ", &format!("<svg y=\"{height}\" "), 1);
        height += number(svg, "height");
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">\n{inside}</svg>\n"
    )
}

/// Least and largest, with some room where they are one.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    let room = if high > low { 0.03 * (high - low) } else { 0.5 };
    (low <= high).then_some((low - room, high + room))
}

/// Powers of ten, halved and doubled where there are few of them, between two exponents.
fn logarithmic((low, high): (f64, f64)) -> Vec<f64> {
    let powers = low.floor() as i32..=high.ceil() as i32;
    let factors: &[f64] = if high - low > 2.5 {
        &[1.0]
    } else {
        &[1.0, 2.0, 5.0]
    };
    let ticks = powers.flat_map(|power| factors.iter().map(move |factor| factor * 10f64.powi(power)));
    ticks
        .filter(|tick| (low - 1e-9..=high + 1e-9).contains(&tick.log10()))
        .collect()
}

/// Ticks of a logarithmic axis: where two powers of ten are too far away, even steps.
fn logarithmic_or_linear(exponents: (f64, f64)) -> Vec<(f64, String)> {
    let ticks = logarithmic(exponents);
    if ticks.len() < 3 {
        return linear((10f64.powf(exponents.0), 10f64.powf(exponents.1)));
    }
    ticks.into_iter().map(|tick| (tick, number(tick))).collect()
}

/// At most eight steps of 1, 2 or 5 times a power of ten, with as many digits as tell them apart.
fn linear((low, high): (f64, f64)) -> Vec<(f64, String)> {
    let power = 10f64.powf(((high - low) / 8.0).log10().floor());
    let step = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|factor| (high - low) / (factor * power) <= 8.0);
    let step = step.unwrap_or(10.0) * power;
    let digits = (-(step * 1.001).log10().floor()).clamp(0.0, 12.0) as usize;
    let first = (low / step).ceil() as i64;
    (first..)
        .map(|tick| tick as f64 * step)
        .take_while(|tick| *tick <= high + 1e-9 * step)
        .map(|tick| (tick, format!("{tick:.digits$}")))
        .collect()
}

fn number(value: f64) -> String {
    let digits = (2 - value.abs().max(1e-6).log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn text(svg: &mut String, x: f64, y: f64, anchor: &str, text: &str) {
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>",
        escape(text)
    );
}

fn line(svg: &mut String, path: &str, colour: &str, width: f64, dashed: bool) {
    if !path.is_empty() {
        let dashes = if dashed { " stroke-dasharray=\"5 4\"" } else { "" };
        let _ = writeln!(
            svg,
            "<path d=\"{path}\" stroke=\"{colour}\" stroke-width=\"{width}\" fill=\"none\"{dashes}/>"
        );
    }
}

/// Text of XML and HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_lie_in_range_and_read_well() {
        assert_eq!(logarithmic((0.0, 2.0)), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert_eq!(logarithmic((-3.0, 1.0)).len(), 5);
        let labels = |range| -> Vec<_> { linear(range).into_iter().map(|(_, label)| label).collect() };
        assert_eq!(labels((0.1, 0.52)), ["0.1", "0.2", "0.3", "0.4", "0.5"]);
        let mut close = labels((0.99992, 0.99998));
        close.dedup();
        assert!(
            close.len() >= 6 && close.iter().all(|label| label.len() == 7),
            "{close:?}"
        );
        assert_eq!(
            labels((20.0, 140.0)),
            ["20", "40", "60", "80", "100", "120", "140"]
        );
        assert_eq!(
            ["0.05", "1", "0.0001", "200", "12.5"],
            [0.05, 1.0, 1e-4, 200.0, 12.5].map(number)
        );
    }

    #[test]
    fn odd_curves_do_not_break_a_chart() {
        let axes = Axes {
            title: "a < b",
            x: "MiB",
            log_above: Some(1e-6),
        };
        let series = |points: Vec<(f64, f64)>| Series {
            name: "s".into(),
            colour: "#000",
            dashed: true,
            points,
            labels: vec!["one".into()],
            hollow: false,
        };
        for points in [
            vec![],
            vec![(1.0, 1.0)],
            vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, f64::INFINITY)],
            vec![(1.0, 0.0), (1e12, 1.0)],
        ] {
            let svg = chart(&axes, &[series(points)], Some((1.0, f64::NAN)));
            assert!(
                svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"),
                "{svg}"
            );
            assert!(svg.contains("a &lt; b"));
        }
    }
}
