//! The viewer's page, as it was in `web/dist` when this program was built; build.rs makes the list.

use tileserver::StaticFiles;

/// Paths and contents; none if the page had not been built.
const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/viewer.rs"));

/// The files of the page.
pub(super) fn built_in() -> StaticFiles {
    StaticFiles::new(FILES.iter().map(|(path, bytes)| ((*path).to_owned(), *bytes)))
}
