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
    // Long titles are written smaller: bold letters are about six tenths as wide as high.
    let title_size = (width - 16.0) / (0.6 * axes.title.chars().count().max(1) as f64);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#24292f\"><title>{title}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"8\" y=\"16\" font-weight=\"bold\" font-size=\"{:.1}\">{title}</text>\n",
        title_size.min(13.0),
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
    let at = |point: &(f64, f64)| {
        (
            LEFT + PANEL.0 * (point.0.log10() - x.0) / (x.1 - x.0),
            TOP + PANEL.1 * (y.1 - of_y(point.1)) / (y.1 - y.0),
        )
    };
    for (tick, label) in logarithmic_or_linear(x) {
        let x = at(&(tick, 1.0)).0;
        line(&mut svg, &format!("M{x:.1} {TOP}v{}", PANEL.1), GRID, 1.0, false);
        text(&mut svg, x, TOP + PANEL.1 + 15.0, "middle", &label);
    }
    let ticks: Vec<_> = match axes.log_above {
        Some(_) => logarithmic_or_linear(y),
        None => linear(y),
    };
    for (tick, label) in ticks {
        let y = at(&(1.0, tick)).1;
        // What lies below a logarithmic axis is drawn on its lowest line.
        let below = axes.log_above.is_some_and(|least| tick <= least * 1.001);
        line(&mut svg, &format!("M{LEFT} {y:.1}h{}", PANEL.0), GRID, 1.0, false);
        text(
            &mut svg,
            LEFT - 5.0,
            y + 4.0,
            "end",
            if below { "0" } else { &label },
        );
    }
    text(
        &mut svg,
        LEFT + PANEL.0 / 2.0,
        TOP + PANEL.1 + 33.0,
        "middle",
        axes.x,
    );
    let mut labels = Labels::default();
    for series in series {
        let places: Vec<_> = series.points.iter().filter(usable).map(at).collect();
        let mut path = String::new();
        for (number, (x, y)) in places.iter().enumerate() {
            let command = if number == 0 { 'M' } else { 'L' };
            let _ = write!(path, "{command}{x:.1} {y:.1}"); // strings take everything
            let fill = if series.hollow { "#fff" } else { series.colour };
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{}\" fill=\"{fill}\" stroke=\"{}\"/>",
                if series.labels.is_empty() { 2.5 } else { 3.5 },
                series.colour
            );
        }
        if !series.hollow {
            line(&mut svg, &path, series.colour, 1.8, series.dashed);
            labels.lines.extend(places.windows(2).map(|two| [two[0], two[1]]));
        }
        labels.points.extend(places);
    }
    if let Some((x, y)) = mark.filter(|mark| usable(&mark)).map(|mark| at(&mark)) {
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\" fill=\"none\" stroke=\"#24292f\" stroke-width=\"1.5\"/>"
        );
    }
    for series in series {
        for (point, label) in series.points.iter().zip(&series.labels) {
            if usable(&point)
                && let Some((x, y, anchor)) = labels.place(at(point), label)
            {
                text(&mut svg, x, y, anchor, label);
            }
        }
    }
    svg + "</svg>\n"
}

/// Where the names of points stand: beside them, and not on other names, points and curves.
#[derive(Default)]
struct Labels {
    points: Vec<(f64, f64)>,
    lines: Vec<[(f64, f64); 2]>,
    /// Left, right, top, bottom.
    written: Vec<[f64; 4]>,
}

impl Labels {
    /// The place of which least is covered, and how text is anchored there. `None` where it would cover another name.
    fn place(&mut self, (x, y): (f64, f64), label: &str) -> Option<(f64, f64, &'static str)> {
        const HIGH: f64 = 9.0;
        let wide = 6.0 * label.chars().count() as f64;
        let sides = [(x + 9.0, "start"), (x - 9.0, "end"), (x, "middle")];
        let places = sides.into_iter().flat_map(|(x, anchor)| {
            let rises = match anchor {
                "middle" => [-11.0, 18.0, -11.0],
                _ => [-5.0, 13.0, 4.0],
            };
            rises.map(|rise| (x, y + rise, anchor))
        });
        let boxed = |&(x, y, anchor): &(f64, f64, &str)| {
            let left = match anchor {
                "start" => x,
                "end" => x - wide,
                _ => x - wide / 2.0,
            };
            [left, left + wide, y - HIGH, y + 2.0]
        };
        let cost = |place: &(f64, f64, &str)| {
            let [left, right, top, bottom] = boxed(place);
            let outside =
                left < LEFT || right > LEFT + PANEL.0 + 16.0 || top < TOP - 12.0 || bottom > TOP + PANEL.1;
            let over = |of: &&[f64; 4]| of[0] < right && left < of[1] && of[2] < bottom && top < of[3];
            if outside || self.written.iter().any(|of| over(&of)) {
                return None;
            }
            let inside = |x: f64, y: f64| left < x && x < right && top < y && y < bottom;
            let points = self.points.iter().filter(|point| {
                let [x, y] = [point.0.clamp(left, right), point.1.clamp(top, bottom)];
                (x - point.0).hypot(y - point.1) < 4.0
            });
            let steps = |[from, to]: &[(f64, f64); 2]| {
                (0..=64).any(|step| {
                    let share = f64::from(step) / 64.0;
                    inside(from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share)
                })
            };
            Some(10 * points.count() + self.lines.iter().filter(|line| steps(line)).count())
        };
        let found = places.filter_map(|place| Some((cost(&place)?, place)));
        let (_, place) = found.min_by_key(|(cost, _)| *cost)?;
        self.written.push(boxed(&place));
        Some(place)
    }
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

    #[test]
    fn names_do_not_cover_each_other() {
        let mut labels = Labels {
            points: vec![(200.0, 100.0), (203.0, 100.0), (420.0, 100.0)],
            lines: vec![[(100.0, 0.0), (300.0, 200.0)]],
            ..Labels::default()
        };
        for point in labels.points.clone() {
            labels.place(point, "a setting").unwrap();
        }
        let [a, b, last] = labels.written[..] else {
            panic!("three names are written")
        };
        assert!(
            a[1] <= b[0] || b[1] <= a[0] || a[3] <= b[2] || b[3] <= a[2],
            "{a:?} {b:?}"
        );
        // Of the right edge names are on the left.
        assert!(last[1] < 420.0, "{last:?}");
        // Where all is full, none is written over another.
        let many = (0..50).filter(|_| labels.place((200.0, 100.0), "a setting").is_some());
        assert!(many.count() < 10);
    }
}
