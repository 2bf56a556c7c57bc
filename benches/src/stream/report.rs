//! Results for people.

use super::{Mark, Results, Way};

/// Tables in Markdown: a row for each network and contender, one table for each way.
pub fn table(results: &Results) -> String {
    let text = format!("Static view:\n\n{}", still(results));
    match moving(results) {
        Some(moving) => format!("{text}\nMoving camera:\n\n{moving}"),
        None => text,
    }
}

/// The view that stays.
pub fn still(results: &Results) -> String {
    let mut text = String::from(
        "| network | order | first picture | round trips | 95 % SSIM | bytes, of the best baseline | settled | lost | given up |\n|---|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for named in &results.plan.networks {
        let share = results.share_of_best(&named.name, Way::Static);
        for replay in results.of(&named.name, Way::Static) {
            let share = share.filter(|_| replay.contender == super::Contender::Ours);
            text += &format!(
                "| {} | {} | {} | {} | {} | {} | {} | {} | {} |\n",
                named.name,
                replay.contender.name(),
                mark(replay.first),
                replay.round_trips.map_or("–".into(), |trips| trips.to_string()),
                mark(replay.similar),
                share.map_or(String::new(), |share| format!("{:.0} %", 100.0 * share)),
                mark(replay.settled),
                kilobytes(replay.resent_bytes),
                kilobytes(replay.aborted_bytes),
            );
        }
    }
    text
}

/// The camera that moves, where it does.
pub fn moving(results: &Results) -> Option<String> {
    let mut text = String::from(
        "| network | order | mean SSIM in motion | MB when it stops | 95 % SSIM | settled | given up, saved by it | never seen |\n|---|---|---:|---:|---:|---:|---:|---:|\n",
    );
    let mut moved = false;
    for named in &results.plan.networks {
        for replay in results.of(&named.name, Way::Moving) {
            moved = true;
            text += &format!(
                "| {} | {} | {} | {} | {} | {} | {}, {} | {} |\n",
                named.name,
                replay.contender.name(),
                replay.moving_ssim.map_or("–".into(), |ssim| format!("{ssim:.3}")),
                replay.stopped.map_or("–".into(), |mark| megabytes(mark.bytes)),
                mark(replay.similar),
                mark(replay.settled),
                kilobytes(replay.aborted_bytes),
                kilobytes(replay.saved_bytes),
                kilobytes(replay.unseen_bytes),
            );
        }
    }
    moved.then_some(text)
}

fn mark(mark: Option<Mark>) -> String {
    mark.map_or("–".into(), |mark| {
        format!("{:.2} s, {} MB", mark.seconds, megabytes(mark.bytes))
    })
}

fn megabytes(bytes: u64) -> String {
    format!("{:.2}", bytes as f64 / 1e6)
}

fn kilobytes(bytes: u64) -> String {
    format!("{:.0} kB", bytes as f64 / 1e3)
}
