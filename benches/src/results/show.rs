//! Which tables and plots come of which JSON.

use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::peers;
use crate::report::Origin;
use crate::{Error, Result, engine, memory_quality, policy, scale, serve, stream, time_error};

/// Kinds of results: each is a file `KIND.json`.
pub const KINDS: [&str; 9] = [
    "codec",
    "engine",
    "factorize",
    "memory-quality",
    "policy",
    "scale",
    "serve",
    "stream",
    "time-error",
];

/// Results of a kind, as they are shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kept {
    /// One of [`KINDS`].
    pub kind: String,
    /// Tables in Markdown by name: the kind, or KIND-PART where there are several.
    pub tables: Vec<(String, String)>,
    /// SVGs by name of the file.
    pub plots: Vec<(String, String)>,
}

/// The part of `engine.json` that is shown.
#[derive(Deserialize)]
struct Cases {
    cases: Vec<engine::Case>,
}

impl Kept {
    /// Reads `KIND.json`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Kept`] for another name, or JSON that is not of its kind.
    pub fn read(path: &Path) -> Result<Self> {
        let kind = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let text = std::fs::read(path).map_err(Error::io(path, "read"))?;
        Self::parse(&kind, &text).map_err(|detail| Error::Results {
            path: path.to_owned(),
            detail,
        })
    }

    fn parse(kind: &str, json: &[u8]) -> std::result::Result<Self, String> {
        let one = |table: String| vec![(kind.to_owned(), table)];
        let parts = |parts: Vec<(&str, String)>| -> Vec<(String, String)> {
            let named = parts
                .into_iter()
                .map(|(part, table)| (format!("{kind}-{part}"), table));
            named.collect()
        };
        let svg = |svg: String| vec![(format!("{kind}.svg"), svg)];
        let (mut tables, plots) = match kind {
            "codec" => (one(peers::codec(&from(json)?)), Vec::new()),
            "factorize" => (one(peers::factorize(&from(json)?)), Vec::new()),
            "engine" => {
                let Cases { cases } = from(json)?;
                let tables = vec![
                    ("frames", engine::frames(&cases)),
                    ("processor", engine::processor(&cases)),
                    ("skipped", engine::skipped(&cases)),
                    ("saved", engine::saved(&cases)),
                    ("memory", engine::memory(&cases)),
                ];
                (parts(tables), Vec::new())
            }
            "memory-quality" => {
                let results = from(json)?;
                (
                    one(memory_quality::rows(&results)),
                    svg(memory_quality::plot(&results)),
                )
            }
            "policy" => {
                let results = from(json)?;
                (one(policy::table(&results)), svg(policy::plot(&results)))
            }
            "scale" => (one(scale::table(&from(json)?)), Vec::new()),
            "serve" => {
                let results = from(json)?;
                let tables = vec![("races", serve::races(&results)), ("held", serve::held(&results))];
                (parts(tables), svg(serve::plot(&results)))
            }
            "stream" => {
                let results = from(json)?;
                let still = [("standing", stream::still(&results))];
                let moving = stream::moving(&results).map(|moving| ("moving", moving));
                (
                    parts(still.into_iter().chain(moving).collect()),
                    svg(stream::plot(&results)),
                )
            }
            "time-error" => {
                let results = from(json)?;
                (one(time_error::rows(&results)), svg(time_error::plot(&results)))
            }
            _ => {
                return Err(format!(
                    "{kind} is no kind of results; expected one of {}",
                    KINDS.join(", ")
                ));
            }
        };
        // What was kept before commands were has none.
        if let Ok(origin) = from::<Origin>(json)
            && let Some((_, table)) = tables.last_mut()
        {
            *table = format!("{}\n\n{origin}\n", table.trim_end());
        }
        Ok(Self {
            kind: kind.to_owned(),
            tables,
            plots,
        })
    }
}

fn from<T: DeserializeOwned>(json: &[u8]) -> std::result::Result<T, String> {
    serde_json::from_slice(json).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_result_is_refused() {
        let wrong = Kept::parse("policy", b"{}").unwrap_err();
        assert!(wrong.contains("missing field"), "{wrong}");
        assert!(Kept::parse("other", b"{}").unwrap_err().contains("time-error"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("serve.json");
        std::fs::write(&path, "[").unwrap();
        assert!(Kept::read(&path).unwrap_err().to_string().contains("serve.json"));
    }
}
