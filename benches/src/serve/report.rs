//! Tables and a picture.

use std::fmt::Write;

use super::{Results, Round};
use crate::report::chart::{BLUE, GREY, Panel, RGBColor, Scale, Series, chart};

/// What is promised: at least this share of nginx's requests, and at most this many times its p99.
const GOALS: (f64, f64) = (0.9, 2.0);

/// Two tables in Markdown, and whether the goals are met.
pub fn table(results: &Results) -> String {
    let verdict = |met: bool| if met { "met" } else { "missed" };
    let mut text = format!(
        "{} records of {:.0} bytes on average, {} connections, asked by {}, {} cores shared by all.\n\n{}\n\
         Requests/s to nginx, round by round: {:.2} (goal: {} or more, {}). p99: {:.2} times (goal: {} or less, {}).\n",
        results.records,
        results.mean_record_bytes,
        results.connections,
        results.asked_by,
        results.cores,
        races(results),
        results.speed(),
        GOALS.0,
        verdict(results.speed() >= GOALS.0),
        results.slowness(),
        GOALS.1,
        verdict(results.slowness() <= GOALS.1),
    );
    if !results.held.is_empty() {
        text += "\n";
        text += &held(results);
    }
    text
}

/// Rounds of each host, medians.
pub fn races(results: &Results) -> String {
    let mut text =
        String::from("| host | requests/s | p50 ms | p99 ms | failed |\n|---|---:|---:|---:|---:|\n");
    for race in &results.races {
        let Round {
            requests_per_second,
            p50_ms,
            p99_ms,
            failed,
        } = race.median();
        let _ = writeln!(
            text,
            "| {} | {requests_per_second:.0} | {p50_ms:.2} | {p99_ms:.2} | {failed} |",
            race.host
        );
    }
    text
}

/// Connections that are held.
pub fn held(results: &Results) -> String {
    let mut text = String::from(
        "| host | idle | of these answered at the end | busy | requests | failed | requests/s | p50 ms | p99 ms | MB at start | \
         with idle | after a tenth | at the end |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for held in &results.held {
        let mb = |bytes: u64| bytes as f64 / 1e6;
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {:.0} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} |",
            held.host,
            held.idle,
            held.still_answered,
            held.busy,
            held.requests,
            held.failed,
            held.requests_per_second,
            held.p50_ms,
            held.p99_ms,
            mb(held.bytes_at_start),
            mb(held.bytes_idle),
            mb(held.bytes_at_tenth),
            mb(held.bytes_at_end)
        );
    }
    text
}

/// What a panel shows of a round.
type Figure = fn(&Round) -> f64;

const COLOURS: [RGBColor; 2] = [GREY, BLUE];

/// Requests per second and p99 as SVG: a point for each round, a line at the median.
pub fn plot(results: &Results) -> String {
    let panels: [(&str, Figure); 2] = [
        ("requests per second", |round| round.requests_per_second),
        ("p99 of latency, ms", |round| round.p99_ms),
    ];
    let panels = panels.map(|(title, of)| {
        let series = results.races.iter().zip(COLOURS).flat_map(|(race, colour)| {
            let rounds = race.rounds.iter().zip(1..);
            let points = rounds.map(|(round, number)| (f64::from(number), of(round)));
            let median = of(&race.median());
            let to = race.rounds.len() as f64 + 0.5;
            [
                Series {
                    width: 0.0,
                    radius: 4.0,
                    ..Series::new(&race.host, colour, points.collect())
                },
                Series::new("", colour, vec![(0.5, median), (to, median)]),
            ]
        });
        Panel {
            title: title.into(),
            x_name: "round".into(),
            x: Scale::Count,
            y: Scale::FromZero,
            series: series.collect(),
            mark: None,
        }
    });
    chart("Records beside nginx, the same cores, by turns", 2, &panels)
}

#[cfg(test)]
mod tests {
    use super::super::Race;
    use super::*;

    fn results(ours: f64) -> Results {
        let race = |host: &str, speed: f64| Race {
            host: host.into(),
            rounds: (0..3)
                .map(|round| Round {
                    requests_per_second: speed + f64::from(round),
                    p50_ms: 1.0,
                    p99_ms: 1e5 / speed,
                    failed: 0,
                })
                .collect(),
        };
        Results {
            cores: 2,
            asked_by: "wrk".into(),
            records: 10,
            mean_record_bytes: 500.0,
            connections: 64,
            races: vec![race("nginx", 1e5), race("eigentile", ours)],
            held: Vec::new(),
        }
    }

    #[test]
    fn goals_are_judged() {
        assert!(
            table(&results(95e3))
                .contains("0.95 (goal: 0.9 or more, met). p99: 1.05 times (goal: 2 or less, met)")
        );
        assert!(
            table(&results(4e4))
                .contains("0.40 (goal: 0.9 or more, missed). p99: 2.50 times (goal: 2 or less, missed)")
        );
    }

    #[test]
    fn a_plot_has_a_point_for_each_round() {
        assert_eq!(plot(&results(9e4)).matches("<circle").count(), 2 * 6 + 2);
    }
}
