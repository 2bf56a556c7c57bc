//! Results for people.

use super::{Point, Policy, Results};

/// In the order of the legend: colours that differ in lightness too.
const SERIES: [(Policy, &str, &str); 4] = [
    (Policy::Recency, "least recently used", "#bf8700"),
    (Policy::Paper, "plain formulas of 2013", "#8250df"),
    (Policy::Ours, "Eigentile", "#0969da"),
    (Policy::Optimum, "exact optimum", "#24292f"),
];

fn of(results: &Results, policy: Policy) -> impl Iterator<Item = &Point> {
    results.points.iter().filter(move |point| point.policy == policy)
}

/// A table in Markdown: a row for each budget.
pub fn table(results: &Results) -> String {
    let mut text = String::from(
        "| pages | share of wanted | optimum | Eigentile | above | plain formulas | least recently used | moving: Eigentile | plain formulas | least recently used | loads: Eigentile | plain formulas | least recently used |\n|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    let columns = [Policy::Optimum, Policy::Ours, Policy::Paper, Policy::Recency];
    let [best, ours, paper, recency] = columns.map(|policy| of(results, policy));
    for (((best, ours), paper), recency) in best.zip(ours).zip(paper).zip(recency) {
        let moving = |point: &Point| {
            point
                .moving_rms
                .map_or_else(String::new, |rms| format!("{rms:.4}"))
        };
        let loads = |point: &Point| {
            point
                .moving_loads
                .map_or_else(String::new, |loads| loads.to_string())
        };
        let above = if best.settled_rms > 1e-9 {
            let ratio = ours.settled_rms / best.settled_rms;
            format!("+{:.2} %", 100.0 * (ratio - 1.0).max(0.0))
        } else {
            "both 0".into()
        };
        text += &format!(
            "| {} | {:.0} % | {:.4} | {:.4} | {} | {:.4} | {:.4} | {} | {} | {} | {} | {} | {} |\n",
            best.pages,
            100.0 * best.pages as f64 / results.pages_wanted.max(1.0),
            best.settled_rms,
            ours.settled_rms,
            above,
            paper.settled_rms,
            recency.settled_rms,
            moving(ours),
            moving(paper),
            moving(recency),
            loads(ours),
            loads(paper),
            loads(recency),
        );
    }
    text
}

const PANEL: (f64, f64) = (380.0, 280.0);
const LEFT: f64 = 66.0;
const TOP: f64 = 62.0;

/// Two panels as SVG: settled, and moving. Error over pages, both logarithmic.
pub fn plot(results: &Results) -> String {
    let width = 2.0 * (PANEL.0 + LEFT) + 20.0;
    let height = TOP + PANEL.1 + 76.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\" fill=\"#24292f\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    svg += &text(
        8.0,
        18.0,
        "start",
        &format!("Predicted RMS error of reflectance: {}", results.name),
        true,
    );
    let budgets: Vec<f64> = of(results, Policy::Optimum)
        .map(|point| point.pages.max(1) as f64)
        .collect();
    let errors = results
        .points
        .iter()
        .flat_map(|point| [Some(point.settled_rms), point.moving_rms]);
    let errors: Vec<f64> = errors
        .flatten()
        .filter(|error| *error > 1e-6 * results.empty_rms)
        .collect();
    let range = |values: &[f64]| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(0.0, f64::max);
        if low < high {
            (low, high)
        } else {
            (high.max(1e-9) / 2.0, high.max(1e-9))
        }
    };
    let (x, y) = (range(&budgets), range(&errors));
    let panels = [("settled", false), ("camera in motion", true)];
    for (panel, (title, moving)) in panels.into_iter().enumerate() {
        let left = LEFT + panel as f64 * (PANEL.0 + LEFT);
        let at_x = |value: f64| left + PANEL.0 * (value / x.0).ln() / (x.1 / x.0).ln();
        let at_y = |value: f64| TOP + PANEL.1 * (y.1 / value.max(y.0)).ln() / (y.1 / y.0).ln();
        svg += &text(left, TOP - 12.0, "start", title, true);
        for tick in ticks(x) {
            svg += &line(&format!("M{:.1} {TOP}v{}", at_x(tick), PANEL.1), "#d0d7de", 1.0);
            svg += &text(at_x(tick), TOP + PANEL.1 + 15.0, "middle", &number(tick), false);
        }
        for tick in ticks(y) {
            svg += &line(&format!("M{left} {:.1}h{}", at_y(tick), PANEL.0), "#d0d7de", 1.0);
            svg += &text(left - 5.0, at_y(tick) + 4.0, "end", &number(tick), false);
        }
        svg += &text(
            left + PANEL.0 / 2.0,
            TOP + PANEL.1 + 32.0,
            "middle",
            "slots of the page cache",
            false,
        );
        for (policy, _, colour) in SERIES {
            let points = of(results, policy).filter_map(|point| {
                let error = if moving {
                    point.moving_rms?
                } else {
                    point.settled_rms
                };
                (error >= y.0).then(|| (at_x(point.pages.max(1) as f64), at_y(error)))
            });
            let mut path = String::new();
            for (at, (x, y)) in points.enumerate() {
                path += &format!("{}{x:.1} {y:.1}", if at == 0 { 'M' } else { 'L' });
            }
            let stroke = if policy == Policy::Ours { 3.0 } else { 1.5 };
            if !path.is_empty() {
                svg += &line(&path, colour, stroke);
            }
        }
    }
    let mut left = LEFT;
    for (_, name, colour) in SERIES {
        let top = TOP + PANEL.1 + 58.0;
        svg += &line(&format!("M{left} {:.1}h20", top - 4.0), colour, 3.0);
        svg += &text(left + 26.0, top, "start", name, false);
        left += 190.0;
    }
    svg + "</svg>\n"
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

/// 1, 2 and 5 times the powers of ten in a range.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let powers = (low.log10().floor() as i32..=high.log10().ceil() as i32).map(|power| 10f64.powi(power));
    let all = powers.flat_map(|power| [power, 2.0 * power, 5.0 * power]);
    all.filter(|tick| (low * 0.999..=high * 1.001).contains(tick))
        .collect()
}

fn number(value: f64) -> String {
    if value >= 1.0 {
        format!("{value:.0}")
    } else {
        format!("{:.*}", (-value.log10()).ceil() as usize, value)
    }
}
