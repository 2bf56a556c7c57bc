//! A source of what a user typed.

use std::hash::{BuildHasher, RandomState};

use super::{
    BackgroundSource, DiskCacheOptions, DiskCachedSource, FolderSource, HttpOptions, HttpTransport,
    RangeSource, RetriedSource, RetryOptions, TileSource, either::EitherSource, http::Address,
};
use crate::{Error, Result};

/// How [`open_with`] puts a source together. Defaults work.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// How hosts are asked.
    pub http: HttpOptions,
    /// How what fails is asked for again; by default with another seed in every run.
    pub retry: RetryOptions,
    /// Where records of hosts are kept; nowhere by default. Those of a folder are on disk already.
    pub disk: Option<DiskCacheOptions>,
}

impl Default for OpenOptions {
    fn default() -> Self {
        let seed = RandomState::new().hash_one(0);
        Self {
            http: HttpOptions::default(),
            retry: RetryOptions {
                seed,
                ..RetryOptions::default()
            },
            disk: None,
        }
    }
}

/// As [`open_with`], with the default options.
///
/// # Errors
/// Those of [`open_with`].
pub fn open(tiles: &str) -> Result<Box<dyn TileSource>> {
    open_with(tiles, &OpenOptions::default())
}

/// Opens what a user typed, as a source that asks again, checks every record, and holds up no frame:
///
/// | typed | source |
/// |---|---|
/// | `http[s]://HOST[:PORT][/PREFIX]` | a tile server; if there is none, the `.bsvtf` files under this address, by ranges |
/// | `http[s]://HOST[:PORT]/FOLDER/NAME.bsvtf` | the `.bsvtf` files of that folder, by ranges |
/// | `http[s]://HOST[:PORT]/...?QUERY` | the same; the query, as of a presigned address, goes with every request |
/// | anything else | a folder of `.bsvtf` files on disk |
///
/// # Errors
/// [`Error::NotFound`] if there is no such folder, [`Error::Source`] if the address is none, or the cache cannot be
/// opened. Whether a host answers is known with the first answer.
pub fn open_with(tiles: &str, options: &OpenOptions) -> Result<Box<dyn TileSource>> {
    let scheme = tiles
        .split_once("://")
        .map(|(scheme, _)| scheme.trim_start().to_ascii_lowercase());
    match scheme.as_deref() {
        Some("http" | "https") => {
            let address = Address::parse(tiles)?;
            let is_file = address.base().to_ascii_lowercase().ends_with(".bsvtf");
            if is_file || address.query().is_some() {
                let transport = HttpTransport::new(&options.http)?;
                let ranges = RangeSource::new(transport, address.base());
                stack(ranges.with_query(address.query()), options)
            } else {
                stack(EitherSource::new(tiles, &options.http)?, options)
            }
        }
        Some(other) => Err(Error::Source {
            what: tiles.to_owned(),
            detail: format!("{other}:// is not supported: give http://HOST:PORT, https://HOST, or a folder"),
        }),
        None => {
            let folder = RetriedSource::new(FolderSource::new(tiles)?, options.retry);
            Ok(Box::new(BackgroundSource::new(folder)?))
        }
    }
}

/// Checked where it arrives, kept behind that, all on one thread.
fn stack(host: impl TileSource + Send + 'static, options: &OpenOptions) -> Result<Box<dyn TileSource>> {
    let retried = RetriedSource::new(host, options.retry);
    Ok(match &options.disk {
        Some(disk) => Box::new(BackgroundSource::new(DiskCachedSource::new(retried, disk)?)?),
        None => Box::new(BackgroundSource::new(retried)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_user_typed() {
        let folder = tempfile::tempdir().unwrap();
        assert!(open(folder.path().to_str().unwrap()).is_ok());
        for (typed, origin) in [
            ("http://127.0.0.1:1", "http://127.0.0.1:1"),
            ("HTTP://127.0.0.1:1/tiles/", "http://127.0.0.1:1/tiles"),
            ("http://host/tiles/cloth.bsvtf", "http://host/tiles"),
            ("http://host/cloth.BSVTF", "http://host"),
            (
                "https://host/a/cloth.bsvtf?X-Amz-Signature=0f%2F",
                "https://host/a",
            ),
            ("https://host/a/?sv=1", "https://host/a"),
        ] {
            assert_eq!(open(typed).unwrap().origin(), origin, "{typed}");
        }
        for (bad, says) in [
            ("/no/such/folder", "folder"),
            ("ftp://x", "ftp://"),
            ("http://", "http://HOST"),
        ] {
            let error = open(bad).err().unwrap().to_string();
            assert!(error.contains(says), "{bad}: {error}");
        }
    }
}
