//! Structural similarity over bytes and seconds, as SVG.

use super::replay::GOAL;
use super::{Contender, Mark, Replay, Results, Way};
use crate::report::chart::{BLUE, GREY, INK, OCHRE, Panel, RED, RGBColor, Scale, Series, VIOLET, chart};

/// In the order of the legend.
const SERIES: [(Contender, RGBColor); 5] = [
    (Contender::Bound, GREY),
    (Contender::Breadth, OCHRE),
    (Contender::Demand, RED),
    (Contender::Paper, VIOLET),
    (Contender::Ours, BLUE),
];

/// What is drawn to the right.
type Axis = fn(&Mark) -> f64;

/// A row of two panels for each network: standing views over bytes, and over seconds.
pub fn plot(results: &Results) -> String {
    let axes: [(&str, Axis); 2] = [
        ("MB", |mark| mark.bytes as f64 / 1e6),
        ("seconds", |mark| mark.seconds),
    ];
    let mut panels = Vec::new();
    for named in &results.plan.networks {
        let stands = (0..results.stands).map(Way::Standing);
        let replays: Vec<&Replay> = stands.flat_map(|way| results.of(&named.name, way)).collect();
        panels.extend(axes.map(|(unit, value)| Panel {
            title: format!("{}, over {unit}", named.name),
            x_name: unit.into(),
            x: Scale::FromZero,
            y: Scale::Linear,
            series: curves(&replays, value),
            mark: None,
        }));
    }
    let title = format!("SSIM to the settled picture, standing views: {}", results.name);
    chart(&title, axes.len(), &panels)
}

/// A curve for each replay, and a line at the goal.
fn curves(replays: &[&Replay], value: Axis) -> Vec<Series> {
    let points = replays.iter().flat_map(|replay| &replay.points);
    let most = points.map(|point| value(&point.at)).fold(0.0, f64::max);
    let mut all = vec![Series {
        width: 0.7,
        ..Series::new("", INK, vec![(0.0, GOAL), (most, GOAL)])
    }];
    for (contender, colour) in SERIES {
        let of = replays.iter().filter(|replay| replay.contender == contender);
        all.extend(of.map(|replay| {
            let points = replay.points.iter().map(|point| (value(&point.at), point.ssim));
            Series {
                width: if contender == Contender::Ours { 2.5 } else { 1.2 },
                ..Series::new(contender.name(), colour, points.collect())
            }
        }));
    }
    all
}
