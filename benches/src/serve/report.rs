//! Tables and a picture.

use std::fmt::Write;

use super::{Race, Results, Round};

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

const PANEL: (f64, f64) = (300.0, 220.0);
const LEFT: f64 = 70.0;
const TOP: f64 = 60.0;
const COLOURS: [&str; 2] = ["#8c959f", "#0969da"];

/// Requests per second and p99 as SVG, round by round.
pub fn plot(results: &Results) -> String {
    let (width, height) = (2.0 * (PANEL.0 + LEFT) + 20.0, TOP + PANEL.1 + 60.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"11\" fill=\"#24292f\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    svg += &text(
        8.0,
        20.0,
        "start",
        "Records beside nginx, the same cores, by turns",
    );
    let panels: [(&str, Figure); 2] = [
        ("requests per second", |round| round.requests_per_second),
        ("p99 of latency, ms", |round| round.p99_ms),
    ];
    for (at, (title, of)) in panels.into_iter().enumerate() {
        svg += &panel(&results.races, LEFT + at as f64 * (PANEL.0 + LEFT), title, of);
    }
    for (at, (race, colour)) in results.races.iter().zip(COLOURS).enumerate() {
        let (x, y) = (LEFT + 120.0 * at as f64, height - 14.0);
        let _ = writeln!(
            svg,
            "<circle cx=\"{x}\" cy=\"{:.1}\" r=\"4\" fill=\"{colour}\"/>",
            y - 4.0
        );
        svg += &text(x + 10.0, y, "start", &race.host);
    }
    svg + "</svg>\n"
}

/// From zero to the largest value; a point for each round, a line at the median.
fn panel(races: &[Race], left: f64, title: &str, of: Figure) -> String {
    let all = races.iter().flat_map(|race| &race.rounds).map(of);
    let most = all.fold(0.0, f64::max).max(1e-9) * 1.1;
    let at = |value: f64| TOP + PANEL.1 * (1.0 - value / most);
    let mut svg = text(left, TOP - 14.0, "start", title);
    // Four steps or so, of 1, 2 or 5 times a power of ten.
    let power = 10f64.powf((most / 4.0).log10().floor());
    let step = power
        * [1.0, 2.0, 5.0]
            .into_iter()
            .find(|times| most / (power * times) < 5.0)
            .unwrap_or(10.0);
    for tick in (0..)
        .map(|count| f64::from(count) * step)
        .take_while(|tick| *tick <= most)
    {
        let y = at(tick);
        let _ = writeln!(svg, "<path d=\"M{left} {y:.1}h{}\" stroke=\"#d0d7de\"/>", PANEL.0);
        let digits = (-step.log10().floor()).max(0.0) as usize;
        svg += &text(left - 5.0, y + 4.0, "end", &format!("{tick:.digits$}"));
    }
    for (race, colour) in races.iter().zip(COLOURS) {
        let y = at(of(&race.median()));
        let _ = writeln!(
            svg,
            "<path d=\"M{left} {y:.1}h{}\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            PANEL.0
        );
        for (round, values) in race.rounds.iter().enumerate() {
            let x = left + PANEL.0 * (round as f64 + 0.5) / race.rounds.len() as f64;
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{colour}\"/>",
                at(of(values))
            );
        }
    }
    svg
}

fn text(x: f64, y: f64, anchor: &str, text: &str) -> String {
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>\n")
}

#[cfg(test)]
mod tests {
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
