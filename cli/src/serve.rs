//! `eigentile serve`: a folder of archives over HTTP.

use std::io::{IsTerminal, Write};
use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use serde_json::json;
use tileserver::{Collection, Options};
use tokio::net::TcpListener;
use tracing_subscriber::EnvFilter;

use crate::file;

/// Serve the archives of a folder over HTTP until interrupted.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Folder with .bsvtf files.
    folder: PathBuf,
    /// Address and port; port 0 takes a free one and prints it.
    #[arg(long, default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// Prints address and archives as JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile serve tiles
  eigentile serve tiles --listen 0.0.0.0:80
  RUST_LOG=debug eigentile serve tiles --listen 127.0.0.1:0

The first line on standard output is the address; the log goes to standard error. docs/http.md gives the protocol.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    // Fails only if there is a log already.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .try_init();
    let collection = Collection::open(&arguments.folder)?;
    let names = collection.names();
    let runtime = tokio::runtime::Runtime::new().context("cannot start the server's threads")?;
    runtime.block_on(async {
        let listener = TcpListener::bind(arguments.listen).await.with_context(|| {
            format!(
                "cannot listen on {}; choose another address with --listen",
                arguments.listen
            )
        })?;
        let address = format!("http://{}", listener.local_addr()?);
        if arguments.json {
            file::print_json(&json!({ "address": address, "archives": names }))?;
        } else {
            writeln!(std::io::stdout().lock(), "listening on {address}")?;
        }
        tileserver::run(listener, collection, Options::default(), interrupted()).await?;
        Ok(())
    })
}

/// Ends with an interrupt from the terminal, or with the signal that service managers send.
async fn interrupted() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        if let Ok(mut terminate) = signal(SignalKind::terminate()) {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => {}
                _ = terminate.recv() => {}
            }
            return;
        }
    }
    // Without a handler the system's own ends the program.
    if tokio::signal::ctrl_c().await.is_err() {
        std::future::pending::<()>().await;
    }
}
