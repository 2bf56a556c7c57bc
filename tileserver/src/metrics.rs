//! What is counted, and how Prometheus reads it (text format 0.0.4).
//!
//! By hand: a fixed set of routes and statuses makes a table of atomics, so that a request costs no lock and no
//! allocation here, and nothing that clients send can add a label.

use std::{
    fmt::Write,
    sync::atomic::{AtomicU64, Ordering},
    time::Duration,
};

use hyper::StatusCode;

/// A number that only grows.
#[derive(Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn add(&self, more: u64) {
        self.0.fetch_add(more, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// What a request asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Route {
    Catalogue,
    Manifest,
    Archive,
    Index,
    Page,
    Column,
    Batch,
    File,
    Site,
    Status,
    Other,
}

impl Route {
    const NAMES: [&str; 11] = [
        "catalogue",
        "manifest",
        "archive",
        "index",
        "page",
        "column",
        "batch",
        "file",
        "site",
        "status",
        "other",
    ];
}

/// Statuses that are counted one by one; the last one stands for all others.
const STATUSES: [u16; 17] = [
    200, 206, 304, 400, 401, 404, 405, 410, 412, 413, 414, 416, 431, 500, 502, 503, 0,
];
/// Upper bounds of the histogram, in microseconds.
const BOUNDS: [u64; 14] = [
    100, 250, 500, 1_000, 2_500, 5_000, 10_000, 25_000, 50_000, 100_000, 250_000, 1_000_000, 5_000_000,
    30_000_000,
];

#[derive(Default)]
struct Histogram {
    /// One bucket a bound and one for what is longer; not cumulative.
    buckets: [Counter; BOUNDS.len() + 1],
    microseconds: Counter,
}

#[derive(Default)]
struct PerRoute {
    statuses: [Counter; STATUSES.len()],
    bytes: Counter,
    begun: Histogram,
}

/// Everything that is counted.
#[derive(Default)]
pub(crate) struct Metrics {
    routes: [PerRoute; Route::NAMES.len()],
    pub(crate) requests_begun: Counter,
    pub(crate) requests_ended: Counter,
    pub(crate) connections_begun: Counter,
    pub(crate) connections_ended: Counter,
    pub(crate) shed: Counter,
    pub(crate) cache_hits: Counter,
    pub(crate) cache_misses: Counter,
    pub(crate) cache_joins: Counter,
    pub(crate) store_reads: Counter,
    pub(crate) store_failures: Counter,
    pub(crate) broken_off: Counter,
}

/// What is measured when it is asked for.
pub(crate) struct Levels {
    pub(crate) cache_bytes: u64,
    pub(crate) memory_bytes: u64,
    pub(crate) archives: u64,
    pub(crate) broken_archives: u64,
    pub(crate) ready: bool,
}

impl Metrics {
    /// An answer has begun, `after` its request.
    pub(crate) fn begun(&self, route: Route, status: StatusCode, after: Duration) {
        let counted = &self.routes[route as usize];
        let known = STATUSES.iter().position(|&known| known == status.as_u16());
        counted.statuses[known.unwrap_or(STATUSES.len() - 1)].add(1);
        let microseconds = after.as_micros() as u64;
        let bucket = BOUNDS.partition_point(|&bound| bound < microseconds);
        counted.begun.buckets[bucket].add(1);
        counted.begun.microseconds.add(microseconds);
    }

    /// Bytes of a body were sent.
    pub(crate) fn sent(&self, route: Route, bytes: u64) {
        self.routes[route as usize].bytes.add(bytes);
    }

    /// All of it as text.
    pub(crate) fn text(&self, levels: &Levels) -> String {
        let mut text = String::with_capacity(16 << 10);
        self.write(&mut text, levels).unwrap_or_default(); // Strings take everything.
        text
    }

    fn write(&self, out: &mut String, levels: &Levels) -> std::fmt::Result {
        let routes = || Route::NAMES.iter().zip(&self.routes);
        head(
            out,
            "requests_total",
            "counter",
            "Answers by what was asked for and status.",
        )?;
        for (name, route) in routes() {
            for (status, count) in STATUSES.iter().zip(&route.statuses) {
                if count.get() > 0 {
                    let status = if *status == 0 {
                        "other".to_owned()
                    } else {
                        status.to_string()
                    };
                    let count = count.get();
                    writeln!(
                        out,
                        "eigentile_requests_total{{route=\"{name}\",status=\"{status}\"}} {count}"
                    )?;
                }
            }
        }
        head(out, "sent_bytes_total", "counter", "Bytes of bodies.")?;
        for (name, route) in routes() {
            writeln!(
                out,
                "eigentile_sent_bytes_total{{route=\"{name}\"}} {}",
                route.bytes.get()
            )?;
        }
        head(
            out,
            "request_duration_seconds",
            "histogram",
            "Time until an answer begins.",
        )?;
        for (name, route) in routes() {
            let mut total = 0;
            let bounds = BOUNDS.iter().map(|&bound| (bound as f64 / 1e6).to_string());
            for (bound, bucket) in bounds.chain(["+Inf".to_owned()]).zip(&route.begun.buckets) {
                total += bucket.get();
                writeln!(
                    out,
                    "eigentile_request_duration_seconds_bucket{{route=\"{name}\",le=\"{bound}\"}} {total}"
                )?;
            }
            let seconds = route.begun.microseconds.get() as f64 / 1e6;
            writeln!(
                out,
                "eigentile_request_duration_seconds_sum{{route=\"{name}\"}} {seconds}"
            )?;
            writeln!(
                out,
                "eigentile_request_duration_seconds_count{{route=\"{name}\"}} {total}"
            )?;
        }
        let open = |begun: &Counter, ended: &Counter| {
            let ended = ended.get(); // First, so that the difference cannot be negative.
            begun.get().saturating_sub(ended)
        };
        for (name, kind, help, value) in [
            (
                "connections_total",
                "counter",
                "Connections accepted.",
                self.connections_begun.get(),
            ),
            (
                "connections",
                "gauge",
                "Connections that are open.",
                open(&self.connections_begun, &self.connections_ended),
            ),
            (
                "requests",
                "gauge",
                "Requests in progress, to the last byte of their answers.",
                open(&self.requests_begun, &self.requests_ended),
            ),
            (
                "shed_total",
                "counter",
                "Requests answered with 503 because there were too many.",
                self.shed.get(),
            ),
            (
                "broken_off_total",
                "counter",
                "Answers that did not get to their end.",
                self.broken_off.get(),
            ),
            (
                "cache_hits_total",
                "counter",
                "Records that were in memory.",
                self.cache_hits.get(),
            ),
            (
                "cache_misses_total",
                "counter",
                "Records that were read.",
                self.cache_misses.get(),
            ),
            (
                "cache_joins_total",
                "counter",
                "Records that another request was reading.",
                self.cache_joins.get(),
            ),
            (
                "cache_bytes",
                "gauge",
                "Memory for records that were asked for lately.",
                levels.cache_bytes,
            ),
            (
                "memory_bytes",
                "gauge",
                "Memory of answers that are not sent yet.",
                levels.memory_bytes,
            ),
            (
                "store_reads_total",
                "counter",
                "Questions to stores, lists included.",
                self.store_reads.get(),
            ),
            (
                "store_failures_total",
                "counter",
                "Those that failed and may be tried again.",
                self.store_failures.get(),
            ),
            (
                "archives",
                "gauge",
                "Archives that can be served, at the last look.",
                levels.archives,
            ),
            (
                "broken_archives",
                "gauge",
                "Archives that cannot.",
                levels.broken_archives,
            ),
            (
                "ready",
                "gauge",
                "1 if stores were reachable at the last look and no end is near.",
                levels.ready.into(),
            ),
        ] {
            head(out, name, kind, help)?;
            writeln!(out, "eigentile_{name} {value}")?;
        }
        Ok(())
    }
}

fn head(out: &mut String, name: &str, kind: &str, help: &str) -> std::fmt::Result {
    writeln!(
        out,
        "# HELP eigentile_{name} {help}\n# TYPE eigentile_{name} {kind}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histograms_are_cumulative_and_bounds_belong_to_their_bucket() {
        let metrics = Metrics::default();
        for microseconds in [50, 100, 101, 60_000_000] {
            metrics.begun(Route::Page, StatusCode::OK, Duration::from_micros(microseconds));
        }
        metrics.begun(Route::Page, StatusCode::IM_A_TEAPOT, Duration::ZERO);
        let levels = Levels {
            cache_bytes: 0,
            memory_bytes: 0,
            archives: 0,
            broken_archives: 0,
            ready: true,
        };
        let text = metrics.text(&levels);
        for line in [
            "eigentile_requests_total{route=\"page\",status=\"200\"} 4",
            "eigentile_requests_total{route=\"page\",status=\"other\"} 1",
            "eigentile_request_duration_seconds_bucket{route=\"page\",le=\"0.0001\"} 3",
            "eigentile_request_duration_seconds_bucket{route=\"page\",le=\"0.00025\"} 4",
            "eigentile_request_duration_seconds_bucket{route=\"page\",le=\"30\"} 4",
            "eigentile_request_duration_seconds_bucket{route=\"page\",le=\"+Inf\"} 5",
            "eigentile_request_duration_seconds_count{route=\"page\"} 5",
            "eigentile_request_duration_seconds_sum{route=\"page\"} 60.000251",
            "eigentile_ready 1",
        ] {
            assert!(text.lines().any(|other| other == line), "{line}\n{text}");
        }
    }
}
