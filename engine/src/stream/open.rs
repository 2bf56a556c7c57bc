//! A source of what a user typed.

use super::{FolderSource, HttpOptions, HttpSource, TileSource};
use crate::{Error, Result};

/// Opens a tile server (`http://host:port`) or a folder of archives.
///
/// # Errors
/// [`Error::NotFound`] if there is no such folder, [`Error::Source`] if the address is none. Whether a server
/// answers is known with the first answer.
pub fn open(tiles: &str) -> Result<Box<dyn TileSource>> {
    let scheme = tiles
        .split_once("://")
        .map(|(scheme, _)| scheme.to_ascii_lowercase());
    match scheme.as_deref() {
        Some("http") => Ok(Box::new(HttpSource::new(tiles, HttpOptions::default())?)),
        Some(other) => Err(Error::Source {
            what: tiles.to_owned(),
            detail: format!("{other}:// is not supported: give http://HOST:PORT or a folder"),
        }),
        None => Ok(Box::new(FolderSource::new(tiles)?)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_user_typed() {
        let folder = tempfile::tempdir().unwrap();
        assert!(open(folder.path().to_str().unwrap()).is_ok());
        assert!(open("http://127.0.0.1:1").is_ok());
        assert!(open("HTTP://127.0.0.1:1/tiles/").is_ok());
        for (bad, says) in [
            ("/no/such/folder", "folder"),
            ("https://x", "https://"),
            ("http://", "http://HOST"),
        ] {
            let error = open(bad).err().unwrap().to_string();
            assert!(error.contains(says), "{bad}: {error}");
        }
    }
}
