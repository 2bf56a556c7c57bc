//! Archives on hosts that know nothing of them, and our server asked by a client that is not ours. nginx and curl must be
//! installed (`cargo xtask setup`); the store that speaks S3 is a crate.

mod bucket;
mod curl;
mod nginx;

use std::{
    path::Path,
    sync::{Arc, LazyLock},
    time::{Duration, Instant},
};

use engine::stream::{Answer, DiskCacheOptions, OpenOptions, Request, RetryOptions, TileSource};
use tests::Fixture;
use tileset::{Archive, PageId};

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);

fn options(cache: Option<&Path>) -> OpenOptions {
    OpenOptions {
        retry: RetryOptions {
            backoff: Duration::from_millis(20),
            ..RetryOptions::default()
        },
        disk: cache.map(|folder| DiskCacheOptions {
            folder: folder.to_owned(),
            budget_bytes: 1 << 30,
        }),
        ..OpenOptions::default()
    }
}

/// Everything that can be asked of an archive, as it stands in its file.
fn requests(name: &str) -> Vec<(Request, Vec<u8>)> {
    let file = std::fs::File::open(FIXTURE.archive(name)).unwrap();
    let stored = Archive::open(file).unwrap();
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

/// Asks for all, the index first, and compares; `between` is called when half of it has come.
fn check(source: &mut dyn TileSource, name: &str, mut between: impl FnMut()) -> Vec<Answer> {
    let all = requests(name);
    let mut answers = Vec::new();
    let mut left: Vec<_> = all.iter().rev().collect();
    let begin = Instant::now();
    while answers.len() < all.len() {
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "{} of {}",
            answers.len(),
            all.len()
        );
        while (!answers.is_empty() || source.in_flight() == 0) && source.in_flight() < source.capacity() {
            let Some((request, _)) = left.pop() else { break };
            source.submit(request.clone()).unwrap();
        }
        match source.poll() {
            Some(answer) => {
                let bytes = answer.bytes.as_ref().unwrap_or_else(|error| panic!("{error}"));
                let (_, expected) = all
                    .iter()
                    .find(|(request, _)| *request == answer.request)
                    .unwrap();
                assert_eq!(bytes, expected, "{}", answer.request);
                answers.push(answer);
                if answers.len() == all.len() / 2 {
                    between();
                }
            }
            None => source.wait(Duration::from_millis(50)),
        }
    }
    answers
}

fn names() -> Vec<String> {
    let files = std::fs::read_dir(FIXTURE.tiles()).unwrap();
    let names = files.filter_map(|file| {
        let name = file.unwrap().file_name().into_string().unwrap();
        Some(name.strip_suffix(".bsvtf")?.to_owned())
    });
    names.collect()
}

/// The fixture's archives in a folder of the test's own.
fn site() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names() {
        let to = folder.path().join(format!("{name}.bsvtf"));
        std::fs::copy(FIXTURE.archive(&name), to).unwrap();
    }
    folder
}
