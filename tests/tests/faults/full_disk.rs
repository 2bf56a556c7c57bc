//! A disk cache whose disk is full. No file of a process can be larger than a limit of the system, as if the disk ended there: writes stop in
//! the middle with an error, like those to a disk without room.

use std::{path::Path, process::Command};

use engine::stream::{DiskCacheOptions, OpenOptions, open_with};
use tests::{Server, ask, requests, soon};

use crate::{FIXTURE, NAMES};

/// Where the child finds the server and the cache.
const PLACES: [&str; 2] = ["EIGENTILE_TEST_ADDRESS", "EIGENTILE_TEST_CACHE"];
/// Largest file, in blocks of 512 bytes: some records fit, others do not.
const BLOCKS: &str = "2";

fn with_cache(folder: &Path) -> OpenOptions {
    OpenOptions {
        disk: Some(DiskCacheOptions {
            folder: folder.to_owned(),
            budget_bytes: 1 << 30,
        }),
        ..soon()
    }
}

/// Everything through a cache; how many records came from it.
fn stream(address: &str, cache: &Path) -> u64 {
    let mut source = open_with(address, &with_cache(cache)).unwrap();
    for name in NAMES {
        let file = std::env::var(name).map_or_else(|_| FIXTURE.archive(name), Into::into);
        ask(&mut *source, &requests(name, &file), |_, answer, stored| {
            assert_eq!(answer.bytes.unwrap(), stored, "{}", answer.request);
        });
    }
    source.stats().from_disk
}

/// Not a test by itself: what runs with the limit.
#[test]
fn limited_process() {
    let [Ok(address), Ok(cache)] = PLACES.map(std::env::var) else {
        return;
    };
    let large = std::env::temp_dir().join(format!("eigentile-limit-{}", std::process::id()));
    let refused = std::fs::write(&large, vec![0; 1 << 16]);
    let _ = std::fs::remove_file(&large);
    refused.expect_err("the limit holds");
    stream(&address, Path::new(&cache));
}

#[test]
fn no_record_is_lost_and_none_is_kept_in_part() {
    let cache = tempfile::tempdir().unwrap();
    let server = Server::start(&FIXTURE.tiles());
    let mut child = Command::new("sh");
    // Without the signal that would end the process; what is ignored stays so behind exec.
    child.args([
        "-c",
        &format!("trap '' XFSZ; ulimit -f {BLOCKS}; exec \"$0\" \"$@\""),
    ]);
    child.arg(std::env::current_exe().unwrap());
    child.args(["--exact", "full_disk::limited_process", "--nocapture"]);
    child.envs(
        PLACES
            .iter()
            .zip([server.address.as_ref(), cache.path().as_os_str()]),
    );
    child.envs(NAMES.map(|name| (name, FIXTURE.archive(name))));
    let output = child.output().unwrap();
    let text = [output.stdout, output.stderr].concat();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&text));

    // With room again: what is there is whole, and the rest is added.
    stream(&server.address, cache.path());
    let from_disk = stream(&server.address, cache.path());
    assert!(from_disk > 0, "the cache works again");
}
