//! What goes wrong is said in one line that names what and where, and the exit code is 1.

mod program;

use std::fs;
use std::net::TcpListener;

use program::{fail, succeed};

#[test]
fn failures_are_one_clear_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("text.npy"), "no numpy file").unwrap();
    fs::write(
        at.join("text.bsvtf"),
        "no archive, but long enough to hold a header of sixty-four bytes",
    )
    .unwrap();
    fs::write(at.join("empty.bsvtf"), "").unwrap();
    fs::write(at.join("text.gltf"), "{}").unwrap();
    fs::write(at.join("path.json"), r#"{"keys": []}"#).unwrap();
    scenes::gltf::save(&scenes::showcase::swatch("absent"), &at.join("swatch.gltf")).unwrap();
    fs::create_dir(at.join("tiles")).unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let cases: &[(&[&str], &[&str])] = &[
        (
            &["synth", "granite", "-o", "a.npy"],
            &["granite", "leather", "studs"],
        ),
        (&["synth", "leather", "-o", "a.npy", "--size", "0"], &["0"]),
        (&["synth", "leather", "-o", "a.png"], &["a.png", ".npy"]),
        (&["preprocess", "absent.npy", "-o", "a.bsvtf"], &["absent.npy"]),
        (&["preprocess", "text.npy", "-o", "a.bsvtf"], &["text.npy"]),
        (
            &["preprocess", "text.npy", "-o", "a.bsvtf", "--report", "text.json"],
            &["text.json", "directions"],
        ),
        (&["inspect", "absent.bsvtf"], &["absent.bsvtf"]),
        (&["inspect", "text.bsvtf"], &["text.bsvtf", "header"]),
        (&["inspect", "empty.bsvtf", "--json"], &["empty.bsvtf"]),
        (&["export", "text.bsvtf", "-o", "factors"], &["text.bsvtf"]),
        (&["serve", "absent"], &["absent"]),
        (&["serve", "tiles", "--listen", &address], &[&address, "--listen"]),
        (&["render", "absent.gltf", "-o", "out"], &["absent.gltf"]),
        (&["render", "text.gltf", "-o", "out"], &["text.gltf"]),
        (
            &["render", "absent.bsvtf", "-o", "out"],
            &["absent.bsvtf", "--tiles"],
        ),
        (
            &["render", "swatch.gltf", "-o", "out", "--camera", "path.json"],
            &["path.json", "0 keys"],
        ),
        (
            &["render", "swatch.gltf", "-o", "out", "--tiles", "nowhere"],
            &["nowhere"],
        ),
        (
            &["render", "swatch.gltf", "-o", "out", "--tiles", "."],
            &["absent"],
        ),
        (
            &["render", "swatch.gltf", "-o", "out", "--frames", "0"],
            &["--frames"],
        ),
    ];
    for (arguments, expected) in cases {
        let message = fail(at, arguments);
        for part in *expected {
            assert!(
                message.contains(part),
                "{arguments:?}: {part:?} is not in {message:?}"
            );
        }
    }
    assert!(
        !at.join("a.npy").exists() && !at.join("a.bsvtf").exists(),
        "nothing half done is left"
    );
}

#[test]
fn wrong_usage_fails_and_help_teaches_by_example() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["paint"][..],
        &["render", "x.gltf"],
        &["render", "x.gltf", "-o", "y", "--size", "0x7"],
        &["render", "x.gltf", "-o", "y", "--overlay", "nonsense"],
        &["render", "x.bsvtf", "-o", "y", "--shape", "cube"],
        &["bench", "memory-quality", "--formats", "words"],
    ] {
        let output = program::run(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        assert!(!output.stderr.is_empty() && output.stdout.is_empty());
    }
    for command in [
        "synth",
        "preprocess",
        "inspect",
        "convert",
        "export",
        "serve",
        "render",
        "demo",
        "bench",
    ] {
        let help = succeed(folder.path(), &[command, "--help"]);
        assert!(
            help.contains(&format!("  eigentile {command} ")),
            "{command}: {help}"
        );
    }
    assert!(succeed(folder.path(), &["--help"]).contains("eigentile demo"));
    assert!(succeed(folder.path(), &["--version"]).starts_with("eigentile "));
}
