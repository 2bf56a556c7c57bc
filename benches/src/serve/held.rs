//! Many connections: most hold still, others ask without a pause. Memory must not grow with what was asked.

use std::{
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use futures_util::{StreamExt, stream};
use serde::{Deserialize, Serialize};

use super::{
    Plan,
    client::{self, Connection, Until},
    files::Site,
    host::{Host, failed},
};
use crate::Result;

/// Connections that are opened, or asked over, at the same time.
const AT_ONCE: usize = 64;
/// Pause between two looks at the memory.
const LOOK: Duration = Duration::from_millis(100);

/// A host with many connections.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Held {
    /// `nginx` or `eigentile`.
    pub host: String,
    /// Connections that were asked to hold still, after one request each.
    pub idle: usize,
    /// Those that were answered again at the end.
    pub still_answered: usize,
    /// Connections that asked without a pause.
    pub busy: usize,
    /// Requests of the busy ones.
    pub requests: u64,
    /// Those that failed.
    pub failed: u64,
    /// Answers in a second.
    pub requests_per_second: f64,
    /// Latency of the busy ones, in milliseconds.
    pub p50_ms: f64,
    /// And of 99 of 100.
    pub p99_ms: f64,
    /// Memory without a connection, of all processes of the host.
    pub bytes_at_start: u64,
    /// With the idle connections.
    pub bytes_idle: u64,
    /// When a tenth of the requests was answered.
    pub bytes_at_tenth: u64,
    /// When all were.
    pub bytes_at_end: u64,
}

pub(super) fn run(
    program: &Path,
    site: &Site,
    plan: &Plan,
    cores: usize,
    progress: &dyn Fn(&str),
) -> Result<Vec<Held>> {
    let runtime = tokio::runtime::Runtime::new().map_err(|error| failed("load", error.to_string()))?;
    let nginx = Host::nginx(site, cores)?;
    let mut all = vec![runtime.block_on(hold(&nginx, site, plan, progress))?];
    drop(nginx);
    let ours = Host::ours(program, site)?;
    all.push(runtime.block_on(hold(&ours, site, plan, progress))?);
    Ok(all)
}

async fn hold(host: &Host, site: &Site, plan: &Plan, progress: &dyn Fn(&str)) -> Result<Held> {
    let requests = client::requests(&site.targets);
    let of_host = |error: std::io::Error| failed(host.name, error.to_string());
    let bytes_at_start = host.resident_bytes();
    progress(&format!("{}: opening {} connections", host.name, plan.idle));
    let opening = stream::iter(0..plan.idle).map(|at| {
        let request = &requests[at % requests.len()];
        async move {
            let mut connection = Connection::open(host.address).await?;
            connection.ask(request).await?;
            Ok::<_, std::io::Error>(connection)
        }
    });
    let opened: Vec<_> = opening.buffer_unordered(AT_ONCE).collect().await;
    let idle: Vec<Connection> = opened
        .into_iter()
        .collect::<std::io::Result<_>>()
        .map_err(|error| {
            failed(
                host.name,
                format!("{} connections cannot be held: {error}", plan.idle),
            )
        })?;
    let bytes_idle = host.resident_bytes();

    progress(&format!("{}: {} requests", host.name, plan.requests));
    let done = Arc::new(AtomicU64::new(0));
    let load = client::load(
        host.address,
        &requests,
        plan.busy,
        Until::Requests(plan.requests),
        &done,
    );
    let tenth = async {
        while done.load(Ordering::Relaxed) < plan.requests / 10 {
            tokio::time::sleep(LOOK).await;
        }
        host.resident_bytes()
    };
    let mut bytes_at_tenth = 0;
    let answers = {
        let (mut load, mut tenth) = (std::pin::pin!(load), std::pin::pin!(tenth));
        tokio::select! {
            answers = &mut load => answers,
            bytes = &mut tenth => {
                bytes_at_tenth = bytes;
                load.await
            }
        }
    };
    let answers = answers.map_err(of_host)?;
    let bytes_at_end = host.resident_bytes();

    progress(&format!("{}: asking those that held still", host.name));
    let count = idle.len();
    let request = &requests[0];
    let asking =
        stream::iter(idle).map(|mut connection| async move { connection.ask(request).await.is_ok() });
    let still_answered = asking
        .buffer_unordered(AT_ONCE)
        .filter(|answered| std::future::ready(*answered))
        .count()
        .await;
    Ok(Held {
        host: host.name.to_owned(),
        idle: count,
        still_answered,
        busy: plan.busy,
        requests: plan.requests,
        failed: answers.failed,
        requests_per_second: answers.requests_per_second(),
        p50_ms: answers.quantile_ms(0.5),
        p99_ms: answers.quantile_ms(0.99),
        bytes_at_start,
        bytes_idle,
        bytes_at_tenth,
        bytes_at_end,
    })
}
