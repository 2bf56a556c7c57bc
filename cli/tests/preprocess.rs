//! Goals, conflicts of options, and runs that are killed.

mod program;

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use program::{command, fail, run, succeed, succeed_json};

fn synthesize(at: &Path, size: &str) {
    succeed_json(
        at,
        &[
            "synth",
            "leather",
            "-o",
            "leather.npy",
            "--size",
            size,
            "--rays",
            "1",
            "--json",
        ],
    );
}

/// The arguments with these options.
fn preprocess<'a>(options: &[&'a str]) -> Vec<&'a str> {
    let arguments = [
        "preprocess",
        "leather.npy",
        "-o",
        "leather.bsvtf",
        "--memory",
        "1GiB",
    ];
    [&arguments[..], options].concat()
}

#[test]
fn goals_are_met_and_exclude_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    synthesize(at, "24");
    let report = succeed_json(at, &preprocess(&["--target-error", "0.3", "--verify", "--json"]));
    let of = |pointer: &str| report.pointer(pointer).unwrap().as_f64().unwrap();
    assert!(of("/relative_error") <= 0.3, "{report}");
    assert!(
        (of("/measured_error/relative") / of("/relative_error") - 1.0).abs() < 0.02,
        "{report}"
    );
    assert_eq!(report["measured_against"], "btf");
    let output = run(
        at,
        &preprocess(&["--weights", "solid-angle", "--components", "8", "--passes", "2"]),
    );
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(
        text.contains("8 components") && text.contains("2 passes") && text.contains("weighted"),
        "{text}"
    );

    for (options, expected) in [
        (
            &["--target-error", "0.1", "--target-psnr", "30"][..],
            ["--target-error", "--target-psnr"],
        ),
        (
            &["--target-error", "0.1", "--components", "4"],
            ["--target-error", "--components"],
        ),
        (
            &["--max-bytes", "1MB", "--quality", "0.1"],
            ["--max-bytes", "--quality"],
        ),
    ] {
        let output = run(at, &preprocess(options));
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert!(expected.iter().all(|part| text.contains(part)), "{text}");
    }
    assert!(fail(at, &preprocess(&["--target-error", "2"])).contains("target error"));
    assert!(fail(at, &preprocess(&["--max-bytes", "2KB"])).contains("2000 bytes cannot be reached"));
}

#[test]
fn a_killed_run_continues_and_gives_the_same_archive() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    synthesize(at, "64");
    let arguments = |output: &'static str| {
        let options = ["--components", "20", "--memory", "200MiB", "--save-every", "0"];
        [&["preprocess", "leather.npy", "-o", output], &options[..]].concat()
    };
    succeed(at, &arguments("whole.bsvtf"));
    let state = at.join("killed.bsvtf.partial/state");
    let deadline = Instant::now() + Duration::from_secs(60);
    // Killed as soon as something is saved, until it gets through.
    let mut kills = 0;
    while kills < 3 {
        let mut child = command(&arguments("killed.bsvtf"))
            .current_dir(at)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let before = fs::metadata(&state).and_then(|about| about.modified()).ok();
        while child.try_wait().unwrap().is_none() {
            let now = fs::metadata(&state).and_then(|about| about.modified()).ok();
            if now.is_some() && now != before {
                child.kill().unwrap(); // SIGKILL
                kills += 1;
                break;
            }
            assert!(Instant::now() < deadline, "nothing was saved");
        }
        child.wait().unwrap();
        assert!(kills > 0, "it ended before it could be killed");
        if at.join("killed.bsvtf").exists() {
            break;
        }
    }
    if !at.join("killed.bsvtf").exists() {
        let report = succeed_json(at, &[&arguments("killed.bsvtf")[..], &["--json"]].concat());
        assert!(report["resumed_rows"].as_u64().unwrap() > 0, "{report}");
    }
    assert!(fs::read(at.join("killed.bsvtf")).unwrap() == fs::read(at.join("whole.bsvtf")).unwrap());
    assert!(!at.join("killed.bsvtf.partial").exists());
    let left = fs::read_dir(at)
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().into_string().unwrap());
    let trash: Vec<String> = left.filter(|name| name.starts_with('.')).collect();
    assert!(trash.len() <= 1, "{trash:?}");
}
