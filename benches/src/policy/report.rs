//! Results for people.

use super::{Point, Policy, Results};
use crate::report::chart::{BLUE, INK, OCHRE, Panel, RGBColor, Scale, Series, VIOLET, chart};

/// In the order of the legend.
const SERIES: [(Policy, &str, RGBColor); 4] = [
    (Policy::Recency, "least recently used", OCHRE),
    (Policy::Paper, "plain formulas of 2013", VIOLET),
    (Policy::Ours, "Eigentile", BLUE),
    (Policy::Optimum, "exact optimum", INK),
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

/// Two panels as SVG: settled, and moving. Error over pages, both logarithmic.
pub fn plot(results: &Results) -> String {
    let at = |point: &Point, rms: f64| {
        let shown = rms > 1e-6 * results.empty_rms;
        shown.then(|| (point.pages.max(1) as f64, rms))
    };
    let settled = |point: &Point| at(point, point.settled_rms);
    let moving = |point: &Point| at(point, point.moving_rms?);
    // Both panels have the same axes: those of all points.
    let all = results
        .points
        .iter()
        .flat_map(|point| [settled(point), moving(point)]);
    let unseen = Series {
        width: 0.0,
        ..Series::new("", INK, all.flatten().collect())
    };
    let panel = |title: &str, place: &dyn Fn(&Point) -> Option<(f64, f64)>| {
        let curve = |(policy, name, colour)| Series {
            width: if policy == Policy::Ours { 3.0 } else { 1.5 },
            ..Series::new(name, colour, of(results, policy).filter_map(place).collect())
        };
        Panel {
            title: title.into(),
            x_name: "slots of the page cache".into(),
            x: Scale::Log { least: None },
            y: Scale::Log { least: None },
            series: SERIES.map(curve).into_iter().chain([unseen.clone()]).collect(),
            mark: None,
        }
    };
    let panels = [panel("settled", &settled), panel("camera in motion", &moving)];
    chart(
        &format!("Predicted RMS error of reflectance: {}", results.name),
        2,
        &panels,
    )
}
