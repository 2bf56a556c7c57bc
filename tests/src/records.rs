//! All records of an archive, asked of a source and compared with what stands in the file.

use std::{
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

use engine::stream::{Answer, OpenOptions, Request, RetryOptions, TileSource};
use tileset::{Archive, PageId};

/// Longest time for all of it.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Sources that ask again soon.
pub fn soon() -> OpenOptions {
    OpenOptions {
        retry: RetryOptions {
            backoff: Duration::from_millis(20),
            ..RetryOptions::default()
        },
        ..OpenOptions::default()
    }
}

/// Everything that can be asked of an archive, as it stands in its file; the index first.
///
/// # Panics
/// If the file is no archive.
pub fn requests(name: &str, file: &Path) -> Vec<(Request, Vec<u8>)> {
    let stored = Archive::open(std::fs::File::open(file).expect("an archive")).expect("an archive");
    let archive: Arc<str> = name.into();
    let index = Request::Index {
        archive: archive.clone(),
    };
    let mut all = vec![(index, stored.prefix().expect("an index"))];
    for group in 0..stored.index.manifest.groups() as u16 {
        let column = Request::Column {
            archive: archive.clone(),
            group,
        };
        all.push((column, stored.column_record(group).expect("a column")));
        for tile in stored.index.pyramid.tiles() {
            let page = PageId { group, tile };
            let request = Request::Page {
                archive: archive.clone(),
                page,
            };
            all.push((request, stored.page_record(page).expect("a page")));
        }
    }
    all
}

/// Asks for all, and hands over each answer as it comes, with how many have come and what stands in the file.
///
/// # Panics
/// If not all come within [`PATIENCE`].
pub fn ask(
    source: &mut dyn TileSource,
    all: &[(Request, Vec<u8>)],
    mut each: impl FnMut(usize, Answer, &[u8]),
) {
    let begin = Instant::now();
    let (mut left, mut came) = (all.iter(), 0);
    while came < all.len() {
        assert!(begin.elapsed() < PATIENCE, "{came} of {}", all.len());
        // The index alone, and then as much as goes.
        while (came > 0 || source.in_flight() == 0) && source.in_flight() < source.capacity() {
            let Some((request, _)) = left.next() else { break };
            source.submit(request.clone()).expect("room");
        }
        match source.poll() {
            Some(answer) => {
                let asked = all.iter().find(|(request, _)| *request == answer.request);
                let (_, stored) = asked.expect("what was asked for");
                came += 1;
                each(came, answer, stored);
            }
            None => source.wait(Duration::from_millis(50)),
        }
    }
}
