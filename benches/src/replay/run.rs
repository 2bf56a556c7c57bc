//! Replaying, and the result for people.

use std::time::Duration;

use engine::frame::Engine;
use engine::gpu::Context;
use serde::Serialize;

use super::counts::Counting;
use super::{Counts, Trace};
use crate::engine::{Subject, median, thread_time};
use crate::stream::{Line as SimulatedLine, repeatable};
use crate::{Error, Result};

/// Frames in a second of simulated time: what the engine counts by.
const FRAMES: u32 = 60;
/// Longest wait for the rest to come after the last camera: five simulated minutes.
const MOST_FRAMES_AFTER: usize = 300 * FRAMES as usize;

/// A trace that was replayed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replayed {
    /// What it shows.
    pub name: String,
    /// Frames of the trace.
    pub cameras: usize,
    /// What came of it, the same in every round.
    pub counts: Counts,
    /// What differs from when it was recorded; `None` if that is not known.
    pub differences: Option<Vec<String>>,
    /// Milliseconds of processor time of the frames' thread in a frame, besides the submission of work to the GPU: the median of each round.
    pub cpu_ms_rounds: Vec<f64>,
}

/// Replays a trace so many times.
///
/// # Errors
/// [`Error::Trace`] if its scene cannot be had, or if two rounds differ, which would be a fault of the program; those of the engine.
pub fn replay(trace: &Trace, rounds: usize, progress: &dyn Fn(&str)) -> Result<Replayed> {
    let subject = trace.subject()?;
    let context = Context::headless()?;
    let mut counts: Option<Counts> = None;
    let mut cpu_ms_rounds = Vec::new();
    for round in 1..=rounds.max(1) {
        progress(&format!("{}: round {round}", trace.name));
        let (found, cpu_ms) = once(trace, &subject, &context)?;
        cpu_ms_rounds.push(cpu_ms);
        if let Some(first) = &counts {
            let differences = found.differences(first)?;
            if !differences.is_empty() {
                let differences = differences.join(", ");
                return Err(Error::Trace(format!(
                    "round {round} is another one than the first: {differences}"
                )));
            }
        }
        counts = Some(found);
    }
    let counts = counts.unwrap_or_default();
    let recorded = trace.counts.as_ref();
    let differences = recorded
        .map(|recorded| counts.differences(recorded))
        .transpose()?;
    Ok(Replayed {
        name: trace.name.clone(),
        cameras: trace.cameras.len(),
        counts,
        differences,
        cpu_ms_rounds,
    })
}

/// One round: its counts, and the median of the frames' milliseconds.
fn once(trace: &Trace, subject: &Subject, context: &Context) -> Result<(Counts, f64)> {
    let line = SimulatedLine::new(subject.archives.source()?, trace.line.into());
    let options = repeatable(trace.size, trace.page_cache_bytes, trace.column_cache_bytes);
    let mut engine = Engine::new(context.clone(), &subject.scene, Box::new(line.clone()), options)?;
    engine.time_with(thread_time);
    let mut counting = Counting::new();
    let mut times = Vec::new();
    let mut came = 0;
    for frame in 0..trace.cameras.len() + MOST_FRAMES_AFTER {
        line.advance(Duration::from_secs(1) / FRAMES);
        let camera = trace.cameras.get(frame).or(trace.cameras.last());
        let Some(camera) = camera else { break };
        let stats = engine.step(camera)?;
        let new = line.came_since(came);
        came += new.len();
        for (request, bytes) in &new {
            counting.came(request, *bytes);
        }
        counting.frame(&stats);
        let ms = stats.ms;
        times.push(ms.votes + ms.residency + ms.source + ms.decode + ms.upload);
        if stats.settled && frame + 1 >= trace.cameras.len() {
            break;
        }
    }
    let counts = counting.end(line.stats(), engine.counters());
    Ok((counts, median(&mut times)))
}

/// A Markdown table.
pub fn table(replayed: &Replayed) -> String {
    let counts = &replayed.counts;
    let mut text = format!(
        "| {}, {} frames | |\n|---|---:|\n",
        replayed.name, replayed.cameras
    );
    let mut line = |what: &str, value: String| text.push_str(&format!("| {what} | {value} |\n"));
    let settled = if counts.settled {
        "settled after"
    } else {
        "not settled after"
    };
    line(settled, format!("{} frames", counts.frames));
    line(
        "indices, columns, pages",
        format!("{}, {}, {}", counts.indices, counts.columns, counts.pages),
    );
    line("bytes over the line", counts.line_bytes.to_string());
    line(
        "of requests given up",
        format!("{}, saved {}", counts.wasted_bytes, counts.saved_bytes),
    );
    line("sent again", counts.resent_bytes.to_string());
    line("placed, swapped", format!("{}, {}", counts.added, counts.swapped));
    line(
        "predicted error, mean and last",
        format!(
            "{:.5}, {:.5}",
            counts.predicted_rms_mean, counts.predicted_rms_last
        ),
    );
    line("order", counts.order.clone());
    let rounds: Vec<String> = replayed
        .cpu_ms_rounds
        .iter()
        .map(|ms| format!("{ms:.3}"))
        .collect();
    line("CPU in a frame, ms, by round", rounds.join(", "));
    match replayed.differences.as_deref() {
        None => line("as recorded", "not known".to_owned()),
        Some([]) => line("as recorded", "yes".to_owned()),
        Some(differences) => differences
            .iter()
            .for_each(|difference| line("differs", difference.clone())),
    }
    text
}
