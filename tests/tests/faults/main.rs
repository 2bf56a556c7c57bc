//! Servers that are killed, archives that are damaged, disks that are full, and all of it for a while: what is not hit goes on.

mod corrupt;
mod full_disk;
mod killed;
mod soak;

use std::{
    path::Path,
    sync::{Arc, LazyLock},
    time::{Duration, Instant},
};

use engine::stream::{Answer, OpenOptions, Request, RetryOptions, TileSource};
use tests::Fixture;
use tileset::{Archive, PageId};

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);
const NAMES: [&str; 2] = ["leather", "studs"];
const PATIENCE: Duration = Duration::from_secs(60);

/// Not a test by itself: see [`tests::ServerProcess`].
#[test]
fn server_process() {
    tests::serve_if_asked();
}

fn options() -> OpenOptions {
    OpenOptions {
        retry: RetryOptions {
            backoff: Duration::from_millis(20),
            ..RetryOptions::default()
        },
        ..OpenOptions::default()
    }
}

/// Everything that can be asked of an archive, as it stands in its file; the index first.
fn requests(name: &str, file: &Path) -> Vec<(Request, Vec<u8>)> {
    let stored = Archive::open(std::fs::File::open(file).unwrap()).unwrap();
    let archive: Arc<str> = name.into();
    let index = Request::Index {
        archive: archive.clone(),
    };
    let mut all = vec![(index, stored.prefix().unwrap())];
    for group in 0..stored.index.manifest.groups() as u16 {
        let column = Request::Column {
            archive: archive.clone(),
            group,
        };
        all.push((column, stored.read_column(group).unwrap()));
        for tile in stored.index.pyramid.tiles() {
            let page = PageId { group, tile };
            let request = Request::Page {
                archive: archive.clone(),
                page,
            };
            all.push((request, stored.read_page(page).unwrap()));
        }
    }
    all
}

/// Asks for all, and hands over each answer as it comes with what stands in the file.
fn ask(source: &mut dyn TileSource, all: &[(Request, Vec<u8>)], mut each: impl FnMut(usize, Answer, &[u8])) {
    let begin = Instant::now();
    let (mut left, mut came) = (all.iter(), 0);
    while came < all.len() {
        assert!(begin.elapsed() < PATIENCE, "{came} of {}", all.len());
        // The index alone, and then as much as goes.
        while (came > 0 || source.in_flight() == 0) && source.in_flight() < source.capacity() {
            let Some((request, _)) = left.next() else { break };
            source.submit(request.clone()).unwrap();
        }
        match source.poll() {
            Some(answer) => {
                let (_, stored) = all
                    .iter()
                    .find(|(request, _)| *request == answer.request)
                    .unwrap();
                came += 1;
                each(came, answer, stored);
            }
            None => source.wait(Duration::from_millis(50)),
        }
    }
}

/// A folder of the test's own with copies of the archives.
fn site() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in NAMES {
        std::fs::copy(FIXTURE.archive(name), folder.path().join(format!("{name}.bsvtf"))).unwrap();
    }
    folder
}
