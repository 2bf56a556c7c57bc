//! What all commands that stream can be told about hosts, and about the cache on disk.

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use clap::Args;
use engine::stream::{DiskCacheOptions, HttpOptions, OpenOptions};

use crate::bytes;

/// Which hosts are trusted, and where records that come over the network are kept.
#[derive(Args, Clone, Debug)]
pub(crate) struct CacheArguments {
    /// Keeps what comes over HTTP on disk, for other runs and for when there is no network: a folder, "default" for the
    /// user's own, or "none".
    #[arg(long, value_name = "DIR|default|none", default_value = "none")]
    cache: String,
    /// Most bytes of the cache on disk, whoever wrote them.
    #[arg(long, value_name = "SIZE", default_value = "4GiB", value_parser = bytes::parse)]
    cache_bytes: u64,
    /// PEM file with certificates of authorities to trust for https://, besides those of the system.
    #[arg(long, value_name = "FILE.pem")]
    ca_file: Option<PathBuf>,
}

impl CacheArguments {
    /// How sources are opened.
    pub(crate) fn open_options(&self) -> Result<OpenOptions> {
        let disk = match self.cache.as_str() {
            "none" => None,
            "default" => Some(DiskCacheOptions::user().context(
                "--cache default: neither XDG_CACHE_HOME nor HOME (LOCALAPPDATA on Windows) says where: give a folder",
            )?),
            folder => Some(DiskCacheOptions {
                folder: PathBuf::from(folder),
                budget_bytes: 0,
            }),
        };
        let disk = disk.map(|disk| DiskCacheOptions {
            budget_bytes: self.cache_bytes,
            ..disk
        });
        Ok(OpenOptions {
            http: HttpOptions {
                ca_file: self.ca_file.clone(),
                ..HttpOptions::default()
            },
            disk,
            ..OpenOptions::default()
        })
    }
}
