//! Archives on hosts that know nothing of them, and our server asked by a client that is not ours. nginx and curl must be
//! installed (`cargo xtask setup`); the store that speaks S3 is a crate.

mod bucket;
mod curl;
mod nginx;
mod secure;
mod wire;

use std::{path::Path, sync::LazyLock};

use engine::stream::{Answer, DiskCacheOptions, OpenOptions, TileSource};
use tests::{Fixture, ask, requests, soon};

static FIXTURE: LazyLock<Fixture> = LazyLock::new(Fixture::new);

fn options(cache: Option<&Path>) -> OpenOptions {
    OpenOptions {
        disk: cache.map(|folder| DiskCacheOptions {
            folder: folder.to_owned(),
            budget_bytes: 1 << 30,
        }),
        ..soon()
    }
}

/// Asks for all and compares; `between` is called when half of it has come.
fn check(source: &mut dyn TileSource, name: &str, mut between: impl FnMut()) -> Vec<Answer> {
    let all = requests(name, &FIXTURE.archive(name));
    let mut answers = Vec::new();
    ask(source, &all, |came, answer, stored| {
        let bytes = answer.bytes.as_ref().unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(bytes, stored, "{}", answer.request);
        answers.push(answer);
        if came == all.len() / 2 {
            between();
        }
    });
    answers
}
