//! Results for people.

use super::{Contender, Mark, Replay, Results, Way};

/// Tables in Markdown: a row for each network and contender, one table for each way.
pub fn table(results: &Results) -> String {
    let text = format!("Standing views:\n\n{}", still(results));
    match moving(results) {
        Some(moving) => format!("{text}\nMoving camera:\n\n{moving}"),
        None => text,
    }
}

/// The standing views: means over all of them.
pub fn still(results: &Results) -> String {
    let mut text = String::from(
        "| network | order | first picture | round trips | 95 % SSIM | bytes, of the best baseline | by view | settled | lost | given up |\n|---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for named in &results.plan.networks {
        for contender in Contender::ALL {
            let replays = || results.standing(&named.name, contender);
            let Some(count) = Some(replays().count()).filter(|count| *count > 0) else {
                continue;
            };
            let mean = |bytes: fn(&Replay) -> u64| replays().map(bytes).sum::<u64>() / count as u64;
            let trips = replays().map(|replay| replay.round_trips).max().flatten();
            let compared = matches!(contender, Contender::Ours | Contender::Bound);
            let of_best = |share: Option<String>| share.filter(|_| compared).unwrap_or_default();
            let share = results.share_of_best(&named.name, contender);
            let by_view = results.share_by_view(&named.name, contender);
            text += &format!(
                "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n",
                named.name,
                contender.name(),
                mark(mean_mark(replays().map(|replay| replay.first))),
                trips.map_or("–".into(), |trips| trips.to_string()),
                mark(mean_mark(replays().map(|replay| replay.similar))),
                of_best(share.map(percent)),
                of_best(by_view.map(|[least, most]| format!("{} to {}", percent(least), percent(most)))),
                mark(mean_mark(replays().map(|replay| replay.settled))),
                kilobytes(mean(|replay| replay.resent_bytes)),
                kilobytes(mean(|replay| replay.aborted_bytes)),
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

/// `None` if one of them is.
fn mean_mark(marks: impl Iterator<Item = Option<Mark>> + Clone) -> Option<Mark> {
    let count = marks.clone().count().max(1);
    let seconds: f64 = marks
        .clone()
        .map(|mark| Some(mark?.seconds))
        .sum::<Option<f64>>()?;
    let bytes: u64 = marks.map(|mark| Some(mark?.bytes)).sum::<Option<u64>>()?;
    Some(Mark {
        seconds: seconds / count as f64,
        bytes: bytes / count as u64,
    })
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
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
