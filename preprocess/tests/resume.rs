//! Interrupted runs continue, and what comes out has the bits of a run without interruption.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Duration;

use common::{Shape, material, write_btf};
use preprocess::factorize::{Checkpoint, factorize, factorize_resumable};
use preprocess::npy::Dtype;
use preprocess::{Btf, Factors, Phase, Progress, Settings};

const SHAPE: Shape = Shape {
    views: 30,
    lights: 40,
    width: 20,
    height: 12,
};

fn settings() -> Settings {
    Settings {
        components: 9,
        memory_bytes: 1 << 30,
        ..Settings::default()
    }
}

/// Runs until `stop` says so, as if the process had been killed there: nothing is cleaned up.
fn interrupted(
    btf: &Btf,
    settings: &Settings,
    checkpoint: &Checkpoint,
    stop: impl Fn(Progress) -> bool + Sync,
) {
    let progress = |progress: Progress| {
        if stop(progress) {
            std::panic::resume_unwind(Box::new("interrupted"));
        }
    };
    let run = || factorize_resumable(btf, settings, Some(checkpoint), &progress);
    assert!(
        catch_unwind(AssertUnwindSafe(run)).is_err(),
        "it was to be interrupted"
    );
}

fn same_bits(a: &Factors, b: &Factors) -> bool {
    let exact = |factors: &Factors| (factors.energy, factors.residual_energy, factors.mean_rgb);
    a.u == b.u && a.v == b.v && a.singular_values == b.singular_values && exact(a) == exact(b)
}

fn open(folder: &Path, seed: u64) -> Btf {
    let samples = material(SHAPE, 20, 0.05, seed);
    Btf::open(&write_btf(folder, SHAPE, Dtype::F16, &samples)).unwrap()
}

#[test]
fn a_run_continues_from_its_last_block_with_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let btf = open(folder.path(), 3);
    let settings = settings();
    let whole = factorize(&btf, &settings, &|_| ()).unwrap();
    assert!(
        whole.statistics.block_rows < SHAPE.rows() / 4,
        "a pass has several blocks"
    );
    let checkpoint = Checkpoint::beside(&folder.path().join("a.bsvtf"), Duration::ZERO);
    for phase in [
        Phase::Sketch,
        Phase::PowerIteration(1),
        Phase::PowerIteration(2),
        Phase::Projection,
    ] {
        for rows in [0, SHAPE.rows() as u64 / 2] {
            interrupted(&btf, &settings, &checkpoint, |at| {
                at.phase == phase && at.done > rows
            });
            assert!(checkpoint.folder().join("state").exists());
            let resumed = factorize_resumable(&btf, &settings, Some(&checkpoint), &|_| ()).unwrap();
            assert!(
                resumed.statistics.resumed_rows > rows,
                "{phase} {rows}: {:?}",
                resumed.statistics
            );
            assert!(same_bits(&resumed, &whole), "{phase} {rows}");
            checkpoint.delete();
            assert!(!checkpoint.folder().exists());
        }
    }
    // Interrupted again and again, one block at a time.
    let mut runs = 0;
    loop {
        let blocks = std::sync::atomic::AtomicU32::new(0);
        let progress = |_: Progress| {
            if blocks.fetch_add(1, std::sync::atomic::Ordering::Relaxed) == 4 {
                std::panic::resume_unwind(Box::new("interrupted"));
            }
        };
        let run = || factorize_resumable(&btf, &settings, Some(&checkpoint), &progress);
        runs += 1;
        assert!(runs < 100, "it never ends");
        if let Ok(result) = catch_unwind(AssertUnwindSafe(run)) {
            assert!(same_bits(&result.unwrap(), &whole));
            break;
        }
    }
    assert!(runs > 3);
}

#[test]
fn the_state_of_other_work_or_a_damaged_one_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let btf = open(folder.path(), 3);
    let wanted = settings();
    let whole = factorize(&btf, &wanted, &|_| ()).unwrap();
    let checkpoint = Checkpoint::beside(&folder.path().join("a.bsvtf"), Duration::ZERO);
    let state = checkpoint.folder().join("state");
    let half = |at: Progress| at.phase == Phase::PowerIteration(1) && at.done > 1000;
    let from_nothing = |btf: &Btf, why: &str| {
        let factors = factorize_resumable(btf, &wanted, Some(&checkpoint), &|_| ()).unwrap();
        assert_eq!(factors.statistics.resumed_rows, 0, "{why}");
        factors
    };
    // Other settings.
    interrupted(&btf, &Settings { seed: 2, ..wanted }, &checkpoint, half);
    assert!(same_bits(&from_nothing(&btf, "seed"), &whole));
    // Every kind of damage.
    checkpoint.delete();
    interrupted(&btf, &wanted, &checkpoint, half);
    let bytes = std::fs::read(&state).unwrap();
    for at in [0, 20, bytes.len() / 3, bytes.len() / 2, bytes.len() - 1] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        std::fs::write(&state, &damaged).unwrap();
        assert!(same_bits(&from_nothing(&btf, "a flipped bit"), &whole));
        std::fs::create_dir_all(checkpoint.folder()).unwrap();
        std::fs::write(&state, &bytes[..at]).unwrap();
        assert!(same_bits(&from_nothing(&btf, "a short file"), &whole));
        std::fs::create_dir_all(checkpoint.folder()).unwrap();
    }
    // Another BTF of the same name and size.
    std::fs::write(&state, &bytes).unwrap();
    drop(btf);
    let other = open(folder.path(), 4);
    assert!(!same_bits(&from_nothing(&other, "another BTF"), &whole));
}
