//! The hour.

use std::time::{Duration, Instant};

use engine::frame::{Budgets, Counters, Engine, FrameStats, Options};
use engine::gpu::page_cache::SLOT_BYTES;
use engine::gpu::{Context, PageFormat};
use engine::metrics::Picture;
use engine::stream::Network;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use scenes::Camera;
use serde::Serialize;

use super::line::Watched;
use super::wander::Wander;
use super::weather::Weather;
use crate::engine::{Archives, Subject, built_in};
use crate::memory::resident_bytes;
use crate::{Error, Result};

/// Frames that stand for a second.
const FRAMES_PER_SECOND: f64 = 4.0;
/// Most frames until the last view has settled.
const MOST_FRAMES_AFTER: usize = 3000;
/// Budgets, so small that most views want more.
const PAGES: u64 = 192;
const REQUESTS: usize = 24;
const BYTES_IN_FLIGHT: u64 = 96 << 10;
const HOST_BYTES: u64 = 4 << 20;
const UPLOADS: usize = 8;

/// How to go on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// Simulated.
    pub minutes: f64,
    /// Materials of the grid of tori.
    pub materials: usize,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Of everything that happens.
    pub seed: u64,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Endured {
    /// How.
    pub plan: Plan,
    /// Frames, and the seconds that they took.
    pub frames: usize,
    /// See above.
    pub seconds: f64,
    /// Seconds of each kind of weather, simulated.
    pub weather: Vec<(Weather, f64)>,
    /// Pages and columns placed.
    pub placed: u64,
    /// Of these in the place of others.
    pub swapped: u64,
    /// Work that was not needed, and work that went wrong.
    pub counters: Counters,
    /// Most of each resource in any frame, and its budget.
    pub most: Vec<Most>,
    /// Resident memory of this process after a tenth of the frames, and in the end, where the system tells.
    pub resident_bytes: Option<[u64; 2]>,
    /// Root mean square difference of the last picture to one that nothing has happened to, in parts of its root mean square.
    pub difference: f64,
    /// What is broken, for people; empty if nothing is.
    pub broken: Vec<String>,
}

/// Most of a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Most {
    /// Its name.
    pub what: &'static str,
    /// Most in any frame.
    pub most: u64,
    /// What may be.
    pub budget: u64,
}

fn options(plan: &Plan) -> Options {
    Options {
        size: plan.size,
        budgets: Budgets {
            page_cache_bytes: PAGES * SLOT_BYTES,
            column_cache_bytes: 4 << 20,
            host_bytes: HOST_BYTES,
            uploads_per_frame: UPLOADS,
            requests_in_flight: REQUESTS,
            bytes_in_flight: BYTES_IN_FLIGHT,
            ..Budgets::default()
        },
        page_format: Some(PageFormat::Half),
        // In every frame the same happens, by the same clock.
        wait: true,
        ..Options::default()
    }
}

/// Lets an engine go through all of it.
///
/// # Errors
/// Those of the engine. A budget that was exceeded and a wrong picture are no errors: [`Endured::broken`] says so.
pub fn endure(plan: &Plan, progress: &dyn Fn(&str)) -> Result<Endured> {
    let subject = built_in(plan.materials, 1, 0)?;
    let mut random = ChaCha8Rng::seed_from_u64(plan.seed);
    let context = Context::headless()?;
    let line = watched(&subject, plan.seed)?;
    let mut engine = start(&context, &subject, &line, plan)?;
    let bounds = subject.scene.bounds();
    let (low, high) = bounds.unwrap_or_default();
    let mut wander = Wander::new([low, high], subject.cameras[0]);
    let frames = ((plan.minutes * 60.0 * FRAMES_PER_SECOND) as usize).max(20);
    let mut watch = Watch::new();
    // All shaders are compiled once a view has settled: what memory is compared with includes them.
    settled(&mut engine, &line, &subject.cameras[0], &mut watch)?;
    // Clear while the indices come: an archive that cannot be had is given up, as a program would be told.
    let (mut weather, mut left) = (Weather::Clear, 10.0);
    let mut of_kind = Weather::ALL.map(|weather| (weather, 0.0));
    let step = 1.0 / FRAMES_PER_SECOND;
    let (begin, mut at_a_tenth) = (Instant::now(), None);
    for frame in 0..frames {
        if left <= 0.0 {
            weather = Weather::draw(&mut random);
            left = weather.seconds(&mut random);
            line.set_faults(weather.faults());
        }
        left -= step;
        for (kind, seconds) in &mut of_kind {
            *seconds += if *kind == weather { step } else { 0.0 };
        }
        line.advance(Duration::from_secs_f64(step * weather.speed()));
        let stats = engine.step(&wander.after(step, &mut random))?;
        watch.look(&stats, &engine, &line);
        if frame % 480 == 0 {
            progress(&format!(
                "minute {:.0} of {:.0}",
                frame as f64 * step / 60.0,
                plan.minutes
            ));
        }
        if frame == frames / 10 {
            at_a_tenth = resident_bytes("self");
        }
    }
    line.set_faults(Weather::Clear.faults());
    let last = subject.cameras[0];
    let picture = settled(&mut engine, &line, &last, &mut watch)?;
    let resident_bytes = at_a_tenth.zip(resident_bytes("self")).map(<[u64; 2]>::from);
    let seconds = begin.elapsed().as_secs_f64();
    let calm = watched(&subject, plan.seed)?;
    let mut other = start(&context, &subject, &calm, plan)?;
    let mut unharmed = Watch::new();
    let expected = settled(&mut other, &calm, &last, &mut unharmed)?;
    let mut broken = std::mem::take(&mut watch.broken);
    let difference = match (&picture, &expected) {
        (Some(picture), Some(expected)) => relative_difference(picture, expected),
        _ => {
            let problems: Vec<&str> = engine.problems().collect();
            broken.push(format!("the last view does not settle: {problems:?}"));
            f64::NAN
        }
    };
    Ok(Endured {
        plan: *plan,
        frames,
        seconds,
        weather: of_kind.to_vec(),
        placed: watch.placed,
        swapped: watch.swapped,
        counters: engine.counters(),
        most: watch.most,
        resident_bytes,
        difference,
        broken,
    })
}

fn watched(subject: &Subject, seed: u64) -> Result<Watched> {
    match (&subject.archives, Network::named("4g")) {
        (Archives::Made(archives), Some(network)) => Watched::new(archives, network, seed),
        _ => Err(Error::Invalid {
            what: "the subject",
            found: "not made".into(),
            expected: "made by formula",
        }),
    }
}

fn start(context: &Context, subject: &Subject, line: &Watched, plan: &Plan) -> Result<Engine> {
    let source = Box::new(line.clone());
    Ok(Engine::new(
        context.clone(),
        &subject.scene,
        source,
        options(plan),
    )?)
}

/// The picture of a view once it has settled; `None` if it does not.
fn settled(
    engine: &mut Engine,
    line: &Watched,
    camera: &Camera,
    watch: &mut Watch,
) -> Result<Option<Picture>> {
    for _ in 0..MOST_FRAMES_AFTER {
        line.advance(Duration::from_secs_f64(1.0 / FRAMES_PER_SECOND));
        let stats = engine.step(camera)?;
        watch.look(&stats, engine, line);
        if stats.settled && stats.archives_known == stats.archives {
            return Ok(Some(engine.show()?));
        }
    }
    Ok(None)
}

/// Where columns stand in [`Endured::most`].
const COLUMNS: usize = 1;

/// Looks after every frame.
struct Watch {
    gpu_bytes: Option<u64>,
    most: Vec<Most>,
    placed: u64,
    swapped: u64,
    broken: Vec<String>,
}

impl Watch {
    fn new() -> Self {
        let budget = |what, budget| Most {
            what,
            most: 0,
            budget,
        };
        Self {
            gpu_bytes: None,
            most: vec![
                budget("pages resident", PAGES),
                budget("columns resident", 0),
                budget("bytes on the host", HOST_BYTES),
                budget("requests in flight", REQUESTS as u64),
                budget("bytes in flight", BYTES_IN_FLIGHT),
                budget("placed in a frame", UPLOADS as u64),
            ],
            placed: 0,
            swapped: 0,
            broken: Vec::new(),
        }
    }

    fn look(&mut self, stats: &FrameStats, engine: &Engine, line: &Watched) {
        let flying = line.most_in_flight();
        // How many columns there is room for is known with the first archives.
        self.most[COLUMNS].budget = engine.column_slots().0.into();
        let placed = u64::from(stats.added + stats.swapped);
        // A single record may take more than may be in flight.
        let bytes = if flying.bytes > flying.largest {
            flying.bytes
        } else {
            0
        };
        let now = [
            stats.pages_resident.into(),
            stats.columns_resident.into(),
            stats.host_bytes,
            flying.requests as u64,
            bytes,
            placed,
        ];
        for (most, now) in self.most.iter_mut().zip(now) {
            if now > most.budget && most.most <= most.budget {
                self.broken.push(format!(
                    "{}: {now} in frame {}, {} may be",
                    most.what, stats.frame, most.budget
                ));
            }
            most.most = most.most.max(now);
        }
        // Caches, tables and targets are there when all archives are known, and stay as they are.
        if stats.archives_known == stats.archives && stats.settled {
            let first = *self.gpu_bytes.get_or_insert(stats.gpu_bytes);
            if stats.gpu_bytes > first && self.broken.len() < 20 {
                let text = format!(
                    "{} bytes on the GPU in frame {}, {first} before",
                    stats.gpu_bytes, stats.frame
                );
                self.broken.push(text);
            }
        }
        if !stats.predicted_rms.is_finite() || engine.problems().count() > 1000 {
            self.broken.push(format!(
                "frame {}: the predicted error, or the problems, have no bounds",
                stats.frame
            ));
        }
        self.placed += placed;
        self.swapped += u64::from(stats.swapped);
    }
}

fn relative_difference(a: &Picture, b: &Picture) -> f64 {
    let square =
        |values: &mut dyn Iterator<Item = f32>| values.map(|value| f64::from(value).powi(2)).sum::<f64>();
    let (a, b) = (a.pixels.iter().flatten(), b.pixels.iter().flatten());
    let difference = square(&mut a.zip(b.clone()).map(|(a, b)| a - b));
    (difference / square(&mut b.copied()).max(f64::MIN_POSITIVE)).sqrt()
}

/// A Markdown table.
pub fn table(endured: &Endured) -> String {
    let mut text = format!(
        "{} simulated minutes, {} frames in {:.0} s; {} placed, {} of them swapped; {} failed, {} damaged, {} given up\n\n| | most | budget |\n|---|---:|---:|\n",
        endured.plan.minutes,
        endured.frames,
        endured.seconds,
        endured.placed,
        endured.swapped,
        endured.counters.requests_failed,
        endured.counters.records_damaged,
        endured.counters.requests_cancelled,
    );
    for Most { what, most, budget } in &endured.most {
        text.push_str(&format!("| {what} | {most} | {budget} |\n"));
    }
    if let Some([tenth, end]) = endured.resident_bytes {
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        text.push_str(&format!(
            "| memory of the process, MiB | {:.1} | {:.1} after a tenth |\n",
            mib(end),
            mib(tenth)
        ));
    }
    text.push_str(&format!(
        "| difference of the last picture | {:.1e} | |\n",
        endured.difference
    ));
    for broken in &endured.broken {
        text.push_str(&format!("\n! {broken}\n"));
    }
    text
}
