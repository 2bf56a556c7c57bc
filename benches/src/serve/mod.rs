//! The tile server under load, beside nginx with the same records as files, on the same cores as what asks.
//!
//! - [`Plan`]: how many rounds, connections and requests.
//! - [`measure`]: rounds of both hosts by turns ([`Race`]), then many connections held for long ([`Held`]).
//! - [`table`], [`plot`]: show.
//!
//! Both are real processes on this machine; records have the same addresses in both. nginx is given what it has for small files:
//! a worker for each core, `sendfile`, files kept open, and no log; our log is off, too. wrk asks where it is installed; else, and always for
//! the connections that are held, the small client here does.

mod client;
mod files;
mod held;
mod host;
mod race;
mod report;

use std::path::Path;

pub use held::Held;
pub use race::{Race, Round};
pub use report::{held, plot, races, table};
use serde::{Deserialize, Serialize};

use crate::engine::median;
use crate::{Error, Result};

/// How much is asked.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Rounds of each host; figures are medians.
    pub rounds: usize,
    /// Length of a round, and of the one before the first, which does not count.
    pub seconds: u32,
    /// Connections of a round, each asking again when it is answered.
    pub connections: usize,
    /// Connections that are held without asking.
    pub idle: usize,
    /// Connections that ask beside these.
    pub busy: usize,
    /// Requests of the busy ones together; 0 leaves this part out.
    pub requests: u64,
}

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// Processors that all share.
    pub cores: usize,
    /// What asked in the rounds: `wrk`, or `own` where it is not installed.
    pub asked_by: String,
    /// Records asked for.
    pub records: usize,
    /// Their mean length in bytes.
    pub mean_record_bytes: f64,
    /// Connections of a round.
    pub connections: usize,
    /// Each host in rounds: nginx, then ours.
    pub races: Vec<Race>,
    /// Each host with many connections: nginx, then ours. Empty if that was left out.
    pub held: Vec<Held>,
}

impl Results {
    /// Our requests per second over nginx's, round by round, in the middle.
    pub fn speed(&self) -> f64 {
        self.ratio(|round| round.requests_per_second)
    }

    /// Our 99th percentile of latency over nginx's, round by round, in the middle.
    pub fn slowness(&self) -> f64 {
        self.ratio(|round| round.p99_ms)
    }

    fn ratio(&self, of: impl Fn(&Round) -> f64) -> f64 {
        let [nginx, ours] = &self.races[..] else {
            return 0.0;
        };
        let pairs = nginx.rounds.iter().zip(&ours.rounds);
        median(
            &mut pairs
                .map(|(nginx, ours)| of(ours) / of(nginx))
                .collect::<Vec<_>>(),
        )
    }
}

/// Measures. `program` is `eigentile` itself; `archive` the archive whose records are asked for; `progress` is told what is done.
///
/// # Errors
/// If nginx is missing or does not start, a host answers something else than it should, or files cannot be written.
pub fn measure(program: &Path, archive: &Path, plan: &Plan, progress: &dyn Fn(&str)) -> Result<Results> {
    for (what, found) in [
        ("rounds", plan.rounds),
        ("connections", plan.connections),
        ("busy", plan.busy),
    ] {
        if found == 0 {
            return Err(Error::Invalid {
                what,
                found: "0".into(),
                expected: "1 or more",
            });
        }
    }
    progress("writing records as files");
    let site = files::Site::write(archive)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let (asked_by, races) = race::run(program, &site, plan, cores, progress)?;
    let held = match plan.requests {
        0 => Vec::new(),
        _ => held::run(program, &site, plan, cores, progress)?,
    };
    Ok(Results {
        cores,
        asked_by,
        records: site.targets.len(),
        mean_record_bytes: site.mean_bytes,
        connections: plan.connections,
        races,
        held,
    })
}
