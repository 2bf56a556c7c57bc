//! Runs that share a folder, one after the other and at once.

use std::fs;

use super::*;
use crate::stream::{
    Faults, FaultySource, MemorySource,
    conformance::{self, Fixture, archive},
};

/// Indices first, as whoever asks for records does.
fn fetch(source: &mut dyn TileSource, requests: &[Request]) -> Vec<Answer> {
    let is_index = |request: &&Request| matches!(request, Request::Index { .. });
    let indices: Vec<Request> = requests.iter().filter(is_index).cloned().collect();
    let records: Vec<Request> = requests
        .iter()
        .filter(|request| !is_index(request))
        .cloned()
        .collect();
    let mut answers = conformance::fetch(source, &indices);
    answers.extend(conformance::fetch(source, &records));
    answers
}

fn options(folder: &std::path::Path, budget_bytes: u64) -> DiskCacheOptions {
    DiskCacheOptions {
        folder: folder.join("cache"),
        budget_bytes,
    }
}

fn cached(folder: &std::path::Path, budget: u64) -> DiskCachedSource<FaultySource<MemorySource>> {
    let source = FaultySource::new(Fixture::get().memory(), Faults::default(), 1);
    DiskCachedSource::new(source, &options(folder, budget)).unwrap()
}

const ALL_FAIL: Faults = Faults {
    fail: 1.0,
    lose: 0.0,
    repeat: 0.0,
    damage: 0.0,
    reorder: 0.0,
    delay_polls: 0,
};

fn check(answers: Vec<Answer>) -> u64 {
    answers
        .into_iter()
        .map(|answer| {
            assert_eq!(answer.bytes.unwrap(), Fixture::get().expected(&answer.request));
            answer.wire_bytes
        })
        .sum()
}

/// All files of the cache with records in them.
fn files(folder: &std::path::Path) -> Vec<PathBuf> {
    let folders = fs::read_dir(folder.join("cache/v1")).unwrap();
    let folders = folders
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_dir());
    folders
        .flat_map(|folder| fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path())
        .collect()
}

#[test]
fn another_run_finds_what_was_there() {
    let folder = tempfile::tempdir().unwrap();
    let requests = Fixture::get().requests();
    let first = check(fetch(&mut cached(folder.path(), 1 << 30), &requests));
    let mut source = cached(folder.path(), 1 << 30);
    let second = check(fetch(&mut source, &requests));
    let indices: usize = requests
        .iter()
        .filter(|request| matches!(request, Request::Index { .. }))
        .map(|request| Fixture::get().expected(request).len())
        .sum();
    assert_eq!(second, indices as u64);
    assert!(first > 2 * second);
    assert_eq!(source.stats().from_disk as usize, requests.len() - 2);
}

#[test]
fn offline_once_cached() {
    let folder = tempfile::tempdir().unwrap();
    let requests = Fixture::get().requests();
    let mut source = cached(folder.path(), 1 << 30);
    source.inner_mut().set_faults(ALL_FAIL);
    assert!(
        fetch(&mut source, &requests[..1])[0].bytes.is_err(),
        "nothing yet"
    );
    check(fetch(&mut cached(folder.path(), 1 << 30), &requests));

    let mut source = cached(folder.path(), 1 << 30);
    source.inner_mut().set_faults(ALL_FAIL);
    check(fetch(&mut source, &requests[..1]));
    assert_eq!(source.stats().offline, 1);
    let of_first = |request: &&Request| request.archive() == requests[0].archive();
    let records: Vec<Request> = requests.iter().filter(of_first).cloned().collect();
    check(fetch(&mut source, &records[1..]));

    // An archive that the host does not have any more is not offline.
    let mut source = DiskCachedSource::new(MemorySource::new(), &options(folder.path(), 1 << 30)).unwrap();
    let answer = fetch(&mut source, &requests[..1]).remove(0);
    assert!(matches!(answer.bytes, Err(Error::NotFound(_))));
}

#[test]
fn damaged_and_cut_files_are_dropped() {
    let requests = Fixture::get().requests();
    let damages: [fn(&mut Vec<u8>); 4] = [
        |bytes| bytes[0] ^= 1,
        |bytes| bytes.truncate(bytes.len() / 2),
        Vec::clear,
        |bytes| bytes.extend([0; 100]),
    ];
    for damage in damages {
        let folder = tempfile::tempdir().unwrap();
        check(fetch(&mut cached(folder.path(), 1 << 30), &requests));
        for path in files(folder.path()) {
            let mut bytes = fs::read(&path).unwrap();
            damage(&mut bytes);
            fs::write(&path, bytes).unwrap();
        }
        // Offline first: a damaged index, or link to it, is none.
        let mut source = cached(folder.path(), 1 << 30);
        source.inner_mut().set_faults(ALL_FAIL);
        assert!(fetch(&mut source, &requests[..1])[0].bytes.is_err());
        let mut source = cached(folder.path(), 1 << 30);
        check(fetch(&mut source, &requests));
        assert_eq!(
            source.stats().from_disk,
            requests
                .iter()
                .filter(|request| Fixture::get().expected(request).is_empty())
                .count() as u64
        );
        let mut source = cached(folder.path(), 1 << 30);
        check(fetch(&mut source, &requests));
        assert!(source.stats().from_disk > 40, "kept again");
    }
}

#[test]
fn the_budget_holds_and_the_oldest_goes() {
    let requests = Fixture::get().requests();
    let folder = tempfile::tempdir().unwrap();
    for budget in [0, 4095, 5 * 4096, 20 * 4096, 7 * 4096] {
        let mut source = cached(folder.path(), budget);
        assert!(
            source.store.used_bytes() <= budget,
            "what was there before counts"
        );
        for request in &requests {
            check(fetch(&mut source, std::slice::from_ref(request)));
            assert!(source.store.used_bytes() <= budget);
        }
        if budget >= 5 * 4096 {
            let last = requests
                .iter()
                .rev()
                .find(|request| !Fixture::get().expected(request).is_empty());
            let last = last.unwrap().clone();
            assert_eq!(check(fetch(&mut source, &[last])), 0, "the newest is there");
            assert!(
                check(fetch(&mut source, &requests[1..2])) > 0,
                "the oldest is not"
            );
        }
    }
}

#[test]
fn a_changed_archive_never_finds_the_old_records() {
    let folder = tempfile::tempdir().unwrap();
    let requests = [
        Request::Index {
            archive: "cloth".into(),
        },
        Request::Column {
            archive: "cloth".into(),
            group: 0,
        },
    ];
    let run = |seed| {
        let mut memory = MemorySource::new();
        memory.insert("cloth", archive(seed)).unwrap();
        let mut source = DiskCachedSource::new(memory, &options(folder.path(), 1 << 30)).unwrap();
        let answer = fetch(&mut source, &requests).remove(1);
        (answer.bytes.unwrap(), answer.wire_bytes)
    };
    let (old, _) = run(1);
    let (new, wire_bytes) = run(2);
    assert!(old != new && wire_bytes > 0);
    assert_eq!(run(1), (old, 0), "both are kept");
}

#[test]
fn leavings_of_a_crash_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let requests = Fixture::get().requests();
    check(fetch(&mut cached(folder.path(), 1 << 30), &requests[..10]));
    let root = folder.path().join("cache/v1");
    fs::write(root.join("unfinished"), b"half a rec").unwrap();
    fs::write(root.join("lock"), b"abc").unwrap();
    check(fetch(&mut cached(folder.path(), 1 << 30), &requests));
    let mut source = cached(folder.path(), 1 << 30);
    assert!(!root.join("unfinished").exists());
    check(fetch(&mut source, &requests));
    assert!(source.stats().from_disk > 40);
}

#[test]
fn a_lock_that_is_never_let_go_holds_nobody_up() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = cached(folder.path(), 1 << 30);
    let lock = fs::File::open(folder.path().join("cache/v1/lock")).unwrap();
    lock.lock().unwrap();
    check(fetch(&mut source, &Fixture::get().requests()[..4]));
    assert!(files(folder.path()).is_empty());
    drop(lock);
    check(fetch(&mut source, &Fixture::get().requests()[..4]));
    assert!(!files(folder.path()).is_empty());
}

#[test]
fn several_at_once_share_a_budget() {
    let folder = tempfile::tempdir().unwrap();
    let budget = 12 * 4096;
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for _ in 0..3 {
                    let mut source = cached(folder.path(), budget);
                    for request in Fixture::get().requests() {
                        check(fetch(&mut source, &[request]));
                    }
                }
            });
        }
    });
    let used: u64 = files(folder.path())
        .iter()
        .map(|path| fs::metadata(path).unwrap().len().div_ceil(4096) * 4096)
        .sum();
    assert!(used > 0 && used <= budget, "{used} of {budget}");
}

#[test]
fn a_disk_that_cannot_be_written_to_fails_no_request() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = cached(folder.path(), 1 << 30);
    let root = folder.path().join("cache/v1");
    // Stands for a full disk: nothing can be made where a folder is in the way.
    fs::create_dir(root.join("unfinished")).unwrap();
    check(fetch(&mut source, &Fixture::get().requests()));
    assert_eq!(source.failures, MAX_FAILURES);
    fs::write(folder.path().join("file"), b"").unwrap();
    let options = DiskCacheOptions {
        folder: folder.path().join("file"),
        budget_bytes: 1,
    };
    let error = DiskCachedSource::new(MemorySource::new(), &options)
        .err()
        .unwrap();
    assert!(error.to_string().contains("file"), "{error}");
}
