//! Tables in a document.

use std::path::Path;

use super::{KINDS, Kept};
use crate::{Error, Result};

const BEGIN: &str = "<!-- table: ";
const CLOSE: &str = " -->";
const END: &str = "<!-- end -->";

/// All results of a folder, `KIND.json`; those that are not there are left out.
///
/// # Errors
/// [`Error::Io`]; [`Error::Kept`] for JSON that is not of its kind.
pub fn open(folder: &Path) -> Result<Vec<Kept>> {
    let mut all = Vec::new();
    for kind in KINDS {
        let path = folder.join(format!("{kind}.json"));
        if path.is_file() {
            all.push(Kept::read(&path)?);
        }
    }
    Ok(all)
}

/// The document with all its tables written anew.
///
/// # Errors
/// [`Error::Invalid`] for a place of which there is no table, or that does not end.
pub fn fill(document: &str, results: &[Kept]) -> Result<String> {
    let mut filled = String::with_capacity(document.len());
    let mut rest = document;
    while let Some((before, after)) = rest.split_once(BEGIN) {
        let wrong = |expected| {
            let line = after.lines().next().unwrap_or_default();
            move || Error::Invalid {
                what: "a place for a table",
                found: format!("{BEGIN}{line}"),
                expected,
            }
        };
        let (name, inside) = after
            .split_once(CLOSE)
            .filter(|(name, _)| !name.contains('\n'))
            .ok_or_else(wrong("<!-- table: NAME -->"))?;
        let (_, next) = inside
            .split_once(END)
            .filter(|(old, _)| !old.contains(BEGIN))
            .ok_or_else(wrong("followed by <!-- end -->"))?;
        let mut tables = results.iter().flat_map(|kept| &kept.tables);
        let (_, table) = tables
            .find(|(of, _)| of == name)
            .ok_or_else(wrong("the name of a table of results that are there"))?;
        filled += &format!("{before}{BEGIN}{name}{CLOSE}\n\n{}\n\n{END}", table.trim_end());
        rest = next;
    }
    Ok(filled + rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept() -> Vec<Kept> {
        vec![Kept {
            kind: "policy".into(),
            tables: vec![("policy".into(), "| a |\n|---|\n| 1 |\n".into())],
            plots: Vec::new(),
        }]
    }

    #[test]
    fn tables_are_written_anew_and_the_rest_stays() {
        let document = "# A\n<!-- table: policy -->old\n<!-- end -->\nb\n";
        let filled = fill(document, &kept()).unwrap();
        assert_eq!(
            filled,
            "# A\n<!-- table: policy -->\n\n| a |\n|---|\n| 1 |\n\n<!-- end -->\nb\n"
        );
        assert_eq!(fill(&filled, &kept()).unwrap(), filled);
        assert_eq!(fill("nothing", &kept()).unwrap(), "nothing");
    }

    #[test]
    fn places_that_are_wrong_are_named() {
        for (document, part) in [
            ("<!-- table: other -->\n<!-- end -->", "other"),
            ("<!-- table: policy -->\n", "followed by"),
            (
                "<!-- table: policy -->\n<!-- table: policy -->\n<!-- end -->",
                "followed by",
            ),
            ("<!-- table: policy\n-->", "NAME"),
        ] {
            let error = fill(document, &kept()).unwrap_err().to_string();
            assert!(error.contains(part), "{document}: {error}");
        }
    }
}
