//! `eigentile serve`: archives of folders and buckets over HTTP.

mod settings;
mod viewer;

use std::io::{IsTerminal, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use serde_json::json;
use tileserver::{Collection, Site, StaticFiles, Tls};
use tokio::net::TcpListener;
use tracing_subscriber::EnvFilter;

use crate::file;
use settings::{File, Settings};

/// Serve the archives of a folder or a bucket over HTTP until interrupted.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// Folder with .bsvtf files, or URL of a store: s3://, gs://, az://, http(s)://.
    #[arg(env = "EIGENTILE_SOURCE")]
    source: Option<String>,
    /// TOML file with settings; flags and the environment win over it.
    #[arg(long, env = "EIGENTILE_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    /// Prints address and archives as JSON.
    #[arg(long)]
    json: bool,
}

const DEFAULT_LISTEN: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 8080);

const EXAMPLES: &str = "\
Examples:
  eigentile serve tiles
  eigentile serve tiles --site web/dist
  eigentile serve tiles --listen 0.0.0.0:443 --tls-certificate site.pem --tls-key site.key
  AWS_REGION=eu-north-1 eigentile serve s3://bucket/tiles --cache 2GiB
  eigentile serve --config serve.toml
  RUST_LOG=debug eigentile serve tiles --listen 127.0.0.1:0

serve.toml has the flags under [settings] and may serve more than one collection:
  source = \"tiles\"                # at /v1/
  [settings]
  listen = \"0.0.0.0:8080\"
  idle-timeout = 30
  [[collection]]                    # at /museum/v1/
  place = \"museum\"
  source = \"s3://bucket/museum\"
  token-file = \"museum.tokens\"

The first line on standard output is the address; the log goes to standard error. docs/http.md gives the protocol,
docs/serving.md all about running it.";

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    // Fails only if there is a log already.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .try_init();
    let given = arguments
        .config
        .as_deref()
        .map(File::read)
        .transpose()?
        .unwrap_or_default();
    let settings = arguments.settings.clone().or(given.settings);
    let source = arguments.source.clone().or(given.source);
    let tls = match (&settings.tls_certificate, &settings.tls_key) {
        (Some(certificate), Some(key)) => Some(Tls::new(certificate, key)?),
        (None, None) => None,
        _ => bail!("a certificate and its key belong together: give --tls-certificate and --tls-key"),
    };
    let pages = match &settings.site {
        Some(folder) => StaticFiles::from_folder(folder)?,
        None => viewer::built_in(),
    };
    tileserver::raise_open_files();
    let runtime = tokio::runtime::Runtime::new().context("cannot start the server's threads")?;
    runtime.block_on(async {
        let mut site = Site::default();
        let mut names = Vec::new();
        let first = source.map(|source| (String::new(), source, settings.token_file.clone()));
        let further = given
            .collections
            .into_iter()
            .map(|more| (more.place, more.source, more.token_file));
        for (place, source, token_file) in first.into_iter().chain(further) {
            let mut collection = Collection::from_url(&source).await?;
            names.extend(collection.names());
            if let Some(path) = token_file {
                collection = collection.with_tokens(settings::tokens(&path)?);
            }
            site = site.with(&place, collection)?;
        }
        if site.is_empty() {
            bail!("nothing to serve: give a folder, a URL, or --config with a source");
        }
        let listen = settings.listen.unwrap_or(DEFAULT_LISTEN);
        let listener = TcpListener::bind(listen)
            .await
            .with_context(|| format!("cannot listen on {listen}; choose another address with --listen"))?;
        let scheme = if tls.is_some() { "https" } else { "http" };
        let address = format!("{scheme}://{}", listener.local_addr()?);
        if arguments.json {
            file::print_json(&json!({ "address": address, "archives": names }))?;
        } else {
            writeln!(std::io::stdout().lock(), "listening on {address}")?;
        }
        site = site.with_static_files(pages);
        if let Some(tls) = tls {
            site = site.with_tls(tls);
        }
        tileserver::run(listener, site, settings.options(), interrupted()).await?;
        Ok(())
    })
}

/// Serves a folder and the viewer, at the usual address or, if that is taken, on a free port, until interrupted.
pub(crate) fn folder(folder: &Path) -> Result<()> {
    let source = folder
        .to_str()
        .context("the folder has a name that is not UTF-8")?;
    let free = SocketAddr::new(DEFAULT_LISTEN.ip(), 0);
    let taken = std::net::TcpListener::bind(DEFAULT_LISTEN).is_err();
    run(&Arguments {
        source: Some(source.to_owned()),
        config: None,
        settings: Settings {
            listen: Some(if taken { free } else { DEFAULT_LISTEN }),
            ..Settings::default()
        },
        json: false,
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
