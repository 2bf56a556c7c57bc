//! Rounds of both hosts by turns, so that what else the machine does hits both.

use std::{
    path::{Path, PathBuf},
    process::Command,
    sync::Arc,
    time::Duration,
};

use serde::{Deserialize, Serialize};

use super::{
    Plan,
    client::{self, Until},
    files::Site,
    host::{Host, failed},
};
use crate::engine::median;
use crate::{Error, Result};

/// A host in rounds.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Race {
    /// `nginx` or `eigentile`.
    pub host: String,
    /// Its rounds.
    pub rounds: Vec<Round>,
}

/// A round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Answers in a second.
    pub requests_per_second: f64,
    /// Time within which half of the requests were answered, in milliseconds.
    pub p50_ms: f64,
    /// And 99 of 100.
    pub p99_ms: f64,
    /// Requests that failed, or were answered with something else than 200.
    pub failed: u64,
}

impl Race {
    /// The middle of the rounds, each figure by itself; failures together.
    pub fn median(&self) -> Round {
        let of = |of: fn(&Round) -> f64| median(&mut self.rounds.iter().map(of).collect::<Vec<_>>());
        Round {
            requests_per_second: of(|round| round.requests_per_second),
            p50_ms: of(|round| round.p50_ms),
            p99_ms: of(|round| round.p99_ms),
            failed: self.rounds.iter().map(|round| round.failed).sum(),
        }
    }
}

/// Both hosts, and what asked them.
pub(super) fn run(
    program: &Path,
    site: &Site,
    plan: &Plan,
    cores: usize,
    progress: &dyn Fn(&str),
) -> Result<(String, Vec<Race>)> {
    let load = Load::new(site, plan, cores)?;
    let hosts = [Host::nginx(site, cores)?, Host::ours(program, site)?];
    let mut races = hosts.each_ref().map(|host| Race {
        host: host.name.to_owned(),
        rounds: Vec::new(),
    });
    // The first round warms caches on both sides.
    for round in 0..=plan.rounds {
        for (host, race) in hosts.iter().zip(&mut races) {
            progress(&format!("round {round} of {}, {}", plan.rounds, host.name));
            let measured = load.round(host)?;
            race.rounds.extend((round > 0).then_some(measured));
        }
    }
    let asked_by = if load.script.is_some() { "wrk" } else { "own" };
    Ok((asked_by.to_owned(), races.into()))
}

/// What asks.
struct Load {
    plan: Plan,
    threads: usize,
    requests: Arc<[Vec<u8>]>,
    /// For wrk, and the list that it reads; none if it is not installed.
    script: Option<(PathBuf, PathBuf)>,
}

/// Every thread of wrk asks for all records, one after the other.
const SCRIPT: &str = "\
local requests, at = {}, 0
init = function(args)
    for line in io.lines(args[1]) do requests[#requests + 1] = wrk.format('GET', line) end
end
request = function()
    at = at % #requests + 1
    return requests[at]
end
";

impl Load {
    fn new(site: &Site, plan: &Plan, cores: usize) -> Result<Self> {
        let installed = Command::new("wrk").arg("-v").output().is_ok();
        let write = |name: &str, text: String| {
            let path = site.path(name);
            std::fs::write(&path, text).map_err(Error::io(&path, "write"))?;
            Ok::<_, Error>(path)
        };
        let script = match installed {
            true => Some((
                write("load.lua", SCRIPT.into())?,
                write("targets", site.targets.join("\n"))?,
            )),
            false => None,
        };
        Ok(Self {
            plan: *plan,
            threads: cores.min(plan.connections),
            requests: client::requests(&site.targets),
            script,
        })
    }

    fn round(&self, host: &Host) -> Result<Round> {
        let Some((script, targets)) = &self.script else {
            return self.own(host);
        };
        let output = Command::new("wrk")
            .args([
                format!("-t{}", self.threads),
                format!("-c{}", self.plan.connections),
            ])
            .args([
                format!("-d{}s", self.plan.seconds),
                "--latency".into(),
                "-s".into(),
            ])
            .arg(script)
            .arg(format!("http://{}/", host.address))
            .arg("--")
            .arg(targets)
            .output()
            .map_err(|error| failed("wrk", error.to_string()))?;
        let text = String::from_utf8_lossy(&output.stdout);
        parse(&text).ok_or_else(|| {
            let errors = String::from_utf8_lossy(&output.stderr);
            failed("wrk", format!("it printed {text:?} and {errors:?}"))
        })
    }

    fn own(&self, host: &Host) -> Result<Round> {
        let runtime = tokio::runtime::Runtime::new().map_err(|error| failed("load", error.to_string()))?;
        let until = Until::After(Duration::from_secs(self.plan.seconds.into()));
        let done = Arc::default();
        let load = client::load(host.address, &self.requests, self.plan.connections, until, &done);
        let answers = runtime
            .block_on(load)
            .map_err(|error| failed(host.name, error.to_string()))?;
        Ok(Round {
            requests_per_second: answers.requests_per_second(),
            p50_ms: answers.quantile_ms(0.5),
            p99_ms: answers.quantile_ms(0.99),
            failed: answers.failed,
        })
    }
}

/// What wrk 4 prints.
fn parse(text: &str) -> Option<Round> {
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.trim().strip_prefix(name));
        line.map(str::trim)
    };
    let milliseconds = |text: &str| {
        let digits = text.trim_end_matches(|unit: char| unit.is_ascii_alphabetic());
        let unit = match &text[digits.len()..] {
            "us" => 1e-3,
            "ms" => 1.0,
            "s" => 1e3,
            "m" => 60e3,
            _ => return None,
        };
        Some(digits.parse::<f64>().ok()? * unit)
    };
    // "Socket errors: connect 0, read 3, write 0, timeout 0".
    let socket = field("Socket errors:").map_or(0, |errors| {
        let counts = errors.split(|not: char| !not.is_ascii_digit());
        counts.filter_map(|count| count.parse::<u64>().ok()).sum()
    });
    let status = field("Non-2xx or 3xx responses:").map_or(Some(0), |count| count.parse().ok())?;
    Some(Round {
        requests_per_second: field("Requests/sec:")?.parse().ok()?,
        p50_ms: milliseconds(field("50%")?)?,
        p99_ms: milliseconds(field("99%")?)?,
        failed: socket + status,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_wrk_prints_is_read() {
        let text = "Running 3s test @ http://127.0.0.1:1/\n  2 threads and 64 connections\n  Latency Distribution\n     50%  870.00us\n     \
                    75%    1.21ms\n     90%    2.00ms\n     99%    1.02s \n  100 requests in 3.00s, 1MB read\n  Socket errors: connect 0, \
                    read 3, write 1, timeout 0\n  Non-2xx or 3xx responses: 5\nRequests/sec:  41234.56\nTransfer/sec:     40.00MB\n";
        let expected = Round {
            requests_per_second: 41234.56,
            p50_ms: 0.87,
            p99_ms: 1020.0,
            failed: 9,
        };
        assert_eq!(parse(text), Some(expected));
        assert_eq!(parse("unable to connect"), None);
    }
}
